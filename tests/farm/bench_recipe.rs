//! `bench recipe` on a small recipe.

use crate::support::outputs::files;
use crate::support::program::{run, text};
use crate::support::scenes::{RECIPE, place};
use serde_json::json;
use std::collections::BTreeSet;

#[test]
fn a_recipe_is_measured_by_feature_and_by_stage() {
    let place = place();
    let waved = "[glass]\nwave = { amplitude_m = 1e-4, length_m = 0.3 }\n";
    std::fs::write(&place.recipe, RECIPE.replace("spp = 256", "spp = 16") + waved).unwrap();
    let bench = |more: &[&str]| {
        let all = [&["bench", "recipe", text(&place.recipe), "--scenes", "3", "--json"], more];
        run(&all.concat()).expect(0).json()
    };
    let found = bench(&["--rounds", "1"]);
    assert_eq!((&found["scenes"], &found["spp"]), (&json!(3), &json!(null)));
    let rows = found["features"].as_array().unwrap();
    let names: Vec<&str> = rows.iter().map(|row| row["features"].as_str().unwrap()).collect();
    assert_eq!(names, ["wave, one glass", "all"]);
    for key in ["over_flat", "over_plain", "worst_over_flat"] {
        assert_eq!(rows[0][key], rows[1][key]);
        assert!(rows[0][key].as_f64().unwrap() > 0.0, "{found}");
    }
    let costs = found["costs"].as_array().unwrap();
    let scenes: Vec<&str> = costs.iter().map(|cost| cost["scene"].as_str().unwrap()).collect();
    // Spread over all splits.
    assert_eq!(scenes, ["train-sample-000000", "train-sample-000001", "train-sample-000002"]);
    assert!(costs.iter().all(|cost| cost["flat"]["error_rms"].as_f64().unwrap() > 0.0));

    let found = bench(&["--by", "stage", "--spp", "4"]);
    let stages = found["stages"].as_array().unwrap();
    let of = |name: &str| {
        let stage = stages.iter().find(|stage| stage["stage"] == name);
        stage.unwrap_or_else(|| panic!("no {name} in {found}"))["cpu_seconds"].as_f64().unwrap()
    };
    for name in ["plan", "read", "decode", "trace", "merge", "encode", "write"] {
        assert!(of(name) > 0.0, "{name}: {found}");
    }
    assert_eq!(files(place.folder.path()).len(), 1, "only the recipe is there");
}

#[test]
fn scenes_that_a_run_quarantines_are_named_and_left_out() {
    let place = place();
    let near = |distance: &str| {
        let pane = format!("[glass]\ndistance_m = {distance}\n");
        std::fs::write(&place.recipe, RECIPE.replace("spp = 256", "spp = 4") + &pane).unwrap();
    };
    let bench = |code: i32, more: &[&str]| {
        let all = [&["bench", "recipe", text(&place.recipe), "--scenes", "4", "--json"], more];
        run(&all.concat()).expect(code)
    };
    // The nearest surfaces of two scenes are at 1.7 and 1.9 m.
    near("{ choice = [0.3, 3.0] }");
    for (more, measured) in [(&["--rounds", "1"][..], "costs"), (&["--by", "stage"], "stages")] {
        let found = bench(0, more).json();
        let refused = found["refused"].as_array().unwrap();
        let names: BTreeSet<&str> =
            refused.iter().map(|one| one["scene"].as_str().unwrap()).collect();
        assert_eq!(names, ["train-sample-000002", "test-sample-000000"].into(), "{found}");
        assert!(refused[0]["reason"].as_str().unwrap().contains("nearer than the pane at 3 m"));
        assert!(!found[measured].as_array().unwrap().is_empty());
        if measured == "costs" {
            assert_eq!(found["features"][0]["scenes"], json!(2));
        }
    }
    near("9.0");
    let all_refused = bench(4, &["--rounds", "1"]);
    assert!(
        all_refused.stderr.contains("no scene can be rendered; the first: train-sample-000000")
    );
}
