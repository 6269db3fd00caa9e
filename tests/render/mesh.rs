//! Renders scenes with triangle meshes, from PLY files to tuples.

use crate::support::outputs::{exr_channels, files, quarantine_reason, tuple_record};
use crate::support::program::{run, text};
use crate::support::scenes::{photographs, scene, write_lines};
use serde_json::{Value, json};
use std::path::Path;

/// Makes a room of six walls around the lens with a step inside, as a binary PLY: mm, y up, quads, uchar colours.
fn room() -> Vec<u8> {
    let boxes = [
        ([-1500.0, -1000.0, -4000.0], [1500.0, 1200.0, 1000.0]),
        ([-400.0, -1000.0, -3000.0], [500.0, -200.0, -2000.0]),
    ];
    let mut vertices: Vec<u8> = vec![];
    let mut faces: Vec<u8> = vec![];
    let mut count = 0u32;
    for (index, (low, high)) in boxes.into_iter().enumerate() {
        for axis in 0..3 {
            for (side, at) in [low, high].into_iter().enumerate() {
                for corner in [[0, 0], [1, 0], [1, 1], [0, 1]] {
                    let mut point = [0f32; 3];
                    point[axis] = at[axis];
                    for k in 0..2 {
                        let other = (axis + 1 + k) % 3;
                        point[other] = [low, high][corner[k]][other];
                    }
                    vertices.extend(point.iter().flat_map(|v| v.to_le_bytes()));
                    let shade = 60 + 40 * axis as u8 + 30 * side as u8;
                    vertices.extend([shade, 200 - 90 * index as u8, 255 - shade]);
                }
                faces.push(4);
                faces.extend((count..count + 4).flat_map(u32::to_le_bytes));
                count += 4;
            }
        }
    }
    let mut ply = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {count}\nproperty float x\nproperty float y\nproperty \
         float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nelement face {}\nproperty list uchar \
         uint vertex_indices\nend_header\n",
        count / 4
    )
    .into_bytes();
    ply.extend(vertices);
    ply.extend(faces);
    ply
}

/// Makes a side with the mesh `file` of the room, converted to metres, y down and z ahead.
fn mesh(file: &str) -> Value {
    json!({
        "mesh": file, "unit_m": 0.001,
        "pose": {"rotation": [[1, 0, 0], [0, -1, 0], [0, 0, -1]]},
    })
}

fn with(id: &str, sides: &[(&str, Value)]) -> Value {
    let mut scene = scene(id);
    for (side, value) in sides {
        scene[side] = value.clone();
    }
    scene
}

fn render(folder: &Path, scene: &Value) -> (Value, Vec<f32>) {
    let id = scene["id"].as_str().unwrap();
    let path = folder.join(format!("{id}.json"));
    let out = folder.join(format!("out-{id}"));
    std::fs::write(&path, scene.to_string()).unwrap();
    let ended = run(&["render", text(&path), "--out", text(&out), "--json"]).expect(0);
    let channels = exr_channels(&out.join("input.exr"));
    let bits = ["R", "G", "B"].map(|c| channels[c].1.clone()).concat();
    (ended.json(), bits.into_iter().map(f32::from_bits).collect())
}

#[test]
fn meshes_render_on_either_side() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    photographs(folder);
    std::fs::write(folder.join("room.ply"), room()).unwrap();
    let mut back = mesh("room.ply");
    back["apex"] = json!("camera");
    back["exposure"] = json!(2.0);
    for (id, sides) in [
        ("front", vec![("front", mesh("room.ply"))]),
        ("back", vec![("back", back.clone())]),
        ("both", vec![("front", mesh("./room.ply")), ("back", back)]),
    ] {
        let (record, input) = render(folder, &with(id, &sides));
        assert!(input.iter().all(|v| v.is_finite() && *v >= 0.0));
        let mean = input.iter().sum::<f32>() / input.len() as f32;
        assert!(mean > 0.02, "{id}: {mean}");
        // Twelve quads are 24 triangles; the two triangles of the rear wall are behind the lens.
        let facts = &record["facts"];
        for side in ["front", "back"] {
            let is_mesh = sides.iter().any(|(name, _)| *name == side);
            let expected = json!({"traced": 22, "degenerate": 0, "behind": 2});
            assert_eq!(facts["meshes"].get(side).is_some(), is_mesh, "{record:#}");
            if is_mesh {
                assert_eq!(facts["meshes"][side], expected);
                assert_eq!(facts["filled_share"][side], 0.0);
            }
        }
        if id != "back" {
            // The axis misses the step's face, 2 m ahead, and hits the far wall.
            let focus_m = facts["focus_distance_m"].as_f64().unwrap();
            assert!((focus_m - 4.0).abs() < 1e-6, "{focus_m}");
            // The room is closed, so every path of the front hits it.
            assert_eq!(record["layers"]["transmission"]["miss_share"], 0.0);
        }
    }
}

#[test]
fn a_run_renders_meshes_and_quarantines_bad_ones() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    photographs(folder);
    let room = room();
    std::fs::write(folder.join("room.ply"), &room).unwrap();
    // These files are good when the run is planned.
    std::fs::write(folder.join("torn.ply"), &room).unwrap();
    std::fs::write(folder.join("image.ply"), &room).unwrap();
    std::fs::copy(folder.join("a.png"), folder.join("room.png")).unwrap();
    let mut nan = room.clone();
    let body = nan.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    nan[body + 4..body + 8].copy_from_slice(&f32::NAN.to_le_bytes());
    std::fs::write(folder.join("nan.ply"), nan).unwrap();
    let mut behind = mesh("room.ply");
    behind["pose"]["translation_m"] = json!([0.0, 0.0, -5.0]);
    // The far wall is 0.2 m ahead, nearer than the pane.
    let mut near = mesh("room.ply");
    near["unit_m"] = json!(0.00005);
    let mut aside = mesh("room.ply");
    aside["pose"]["translation_m"] = json!([3.0, 0.0, 0.0]);
    let bad = [
        (
            with("torn", &[("front", mesh("torn.ply"))]),
            vec!["torn.ply", "as PLY", "fetch it again"],
        ),
        (
            with("nan", &[("back", mesh("nan.ply"))]),
            vec!["nan.ply", "vertex 0 has NaN as y", "repair"],
        ),
        (
            with("image", &[("back", mesh("image.ply"))]),
            vec!["image.ply is a PNG file", "give a PLY mesh"],
        ),
        (
            with("behind", &[("back", behind)]),
            vec!["back mesh", "in front of the lens", "room.ply"],
        ),
        (
            with("near", &[("front", near)]),
            vec!["front mesh", "nearer than the pane", "front.unit_m"],
        ),
        (with("aside", &[("front", aside)]), vec!["front_center", "does not meet", "distance_m"]),
        (
            {
                let mut scene = scene("color");
                scene["front"]["color"] = json!("room.png");
                scene
            },
            vec!["room.png is a PLY mesh", "in place of color and depth"],
        ),
    ];
    let mut lines: Vec<Value> = bad.iter().map(|(line, _)| line.clone()).collect();
    lines.insert(2, with("good", &[("front", mesh("room.ply"))]));
    let manifest = folder.join("scenes.jsonl");
    write_lines(&manifest, &lines);
    let out = folder.join("run");
    run(&["plan", text(&manifest), "--out", text(&out)]).expect(0);
    std::fs::write(folder.join("torn.ply"), &room[..room.len() / 2]).unwrap();
    std::fs::copy(folder.join("a.png"), folder.join("image.ply")).unwrap();
    std::fs::write(folder.join("room.png"), &room).unwrap();
    run(&["plan", text(&manifest), "--out", text(&out), "-n"]).expect(0).says(&[
        "3 of 11 input files",
        "manifest:torn.ply",
        "manifest:image.ply",
        "manifest:room.png",
    ]);
    let ended = run(&["run", text(&manifest), "--out", text(&out), "--json"]).expect(3);
    assert_eq!(ended.json()["merged"], 1);
    assert_eq!(files(&out.join("tuples/good")).len(), 6);
    let tuple = tuple_record(&out, "good");
    let digest = blake3::hash(&room).to_hex().to_string();
    assert_eq!(tuple["inputs"]["front.mesh"], json!(digest));
    assert_eq!(tuple["scene"]["front"]["mesh"], "manifest:room.ply");
    assert!(tuple["facts"]["meshes"]["front"].is_object());
    for (line, words) in &bad {
        let id = line["id"].as_str().unwrap();
        let reason = quarantine_reason(&out, id);
        for word in words {
            assert!(reason.contains(word), "{id}: no {word:?} in {reason}");
        }
    }

    // A combination of incompatible keys is an error of the manifest.
    let mut mixed = scene("mixed");
    mixed["front"]["mesh"] = json!("room.ply");
    write_lines(&manifest, &[mixed]);
    run(&["plan", text(&manifest), "--out", text(&folder.join("no"))])
        .expect(4)
        .says(&["a side with `mesh`: unknown field `color`", "line 1"]);
}
