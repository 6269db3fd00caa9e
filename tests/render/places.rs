//! Renders photographs in the layout of PLACES365 with relative depth, from folders to tuples.

use crate::support::outputs::{files, tuple_record, tuples};
use crate::support::program::{run, text};
use serde_json::Value;
use std::path::Path;

const RECIPE: &str = r#"
schema = "glasshouse.recipe/1"
name = "places"
seed = 3
[film]
width = 48
height = 48
spp = 16
[sources.places]
layout = "places"
depth_ranges = "ranges.toml"
depth_kind = "relative_inverse"
intrinsics = { fx = 0.866, fy = 0.866, cx = 0.5, cy = 0.5, size = [1, 1] }
[[split]]
name = "train"
pairs = { places = 3 }
[[split]]
name = "test"
pairs = { places = 1 }
"#;

const RANGES: &str = r#"
schema = "glasshouse.depth_ranges/1"
[category.bedroom]
place = "indoors"
range = { mean_m = 4.0 }
why = "the paper's example"
[category."market/outdoor"]
place = "outdoor"
range = { near_m = 4.0, far_m = 40.0 }
why = "a guess"
"#;

/// Copies photographs of `sample` to folders like those of PLACES365, with scaled and shifted inverse depth.
fn places(folder: &Path) {
    let made = folder.join("made");
    let size = ["--width", "64", "--height", "64"];
    let mut arguments = vec!["sample", text(&made), "--count", "8"];
    arguments.extend(size);
    run(&arguments).expect(0);
    for (number, path) in files(&made).into_iter().enumerate() {
        if path.extension().is_none_or(|e| e != "png") {
            continue;
        }
        let category = if path.to_string_lossy().contains("indoors") {
            "data_256/b/bedroom"
        } else {
            "data_256/m/market/outdoor"
        };
        let depth = path.to_string_lossy().replace(".png", "_depth.npy");
        let mut npy = std::fs::read(made.join(depth)).unwrap();
        let start = npy.len() - 64 * 64 * 4;
        for bytes in npy[start..].as_chunks_mut::<4>().0 {
            let z = f32::from_le_bytes(*bytes);
            let inverse = if z > 0.0 { 1.0 / z } else { 0.0 };
            *bytes = (700.0 * inverse - 30.0).to_le_bytes();
        }
        let put = |root: &str, ending: &str, bytes: &[u8]| {
            let path = folder.join(root).join(category).join(format!("{number:08}{ending}"));
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, bytes).unwrap();
        };
        put("places", ".png", &std::fs::read(made.join(&path)).unwrap());
        put("places-depth", "-dpt_large_384.npy", &npy);
    }
    // A photograph of an unlisted category, and one without depth.
    let kitchen = folder.join("places/data_256/k/kitchen");
    std::fs::create_dir_all(&kitchen).unwrap();
    std::fs::write(kitchen.join("00000001.jpg"), b"").unwrap();
    let alone = folder.join("places/data_256/b/bedroom/99999999.jpg");
    std::fs::write(alone, b"").unwrap();
    std::fs::write(folder.join("recipe.toml"), RECIPE).unwrap();
    std::fs::write(folder.join("ranges.toml"), RANGES).unwrap();
}

#[test]
fn photographs_of_places_become_tuples() {
    let folder = tempfile::tempdir().unwrap();
    places(folder.path());
    let recipe = folder.path().join("recipe.toml");
    let plan = |out: &str| {
        let out = folder.path().join(out);
        let planned = run(&["plan", text(&recipe), "--out", text(&out), "--json"]);
        let planned = planned.expect(0).json();
        assert_eq!(planned["scenes"], 4);
        let notes = planned["notes"].to_string();
        assert!(notes.contains("1 images have no depth"), "{notes}");
        std::fs::read_to_string(out.join("manifest.jsonl")).unwrap()
    };
    let manifest = plan("run");
    assert_eq!(manifest, plan("again"));
    for line in manifest.lines() {
        let line: Value = serde_json::from_str(line).unwrap();
        // One side is indoors, and the other is outdoors.
        let sides = [&line["front"], &line["back"]];
        let indoors = sides.iter().filter(|s| s["color"].as_str().unwrap().contains("bedroom"));
        assert_eq!(indoors.count(), 1, "{line}");
        for side in sides {
            assert!(side["depth"].as_str().unwrap().starts_with("places-depth:data_256/"));
            let key = if side["color"].as_str().unwrap().contains("bedroom") {
                "mean_m"
            } else {
                "far_m"
            };
            assert!(side["depth_range"][key].is_number(), "{side}");
        }
    }
    let out = folder.path().join("run");
    run(&["work", text(&out), "-q"]).expect(0);
    assert_eq!(tuples(&out).len(), 4 * 6);
    let record = tuple_record(&out, "test-places-000000");
    let relative = record["facts"]["relative_depth"].as_object().unwrap();
    for (name, ends) in relative {
        let [near, far] = ["near_m", "far_m"].map(|key| ends[key].as_f64().unwrap());
        assert!(
            (0.5..5.0).contains(&near) && (8.0 * near..40.1).contains(&(far + 1e-9)),
            "{name}: {ends}"
        );
        assert!(ends["clamped_share"].as_f64().unwrap() < 0.06, "{ends}");
    }
    assert_eq!(relative.len(), 2);
}

#[test]
fn missing_inputs_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    places(folder.path());
    let recipe = folder.path().join("recipe.toml");
    let plan = || run(&["plan", text(&recipe), "-n"]);
    std::fs::write(folder.path().join("ranges.toml"), RANGES.replace("4.0 }", "-4.0 }")).unwrap();
    plan().expect(4).says(&["ranges.toml", "category.bedroom.range.mean_m is -4"]);
    std::fs::write(folder.path().join("ranges.toml"), RANGES).unwrap();
    std::fs::rename(folder.path().join("places-depth"), folder.path().join("elsewhere")).unwrap();
    plan().expect(4).says(&["--root places-depth=DIR"]);
    let root = format!("places-depth={}", folder.path().join("elsewhere").display());
    run(&["plan", text(&recipe), "-n", "--root", &root]).expect(0);
}
