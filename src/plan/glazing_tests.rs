//! Checks the file of glazings, and docs/glass.md against it.

use super::expand::expand;
use super::recipe::Recipe;
use super::recipe::tests::PAPER;
use super::split::tests::set;
use glasshouse_line::{GlassLayer, GlazingName};
use glasshouse_line::{Glazing, glazings};
use render::scene::coating_of;
use render::trace::{Stack, StackLayer};
use std::collections::BTreeSet;

#[test]
fn every_glazing_makes_a_valid_line() {
    let sources = [("diode".to_owned(), set(4, 4)), ("places".to_owned(), set(4, 4))].into();
    for (name, glazing) in &glazings().by_name {
        let keys = format!("glazing = \"{name}\"");
        let recipe = Recipe::parse(&PAPER.replacen("thickness_m = 0.010\nior = 1.6", &keys, 1));
        let mut recipe = recipe.unwrap();
        recipe.splits.iter_mut().for_each(|split| split.pairs = [("diode".to_owned(), 1)].into());
        // Expansion validates each line.
        for line in expand(&recipe, &sources).unwrap() {
            assert_eq!(line.glass.glazing, Some(GlazingName(name.clone())));
            assert_eq!(line.glass.layers.is_empty(), glazing.layers.len() == 1, "{name}");
            assert_eq!(
                (&line.glass.coatings, &line.glass.roughness),
                (&glazing.coatings, &glazing.roughness)
            );
        }
    }
}

#[test]
fn a_refused_draw_may_have_another_name() {
    let sources = [("diode".to_owned(), set(4, 4)), ("places".to_owned(), set(4, 4))].into();
    let refused = |names: &str| {
        let keys = format!("glazing = {names}\ntilt_deg = [0, 88]");
        let text = PAPER.replacen("thickness_m = 0.010\nior = 1.6", &keys, 1);
        expand(&Recipe::parse(&text).unwrap(), &sources).unwrap_err().to_string()
    };
    let error = refused("\"single-4\"");
    assert!(error.contains("all 1 draws of"), "{error}");
    let error = refused("{ choice = [\"single-4\", \"frosted\"] }");
    assert!(error.contains("all 100 draws of"), "{error}");
    assert!(error.contains("glass.glazing (choice of [\"single-4\", \"frosted\"])"), "{error}");
}

#[test]
fn the_promised_names_are_there_and_every_number_has_a_source() {
    let file = glazings();
    for name in [
        "single-4",
        "single-6",
        "double-4-16-4",
        "double-4-12-4",
        "triple-4-12-4-12-4",
        "double-low-e",
        "laminated-33-1",
        "windscreen",
        "showcase-acrylic",
        "museum-ar",
        "tinted-grey",
        "half-mirror",
        "frosted",
        "clear-low-iron",
    ] {
        assert!(file.by_name.contains_key(name), "{name}");
    }
    let used: BTreeSet<&String> = file.by_name.values().flat_map(|g| &g.sources).collect();
    assert_eq!(used, file.sources.keys().collect());
    assert!(file.by_name.values().all(|glazing| !glazing.sources.is_empty()));
}

/// Returns reflectance and transmittance of the whole pane at normal incidence.
fn totals(glazing: &Glazing) -> [[f64; 3]; 2] {
    let layer = |layer: &GlassLayer| match *layer {
        GlassLayer::Glass { glass_m, ior, absorption_per_m, .. } => {
            StackLayer { thickness_m: glass_m, ior, absorption_per_m }
        }
        GlassLayer::Gap { gap_m, .. } => {
            StackLayer { thickness_m: gap_m, ior: 1.0, absorption_per_m: [0.0; 3] }
        }
    };
    let mut coatings = vec![None; glazing.layers.len() + 1];
    for c in &glazing.coatings {
        coatings[c.face as usize] = Some(coating_of(c));
    }
    Stack::new(glazing.layers.iter().map(layer).collect(), coatings).totals(1.0)
}

/// Formats a row of the table of docs/glass.md.
fn row(name: &str, glazing: &Glazing) -> String {
    let mm = |m: f64| (m * 1e5).round() / 100.0;
    let layer = |layer: &GlassLayer| match *layer {
        GlassLayer::Glass { glass_m, ior, .. } => format!("{} (n {ior})", mm(glass_m)),
        GlassLayer::Gap { gap_m, .. } => format!("gap {}", mm(gap_m)),
    };
    let layers: Vec<String> = glazing.layers.iter().map(layer).collect();
    let faces: Vec<String> = glazing.coatings.iter().map(|c| c.face.to_string()).collect();
    let percent = |of: [f64; 3]| of.map(|share| format!("{:.1}", 100.0 * share)).join(", ");
    let [reflected, transmitted] = totals(glazing).map(percent);
    format!(
        "| `{name}` | {} | {} | {} | {reflected} | {transmitted} | {} |",
        glazing.description,
        layers.join(", "),
        faces.join(", "),
        glazing.sources.join(", "),
    )
}

#[test]
fn the_document_has_the_numbers_of_the_file() {
    let document = include_str!("../../docs/glass.md");
    let file = glazings();
    let rows = file.by_name.iter().map(|(name, glazing)| row(name, glazing));
    let sources = file.sources.iter().map(|(key, text)| format!("| {key} | {text} |"));
    let wanted: Vec<String> = rows.chain(sources).collect();
    let stale = wanted.iter().any(|row| !document.contains(row.as_str()));
    assert!(!stale, "docs/glass.md must have these rows:\n{}", wanted.join("\n"));
}

#[test]
fn the_example_of_the_document_is_valid() {
    let document = include_str!("../../docs/glass.md");
    let (_, example) = document.split_once("```toml\n").unwrap();
    let (example, _) = example.split_once("```").unwrap();
    let pane = "[glass]\ndistance_m = 0.30\nthickness_m = 0.010\nior = 1.6\n";
    let recipe = Recipe::parse(&PAPER.replacen(pane, example, 1)).unwrap();
    assert_eq!(recipe.glass.glazing.unwrap().0.values.len(), 3);
    assert!(recipe.glass.roughness.is_some() && recipe.glass.outline.is_some());
}

#[test]
fn panes_reflect_what_is_known_of_them() {
    let of = |name: &str| totals(&glazings().by_name[name]);
    // Visible reflectance and transmittance of CLEAR 6MM, GREY 6MM and LoE CLEAR 3MM in EnergyPlus: 0.080 and 0.881, 0.052 and
    // 0.431, 0.056 to 0.079 and 0.850.
    let [reflected, transmitted] = of("single-6");
    assert!((reflected[1] - 0.080).abs() < 0.002 && (transmitted[1] - 0.881).abs() < 0.015);
    let [reflected, transmitted] = of("tinted-grey");
    assert!((reflected[1] - 0.052).abs() < 0.003 && (transmitted[1] - 0.431).abs() < 0.05);
    let mut low_e = glazings().by_name["double-low-e"].clone();
    low_e.layers.truncate(1);
    let [reflected, transmitted] = totals(&low_e);
    assert!((0.056..0.079).contains(&reflected[1]) && (transmitted[1] - 0.85).abs() < 0.04);
    // Without absorption, nothing is lost.
    let [reflected, transmitted] = of("showcase-acrylic");
    assert!((reflected[0] + transmitted[0] - 1.0).abs() < 1e-12);
}
