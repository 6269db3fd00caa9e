//! A bad scene is put aside with its reason; the others are done.

use super::program::{run, run_json, tuples, write};
use glasshouse::sample;
use serde_json::{Value, json};
use std::path::Path;

/// A `.npy` file of 32-bit floats.
fn npy(shape: &[usize], values: &[f32]) -> Vec<u8> {
    let shape: Vec<String> = shape.iter().map(ToString::to_string).collect();
    let mut header = format!(
        "{{'descr': '<f4', 'fortran_order': False, 'shape': ({},), }}",
        shape.join(", ")
    );
    while (header.len() + 11) % 64 != 0 {
        header.push(' ');
    }
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
    bytes
}

fn scene(folder: &Path, id: &str) -> Value {
    let photographs = sample::listing(2, 5);
    let photograph = |index: usize| {
        let p = &photographs[index];
        if !sample::is_written(folder, p) {
            sample::write(folder, p, 160, 120).unwrap();
        }
        json!({
            "color": p.color_path(), "depth": p.depth_path(), "mask": p.mask_path(),
            "intrinsics": sample::intrinsics(160, 120),
        })
    };
    json!({
        "schema": "glasshouse.scene/1", "id": id, "seed": 3,
        "film": { "width": 40, "height": 30, "spp": 16 },
        "camera": { "focal_length_mm": 55.0, "aperture_radius_m": 0.00893, "focus": { "at": "front_center" } },
        "glass": { "distance_m": 0.3, "thickness_m": 0.01, "ior": 1.6 },
        "front": photograph(0), "back": photograph(1),
    })
}

#[test]
fn bad_scenes_are_put_aside_with_their_reasons() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let size = 160 * 120;
    write(
        &here.join("nan.npy"),
        &npy(&[120, 160], &vec![f32::NAN; size]),
    );
    write(
        &here.join("negative.npy"),
        &npy(&[120, 160], &vec![-2.0; size]),
    );
    write(&here.join("near.npy"), &npy(&[120, 160], &vec![0.2; size]));
    write(&here.join("small.npy"), &npy(&[10, 10], &[1.0; 100]));
    write(
        &here.join("nan_color.npy"),
        &npy(&[120, 160, 3], &vec![f32::NAN; size * 3]),
    );
    write(&here.join("empty.png"), b"");
    let good = scene(here, "good");
    let png = std::fs::read(here.join(good["front"]["color"].as_str().unwrap())).unwrap();
    write(&here.join("cut.png"), &png[..png.len() / 2]);

    // What is broken, and words that its reason must hold.
    let cases: [(&str, &[&str], Value, &[&str]); 10] = [
        (
            "missing",
            &["front", "color"],
            json!("nowhere.png"),
            &["nowhere.png", "cannot read"],
        ),
        ("cut", &["front", "color"], json!("cut.png"), &["cut.png"]),
        (
            "empty",
            &["back", "color"],
            json!("empty.png"),
            &["empty.png"],
        ),
        ("nan", &["front", "depth"], json!("nan.npy"), &["nan.npy"]),
        (
            "negative",
            &["back", "depth"],
            json!("negative.npy"),
            &["negative.npy"],
        ),
        (
            "near",
            &["front", "depth"],
            json!("near.npy"),
            &["nearer than the pane", "glass.distance_m"],
        ),
        (
            "mask",
            &["front", "mask"],
            json!("small.npy"),
            &["small.npy"],
        ),
        (
            "radiance",
            &["back", "color"],
            json!("nan_color.npy"),
            &["nan_color.npy"],
        ),
        (
            "steep",
            &["glass", "tilt_deg"],
            json!([0, 84]),
            &["85", "tilt"],
        ),
        ("lens", &["glass", "distance_m"], json!(0.0001), &["lens"]),
    ];
    let mut lines = vec![good.to_string()];
    for (id, path, value, _) in &cases {
        let mut line = scene(here, id);
        line[path[0]][path[1]] = value.clone();
        if *id == "lens" {
            line["glass"]["tilt_deg"] = json!([0, 30]);
        }
        lines.push(line.to_string());
    }
    let manifest = here.join("scenes.jsonl");
    write(&manifest, lines.join("\n").as_bytes());
    let out = here.join("run");
    let (manifest, out_text) = (manifest.to_str().unwrap(), out.to_str().unwrap());

    let (code, object) = run_json(&["run", manifest, "--out", out_text]);
    assert_eq!((code, object["merged"].as_u64()), (3, Some(1)), "{object}");
    assert_eq!(
        object["quarantined"].as_array().unwrap().len(),
        cases.len(),
        "{object}"
    );
    tuples(&out);
    for (id, _, _, words) in &cases {
        let record = std::fs::read_to_string(out.join(format!("quarantine/{id}.json"))).unwrap();
        let record: Value = serde_json::from_str(&record).unwrap();
        let reason = record["reason"].as_str().unwrap();
        println!("{id}: {reason}");
        for word in *words {
            assert!(reason.contains(word), "{id}: {reason:?} lacks {word:?}");
        }
    }
    // Not tried again by itself; tried again when its record is gone and its file is there.
    let (code, object) = run_json(&["work", out_text]);
    assert_eq!(
        (code, object["shards_traced"].as_u64()),
        (3, Some(0)),
        "{object}"
    );
    assert_eq!(run(&["status", out_text]).0, 3);
    write(&here.join("cut.png"), &png);
    std::fs::remove_file(out.join("quarantine/cut.json")).unwrap();
    let (code, object) = run_json(&["work", out_text]);
    assert_eq!((code, object["merged"].as_u64()), (3, Some(1)), "{object}");
}
