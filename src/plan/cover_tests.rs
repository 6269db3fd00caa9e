//! Tests of `[cover]`: shares, places, light, pictures and errors.

use super::cover::CoverRecipe;
use super::diode::SourceImage;
use super::expand::expand;
use super::procedural_inputs::{ProceduralInput, covers};
use super::recipe::Recipe;
use super::recipe::tests::PAPER;
use super::split::tests::set;
use glasshouse_line::{Card, SceneLine, Split};
use std::collections::{BTreeMap, BTreeSet};

fn sources() -> BTreeMap<String, Vec<SourceImage>> {
    [("diode".to_owned(), set(8, 8)), ("places".to_owned(), set(2, 2))].into()
}

/// Returns the paper's recipe with 400 scenes and `[cover]`.
fn recipe(cover: &str) -> String {
    PAPER
        .replace("diode = 3000, places = 2000", "diode = 400")
        .replace("diode = 120, places = 80", "diode = 40")
        .replace("[sources.diode]", &format!("{cover}\n[sources.diode]"))
}

fn lines(cover: &str) -> Vec<SceneLine> {
    let text = recipe(cover).replace(
        "ior = 1.6",
        "ior = 1.6\ntilt_deg = [{ uniform = [-20, 20] }, { uniform = [-40, 40] }]",
    );
    expand(&Recipe::parse(&text).unwrap(), &sources()).unwrap()
}

/// Returns the kind in the path of a card's picture.
fn kind(card: &Card) -> &str {
    let (_, file) = card.color.rsplit_once('/').unwrap();
    file.split_once('-').unwrap().0
}

fn count<'a>(lines: &'a [SceneLine], has: impl Fn(&'a SceneLine) -> bool) -> f64 {
    lines.iter().filter(|line| has(line)).count() as f64 / lines.len() as f64
}

#[test]
fn covers_have_their_shares_and_change_no_other_draw() {
    let plain = lines("");
    let covered = lines("[cover]\nphotographer = 0.3\nblind = 0.1\nplant = 0.2\nframe = 0.4");
    let near = |share: f64, expected: f64| {
        // Three standard deviations of 440 draws.
        let tolerance = 3.0 * (expected * (1.0 - expected) / 440.0).sqrt();
        assert!((share - expected).abs() < tolerance, "{share} for {expected}");
    };
    near(count(&covered, |l| l.back.cards().iter().any(|c| kind(c) == "photographer")), 0.3);
    near(count(&covered, |l| l.front.cards().iter().any(|c| kind(c) == "blind")), 0.1);
    near(count(&covered, |l| l.front.cards().iter().any(|c| kind(c) == "plant")), 0.2);
    near(count(&covered, |l| l.glass.outline.is_some()), 0.4);
    assert!(covered.iter().all(|l| l.front.cards().iter().all(|c| kind(c) != "curtain")));
    for (mut line, plain) in covered.into_iter().zip(plain) {
        let is_same_pane = line.glass.tilt_deg == plain.glass.tilt_deg;
        line.front.cards_mut().clear();
        line.back.cards_mut().clear();
        line.glass.outline = None;
        // A photographer beyond a tilted pane makes the scene draw its pane again.
        if is_same_pane {
            assert_eq!(line, plain);
        }
    }
}

#[test]
fn lines_with_covers_are_pinned() {
    let all = "[cover]\nphotographer = 1\nblind = 1\ncurtain = 1\nplant = 1\nframe = 1";
    let text = glasshouse_line::to_jsonl(&lines(all)[..4]);
    // A new value here means that recipes with covers yield other manifests.
    assert_eq!(&blake3::hash(text.as_bytes()).to_hex()[..16], "f3ea5cfb0ecd3e65");
}

/// The corners of every card are on their side of the pane, and cards of the view have their place in it.
#[test]
fn cards_clear_the_pane_and_keep_their_place_in_the_view() {
    let half_view = 36f64.hypot(24.0) / 2.0 / 55.0 / 2f64.sqrt();
    let drawn = lines(
        "[cover]\nphotographer = 1\n[cover.blind]\nshare = 1\ngap_m = 0.05\nview_width = 1.5\nview_x = -0.2\nview_y = 0.1",
    );
    for line in &drawn {
        let normal = render::trace::Slab::tilted_normal(line.glass.tilt_deg);
        let height = |x: f64, y: f64, z: f64| {
            x * normal.x + y * normal.y + z * normal.z - line.glass.distance_m * normal.z
        };
        let corners = |card: &Card, aspect: f64, z: f64| {
            let (dx, dy) = (0.5 * card.width_m, 0.5 * card.width_m / aspect);
            let [x, y] = card.center_m;
            [(-dx, -dy), (dx, -dy), (-dx, dy), (dx, dy)].map(|(u, v)| height(x + u, y + v, z))
        };
        let [blind] = line.front.cards() else { panic!("{line:?}") };
        let least =
            corners(blind, 1.25, blind.distance_m).into_iter().fold(f64::INFINITY, f64::min);
        assert!((least - line.glass.total_thickness_m() - 0.05).abs() < 1e-8, "{least}");
        let view = half_view * blind.distance_m;
        assert!((blind.width_m / (2.0 * view) - 1.5).abs() < 1e-8);
        assert!((blind.center_m[0] / view + 0.2).abs() < 1e-8);
        assert!((blind.center_m[1] / view - 0.1).abs() < 1e-8);
        let [person] = line.back.cards() else { panic!("{line:?}") };
        assert!(corners(person, 0.8, -person.distance_m).into_iter().all(|h| h < 0.0));
        // The camera in the picture is near the lens.
        let camera = person.center_m[1] - 0.3 * person.width_m / 0.8;
        assert!(camera.abs() < 0.051 && person.center_m[0].abs() < 0.081, "{person:?}");
    }
}

#[test]
fn a_card_has_the_light_of_its_side() {
    let light = "[back]\nexposure = 2\nexposure_ev = 1\nilluminant_k = 5000\n";
    let of = |cover: &str| lines(&format!("{light}{cover}"))[0].clone();
    let line = of(
        "[cover.photographer]\nshare = 1\nexposure = 0.5\n[cover.plant]\nshare = 1\nexposure = 0.25",
    );
    let person = &line.back.cards()[0];
    assert_eq!((person.exposure, person.illuminant), (2.0, line.back.illuminant()));
    assert_eq!(
        (line.front.cards()[0].exposure, line.front.cards()[0].illuminant),
        (0.25, [1.0; 3])
    );
}

#[test]
fn a_frame_lies_in_the_plane_of_the_pane() {
    let half_m = 0.3 * 36f64.hypot(24.0) / 2.0 / 55.0 / 2f64.sqrt();
    let line = &lines(
        "[cover.frame]\nshare = 1\nview_x = [-0.5, 3]\nview_y = [-2, 0.25]\nframe_m = 0.04\nframe_radiance = 0.2",
    )[0];
    let outline = line.glass.outline.as_ref().unwrap();
    let near = |found: [f64; 2], expected: [f64; 2]| {
        found.iter().zip(expected).all(|(f, e)| (f / half_m - e).abs() < 1e-8)
    };
    assert!(near(outline.x_m, [-0.5, 3.0]) && near(outline.y_m, [-2.0, 0.25]), "{outline:?}");
    assert_eq!((outline.frame_m, outline.frame_radiance), (0.04, [0.2; 3]));
}

#[test]
fn no_two_splits_share_a_picture() {
    let text = recipe("[cover]\npictures = 3\ncurtain = 0.5\nphotographer = 1");
    let recipe = Recipe::parse(&text).unwrap();
    let all = covers(&recipe);
    let names: BTreeSet<String> = all.iter().map(ProceduralInput::name).collect();
    assert_eq!((all.len(), names.len()), (12, 12));
    let lines = expand(&recipe, &sources()).unwrap();
    let used = |split: Split| -> BTreeSet<String> {
        let of_split = lines.iter().filter(|line| line.split == split);
        let cards = of_split.flat_map(|line| line.front.cards().iter().chain(line.back.cards()));
        cards.map(|card| card.color.clone()).collect()
    };
    let [train, test] = [Split::Train, Split::Test].map(used);
    assert!(train.is_disjoint(&test));
    assert_eq!(train.union(&test).cloned().collect::<BTreeSet<_>>(), names);

    let run = tempfile::tempdir().unwrap();
    super::make_inputs(run.path(), &all, 2, &|_, _| {}).unwrap();
    let file = run.path().join("inputs/cover/test/curtain-0002.png");
    let png = image::load_from_memory(&std::fs::read(file).unwrap()).unwrap();
    assert_eq!((png.width(), png.height()), (307, 512));
}

#[test]
fn errors_say_what_to_change() {
    for (cover, message) in [
        ("[cover]\nwindow = 1", "unknown field `window`, expected one of"),
        (
            "[cover]\nblind = \"often\"",
            "expected the share of scenes, 0.3 for instance, or a table",
        ),
        (
            "[cover]\nblind = 1.5",
            "cover.blind has the share 1.5, but the share of scenes must be above 0",
        ),
        ("[cover.plant]\ngap_m = 1", "cover.plant has the share 0, but"),
        (
            "[cover.plant]\nshare = 1\ngap_m = 0",
            "cover.plant.gap_m is 0, but must be finite and above 0",
        ),
        (
            "[cover.plant]\nshare = 1\nwidth_m = 1",
            "unknown field `width_m`, expected one of `share`, `gap_m`",
        ),
        ("[cover]\npictures = 0\nplant = 1", "cover.pictures is 0, but must be 1 to 10000"),
        (
            "[cover.frame]\nshare = 1\nview_x = [0.5, 0.5]",
            "cover.frame.view_x can begin at 0.5 and end at 0.5, but must begin before it ends",
        ),
        (
            "[cover]\nframe = 1\n[glass.outline]\nx_m = [0, 1]\ny_m = [0, 1]",
            "cover.frame draws the edges of the glass, and glass.outline gives them, too: remove one",
        ),
        (
            "[cover]\nframe = 1\n[sources.cover]\nlayout = \"diode\"",
            "sources.cover has the name of the root of [cover]",
        ),
    ] {
        let error = Recipe::parse(&recipe(cover)).expect_err(cover).to_string();
        assert!(error.contains(message), "{cover}: {error}");
    }
    let steep = recipe("[cover.blind]\nshare = 1\nview_width = 9")
        .replace("ior = 1.6", "ior = 1.6\ntilt_deg = [0, 45]");
    let error = expand(&Recipe::parse(&steep).unwrap(), &sources()).unwrap_err().to_string();
    let expected = "failed, the last because cover.blind cannot stand behind a pane with this tilt";
    assert!(error.contains(expected) && error.contains("cover.blind.view_width (9)"), "{error}");
    let near = recipe("[cover]\nphotographer = 1")
        .replace("distance_m = 0.30", "distance_m = 0.05\ntilt_deg = [0, 60]");
    let error = expand(&Recipe::parse(&near).unwrap(), &sources()).unwrap_err().to_string();
    assert!(error.contains("cover.photographer reaches 0."), "{error}");
}

#[test]
fn the_default_has_no_cover() {
    let text = recipe("[cover]");
    let parsed = Recipe::parse(&text).unwrap();
    assert_eq!(parsed.cover, Some(CoverRecipe::default()));
    assert_eq!(expand(&parsed, &sources()).unwrap(), {
        let plain = Recipe::parse(&recipe("")).unwrap();
        expand(&plain, &sources()).unwrap()
    });
}
