//! Drawing of `[glass]`: glazings, their weights, and draws that do not depend on new keys.

use super::draw::Draw;
use super::glass::draw_glass;
use super::recipe::Recipe;
use super::recipe::tests::PAPER;
use glasshouse_line::{Glass, Roughness, SmudgePattern};
use std::collections::BTreeMap;

/// Draws the panes of a number of scenes from the paper's recipe with other keys of the pane's make.
fn panes(keys: &str, count: u32) -> Vec<Glass> {
    let text = PAPER.replacen("thickness_m = 0.010\nior = 1.6", keys, 1);
    let recipe = Recipe::parse(&text).unwrap();
    let values = BTreeMap::new();
    let draw = |number: u32| {
        let scene = format!("train-{number:06}");
        let draw = Draw { dataset_seed: 2020, scene: &scene, attempt: 0, values: &values };
        draw_glass(&recipe.glass, draw)
    };
    (0..count).map(draw).collect()
}

fn json(glass: &Glass) -> String {
    serde_json::to_string(glass).unwrap()
}

#[test]
fn a_line_holds_the_layers_and_the_name() {
    assert_eq!(
        json(&panes("glazing = \"double-4-16-4\"", 1)[0]),
        r#"{"distance_m":0.3,"tilt_deg":[0.0,0.0],"glazing":"double-4-16-4","layers":[{"glass_m":0.004,"ior":1.52,"absorption_per_m":[10.75,5.03,4.56]},{"gap_m":0.016},{"glass_m":0.004,"ior":1.52,"absorption_per_m":[10.75,5.03,4.56]}]}"#
    );
    assert_eq!(
        json(&panes("glazing = \"half-mirror\"", 1)[0]),
        r#"{"distance_m":0.3,"thickness_m":0.004,"ior":1.52,"absorption_per_m":[2.31,1.06,0.92],"tilt_deg":[0.0,0.0],"glazing":"half-mirror","coatings":[{"face":0,"reflectance":[0.4,0.4,0.4],"transmittance":[0.6,0.6,0.6]}]}"#
    );
    assert_eq!(
        json(&panes("glazing = \"frosted\"", 1)[0]),
        r#"{"distance_m":0.3,"thickness_m":0.004,"ior":1.52,"absorption_per_m":[10.75,5.03,4.56],"tilt_deg":[0.0,0.0],"glazing":"frosted","roughness":0.05}"#
    );
    let outline = "glazing = \"single-4\"\nroughness = 0.002\nbow_radius_m = -5\n\
                   outline = { x_m = [-0.1, 0.2], y_m = [-0.3, 0.4], frame_m = 0.03, frame_radiance = [1, 2, 3] }";
    assert_eq!(
        json(&panes(outline, 1)[0]),
        r#"{"distance_m":0.3,"thickness_m":0.004,"ior":1.52,"absorption_per_m":[10.75,5.03,4.56],"tilt_deg":[0.0,0.0],"glazing":"single-4","bow_radius_m":-5.0,"roughness":0.002,"outline":{"x_m":[-0.1,0.2],"y_m":[-0.3,0.4],"frame_m":0.03,"frame_radiance":[1.0,2.0,3.0]}}"#
    );
    // The layers that a line is read with are those that were drawn.
    for glass in
        panes("glazing = { choice = [\"double-4-16-4\", \"windscreen\", \"museum-ar\"] }", 9)
    {
        assert_eq!(serde_json::from_str::<Glass>(&json(&glass)).unwrap(), glass);
    }
}

#[test]
fn names_have_the_shares_of_their_weights() {
    let keys = "glazing = { choice = [\"single-4\", \"double-4-16-4\", \"frosted\"], weights = [3, 1, 0] }";
    let mut counts: BTreeMap<String, u32> = BTreeMap::new();
    for glass in panes(keys, 4000) {
        *counts.entry(glass.glazing.unwrap().0).or_default() += 1;
    }
    assert_eq!(counts.values().sum::<u32>(), 4000);
    // Three standard deviations of 4,000 draws.
    assert!(counts["single-4"].abs_diff(3000) < 83, "{counts:?}");
    assert!(!counts.contains_key("frosted"));
}

#[test]
fn roughness_of_the_recipe_goes_before_that_of_the_glazing() {
    let glass = &panes("glazing = \"frosted\"\nroughness = { uniform = [0.001, 0.002] }", 1)[0];
    assert!((0.001..0.002).contains(&glass.roughness.as_ref().unwrap().largest()));
    assert_eq!(panes("glazing = \"frosted\"\nroughness = 0", 1)[0].roughness, None);
    let some = panes("roughness = { choice = [0, 0.004], weights = [1, 3] }", 400);
    let rough = Some(Roughness::All(0.004));
    let count = some.iter().filter(|glass| glass.roughness == rough).count();
    assert!(count.abs_diff(300) < 27, "{count}");
    assert!(some.iter().all(|glass| glass.roughness.is_none() || glass.roughness == rough));
}

#[test]
fn smudges_have_seeds_of_their_own_and_no_coverage_is_clean() {
    let keys = "smudges = { coverage = { choice = [0, 0.2] }, mark_m = 0.03, transmittance = 0.9 }";
    let all: Vec<_> = panes(keys, 40).into_iter().map(|glass| glass.smudges).collect();
    let smudges: Vec<_> = all.iter().flatten().collect();
    assert!((8..32).contains(&smudges.len()), "{}", smudges.len());
    let mut seeds = std::collections::BTreeSet::new();
    for one in smudges {
        assert_eq!((one.roughness, one.haze, one.transmittance), (0.05, 0.5, 0.9));
        let Some(SmudgePattern::Marks { seed, coverage, mark_m }) = one.pattern() else {
            panic!("{one:?}")
        };
        assert_eq!((coverage, mark_m), (0.2, 0.03));
        assert!(seeds.insert(seed), "{seed} twice");
    }
}

#[test]
fn new_keys_change_no_other_draw() {
    let keys = "ior = { uniform = [1.3, 1.7] }\nthickness_m = { choice = [0.003, 0.004, 0.006] }\n\
                tilt_deg = [{ uniform = [-9, 9] }, 0]";
    let plain = panes(keys, 50);
    let more = "roughness = { uniform = [0.001, 0.01] }\nbow_radius_m = { choice = [-9, 7] }\n\
                smudges = { coverage = { uniform = [0.1, 0.3] } }\n\
                outline = { x_m = [-0.1, { uniform = [0.1, 0.2] }], y_m = [{ uniform = [-0.2, -0.1] }, 0.1] }";
    for (mut glass, plain) in panes(&format!("{keys}\n{more}"), 50).into_iter().zip(&plain) {
        let outline = glass.outline.take().unwrap();
        assert!((0.1..=0.2).contains(&outline.x_m[1]) && (-0.2..=-0.1).contains(&outline.y_m[0]));
        assert!(glass.smudges.take().is_some());
        assert!(glass.roughness.take().is_some() && glass.bow_radius_m.take().is_some());
        assert_eq!(glass, *plain);
    }
    // Equal weights are no weights.
    let weighted = keys.replace("0.006] }", "0.006], weights = [2, 2, 2] }");
    assert_eq!(panes(&weighted, 50), plain);
    // A glazing leaves the tilt as it was.
    let named = panes("glazing = \"single-4\"\ntilt_deg = [{ uniform = [-9, 9] }, 0]", 50);
    assert!(named.iter().zip(&plain).all(|(a, b)| a.tilt_deg == b.tilt_deg));
}
