//! Runs recipes over a list of photographs and panoramas, from files to tuples.

use crate::support::outputs::{manifest, tuple_record};
use crate::support::program::{run, text};
use crate::support::scenes::photographs;
use serde_json::{Value, json};
use std::io::Write;
use std::path::Path;

const RECIPE: &str = r#"
schema = "glasshouse.recipe/1"
name = "list"
seed = 3
[film]
width = 48
height = 48
spp = 16
[glass]
tilt_deg = [0, { uniform = [-15, 15] }]
[front]
exposure = 0.5
[sources.mine]
layout = "list"
list = "photographs.jsonl"
[[split]]
name = "train"
pairs = { mine = 6 }
"#;

/// Writes an uncompressed Radiance HDR panorama of 64 x 32 px: red increases to the right; the sun's radiance is 40.
fn panorama(path: &Path) {
    let mut bytes = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 32 +X 64\n".to_vec();
    for at in 0..64 * 32u32 {
        let (x, y) = ((at % 64) as u8, at / 64);
        // Each value is mantissa / 256 * 2^(exponent - 128).
        bytes.extend(if (x, y) == (32, 16) {
            [160, 160, 160, 134]
        } else {
            [100 + 2 * x, 128, 100, 128]
        });
    }
    std::fs::File::create(path).unwrap().write_all(&bytes).unwrap();
}

fn list(folder: &Path) -> Vec<Value> {
    let photos = folder.join("mine");
    std::fs::create_dir(&photos).unwrap();
    photographs(&photos);
    panorama(&photos.join("sky.hdr"));
    let intrinsics =
        json!({ "fx": 886.81, "fy": 927.06, "cx": 512, "cy": 384, "size": [1024, 768] });
    let photograph = |name: &str, place: &str, more: Value| {
        let mut line = json!({
            "schema": "glasshouse.photograph/1", "place": place, "color": format!("{name}.png"),
            "depth": format!("{name}_depth.npy"), "mask": format!("{name}_depth_mask.npy"), "intrinsics": intrinsics,
        });
        line.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        line
    };
    vec![
        photograph("a", "indoors", json!({ "highlights": { "above": 0.5, "to": 6.0 } })),
        photograph(
            "b",
            "indoors",
            json!({ "scan": "b", "exposure": 2.0, "values": { "camera.f_number": 2 } }),
        ),
        json!({
            "schema": "glasshouse.photograph/1", "place": "outdoor", "panorama": "sky.hdr", "transfer": "linear",
            "yaw_deg": 40, "depth_m": 20,
        }),
    ]
}

fn write(folder: &Path, lines: &[Value]) {
    let text: Vec<String> = lines.iter().map(Value::to_string).collect();
    std::fs::write(folder.join("photographs.jsonl"), text.join("\n")).unwrap();
    std::fs::write(folder.join("recipe.toml"), RECIPE).unwrap();
}

#[test]
fn a_list_of_photographs_and_a_panorama_becomes_tuples() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), &list(folder.path()));
    let (recipe, out) = (folder.path().join("recipe.toml"), folder.path().join("run"));
    run(&["run", text(&recipe), "--out", text(&out), "--json"]).expect(0);
    let lines = manifest(&out);
    let (mut fronts, mut backs) = (0, 0);
    for line in &lines {
        let tuple = tuple_record(&out, line["id"].as_str().unwrap());
        for (name, side, other) in [("front", &mut fronts, "back"), ("back", &mut backs, "front")] {
            if line[name]["panorama"] != "mine:sky.hdr" {
                continue;
            }
            *side += 1;
            // A scene has an indoor and an outdoor side, with the values of the list.
            let exposure = if name == "front" { 0.5 } else { 1.0 };
            assert_eq!(line[name]["exposure"], exposure);
            assert_eq!(line[name]["yaw_deg"], 40.0);
            assert_eq!(tuple["inputs"][format!("{name}.panorama")].as_str().unwrap().len(), 64);
            assert_eq!(tuple["inputs"][format!("{name}.depth")], Value::Null);
            let color = line[other]["color"].as_str().unwrap();
            let base = if other == "front" { 0.5 } else { 1.0 };
            let listed = if color == "mine:b.png" { 2.0 } else { 1.0 };
            assert_eq!(line[other]["exposure"], base * listed, "{line}");
            let is_expanded = color == "mine:a.png";
            assert_eq!(line[other]["highlights"].is_object(), is_expanded);
            let brightest = tuple["facts"]["max_radiance"][other].as_f64().unwrap();
            assert!(brightest <= base * listed * if is_expanded { 6.0 } else { 1.0 });
            assert!(!is_expanded || brightest > base, "{brightest}");
        }
        let misses = tuple["layers"]["clean_reflection"]["miss_share"].as_f64().unwrap();
        assert!(line["back"]["panorama"].is_null() || misses == 0.0, "{misses}");
    }
    assert_eq!((fronts, backs), (3, 3), "{lines:#?}");
}

#[test]
fn planning_finds_mistakes_in_a_list() {
    let folder = tempfile::tempdir().unwrap();
    let good = list(folder.path());
    let recipe = folder.path().join("recipe.toml");
    let plan = |lines: &[Value], words: &[&str]| {
        write(folder.path(), lines);
        let out = folder.path().join("run");
        let planned = run(&["plan", "-n", text(&recipe), "--out", text(&out)]);
        planned.expect(4).says(words);
    };
    let with = |key: &str, value: Value| {
        let mut lines = good.clone();
        lines[1][key] = value;
        lines
    };
    plan(&with("color", json!("c.png")), &["mine:c.png"]);
    plan(&with("mask", json!("sky.hdr")), &["mine:sky.hdr", "Radiance HDR"]);
    let mut lines = good.clone();
    lines[2]["panorama"] = json!("a.png");
    lines[2].as_object_mut().unwrap().remove("transfer");
    lines[0]["color"] = json!("b.png");
    lines.remove(1);
    plan(&lines, &["mine:a.png", "twice as wide as high"]);
    plan(
        &with("colour", json!("b.png")),
        &["photographs.jsonl", "line 2: a side with `color`: unknown field `colour`"],
    );
    plan(&with("place", json!("garden")), &["line 2: unknown variant `garden`"]);
    plan(&with("color", good[0]["color"].clone()), &["source mine lists a.png twice"]);
}
