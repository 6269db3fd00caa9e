//! Bad scenes go into quarantine with a reason that names the file and a remedy; the other scenes are rendered.

use crate::support::outputs::{files, quarantine_reason};
use crate::support::program::{run, text};
use crate::support::scenes::{npy, photographs, scene, write_lines};
use serde_json::{Value, json};
use std::path::Path;

/// Writes good files before planning (`is_done` is false), and damages or removes them afterwards.
fn damage(folder: &Path, is_done: bool) {
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.join(name), bytes).unwrap();
    let png = std::fs::read(folder.join("a.png")).unwrap();
    if !is_done {
        for name in ["nowhere.png", "torn.png", "empty.png"] {
            write(name, &png);
        }
        write("small_mask.npy", &npy("(48, 64)", &[1.0; 48 * 64]));
        return;
    }
    std::fs::remove_file(folder.join("nowhere.png")).unwrap();
    write("torn.png", &png[..png.len() / 2]);
    write("empty.png", b"");
    write("small_mask.npy", &npy("(24, 32)", &[1.0; 24 * 32]));
}

/// Writes bad files, and returns bad scenes, each with words that the reason of its quarantine must contain.
fn bad_scenes(folder: &Path) -> Vec<(Value, Vec<&'static str>)> {
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.join(name), bytes).unwrap();
    let depth = |value: f32| npy("(48, 64)", &[value; 48 * 64]);
    write("nan_depth.npy", &depth(f32::NAN));
    write("negative_depth.npy", &depth(-2.0));
    write("near_depth.npy", &depth(0.1));
    let mut radiance = vec![0.5; 48 * 64 * 3];
    radiance[3 * 65 + 1] = f32::NAN;
    write("nan.npy", &npy("(48, 64, 3)", &radiance));

    let with = |id: &str, side: &str, key: &str, value: Value| {
        let mut scene = scene(id);
        scene[side][key] = value;
        scene
    };
    let without_mask = |id: &str, side: &str, depth: &str| {
        let mut scene = with(id, side, "depth", json!(depth));
        scene[side].as_object_mut().unwrap().remove("mask");
        scene
    };
    vec![
        (
            with("missing", "back", "color", json!("nowhere.png")),
            vec!["nowhere.png", "check the path"],
        ),
        (with("torn", "front", "color", json!("torn.png")), vec!["torn.png", "fetch it again"]),
        (
            with("empty", "front", "color", json!("empty.png")),
            vec!["empty.png", "is empty", "fetch it again"],
        ),
        (
            without_mask("nan", "front", "nan_depth.npy"),
            vec!["nan_depth.npy", "check depth_unit_m"],
        ),
        (
            without_mask("negative", "back", "negative_depth.npy"),
            vec!["negative_depth.npy", "check depth_unit_m"],
        ),
        (
            with("mask", "front", "mask", json!("small_mask.npy")),
            vec!["small_mask.npy", "32x24", "64x48", "give a mask of the depth's size"],
        ),
        (
            without_mask("near", "back", "near_depth.npy"),
            vec!["b.png", "nearer than the pane", "move the pane nearer"],
        ),
        (with("grazing", "glass", "tilt_deg", json!([0.0, 80.0])), vec!["a.png", "85", "tilt"]),
        (
            with("radiance", "front", "color", json!("nan.npy")),
            vec!["nan.npy", "NaN", "column 1, row 1", "repair the file"],
        ),
    ]
}

#[test]
fn bad_scenes_are_quarantined_and_good_ones_rendered() {
    let folder = tempfile::tempdir().unwrap();
    photographs(folder.path());
    let bad = bad_scenes(folder.path());
    let mut lines: Vec<Value> = bad.iter().map(|(line, _)| line.clone()).collect();
    lines.insert(4, scene("good"));
    let manifest = folder.path().join("scenes.jsonl");
    write_lines(&manifest, &lines);
    let out = folder.path().join("run");
    damage(folder.path(), false);
    run(&["plan", text(&manifest), "--out", text(&out)]).expect(0);
    damage(folder.path(), true);
    let ended = run(&["run", text(&manifest), "--out", text(&out), "--json"]).expect(3);
    assert_eq!(ended.json()["merged"], 1);
    assert_eq!(ended.json()["quarantined"].as_array().unwrap().len(), bad.len());
    assert_eq!(files(&out.join("tuples/good")).len(), 6);
    for (line, words) in &bad {
        let id = line["id"].as_str().unwrap();
        let reason = quarantine_reason(&out, id);
        for word in words {
            assert!(reason.contains(word), "{id}: no {word:?} in {reason}");
        }
        assert!(ended.stderr.contains(id), "{id} in {}", ended.stderr);
        assert!(!out.join("tuples").join(id).exists());
    }

    // A second run reports the same scenes without an attempt, although a missing file exists again.
    std::fs::copy(folder.path().join("b.png"), folder.path().join("nowhere.png")).unwrap();
    let status = run(&["status", text(&out), "--json"]).expect(3).json();
    assert_eq!(status["merged"], 1);
    assert_eq!(status["finished"], true);
    assert_eq!(status["quarantined"].as_array().unwrap().len(), bad.len());
    let again = run(&["work", text(&out), "--json"]).expect(3).json();
    assert_eq!(again["merged"], 0);
    assert_eq!(again["shards_traced"], 0);

    // Without its quarantine record, the repaired scene is rendered.
    std::fs::remove_file(out.join("quarantine/missing.json")).unwrap();
    let again = run(&["work", text(&out), "--json"]).expect(3).json();
    assert_eq!(again["merged"], 1);
    assert_eq!(files(&out.join("tuples/missing")).len(), 6);
}

#[test]
fn a_damaged_record_keeps_its_scene_in_quarantine() {
    let folder = tempfile::tempdir().unwrap();
    photographs(folder.path());
    let manifest = folder.path().join("scenes.jsonl");
    write_lines(&manifest, &[scene("one")]);
    let out = folder.path().join("run");
    run(&["plan", text(&manifest), "--out", text(&out)]).expect(0);
    std::fs::create_dir(out.join("quarantine")).unwrap();
    for damage in [&b"{\"schema\""[..], b"", b"\xff\xfe\x00"] {
        std::fs::write(out.join("quarantine/one.json"), damage).unwrap();
        let ended = run(&["work", text(&out), "--json"]).expect(3).json();
        let reason = ended["quarantined"][0]["reason"].as_str().unwrap();
        assert!(reason.contains("delete it to try again"), "{reason}");
    }
    std::fs::remove_file(out.join("quarantine/one.json")).unwrap();
    run(&["work", text(&out)]).expect(0);
}
