//! Tests the comparison of renderings and mixtures with a camera's pictures.

use crate::support::program::{run, text};
use crate::support::scenes::{photographs, scene};
use render::formats::encode_rgb_exr;
use serde_json::Value;
use std::path::Path;

/// Returns the PSNRs of a method in a row: of the picture, and after its own factor, dB.
fn psnrs_db(rows: &Value, method: &str) -> [f64; 2] {
    let rows = rows.as_array().unwrap();
    let row = rows.iter().find(|row| row["method"] == method).unwrap();
    ["raw", "after_factor"].map(|of| row[of]["psnr_colour_db"].as_f64().unwrap())
}

/// Makes the folder `name` with the scene of the photographs in `folder`, without a camera's picture.
fn capture(folder: &Path, name: &str, line: &Value) -> std::path::PathBuf {
    let capture = folder.join("captures").join(name);
    std::fs::create_dir_all(&capture).unwrap();
    let mut line = line.clone();
    for side in ["front", "back"] {
        for key in ["color", "depth", "mask"] {
            line[side][key] = format!("../../{}", line[side][key].as_str().unwrap()).into();
        }
    }
    std::fs::write(capture.join("scene.json"), line.to_string()).unwrap();
    capture
}

#[test]
fn another_rendering_stands_for_the_camera() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    photographs(folder);
    let mut line = scene("one");
    line["film"] = serde_json::json!({"width": 64, "height": 48, "spp": 16});
    line["seed"] = 6.into();
    std::fs::write(folder.join("camera.json"), line.to_string()).unwrap();
    let out = folder.join("out");
    let camera = folder.join("camera.json");
    run(&["render", text(&camera), "--out", text(&out), "--spp", "1024"]).expect(0);
    line["seed"] = 5.into();
    // One scene has the camera's picture in codes, one in linear light.
    for (name, from, to) in
        [("coded", "input.png", "captured.png"), ("linear", "input.exr", "captured.exr")]
    {
        let capture = capture(folder, name, &line);
        std::fs::copy(out.join(from), capture.join(to)).unwrap();
    }
    let captures = folder.join("captures");
    let of = |more: &[&str]| {
        run(&[&["similarity", text(&captures), "--json", "--draws", "20"][..], more].concat())
    };
    let json = of(&[]).expect(0).json();
    assert_eq!(json["schema"], "glasshouse.similarity/1");
    assert_eq!((&json["draws"], &json["seed"]), (&20.into(), &2020.into()));
    let scenes = json["scenes"].as_array().unwrap();
    assert_eq!((&scenes[0]["scene"], &scenes[0]["spp"]), (&"coded".into(), &16.into()));
    // Both pictures of the camera have the same codes.
    assert_eq!(scenes[0]["rows"], scenes[1]["rows"]);
    let [ours_db, ours_after_db] = psnrs_db(&json["rows"], "ours");
    assert!(ours_db > 35.0 && ours_after_db >= ours_db, "{json}");
    for method in ["transmission alone", "CEILNet", "Zhang et al."] {
        let [raw_db, after_db] = psnrs_db(&json["rows"], method);
        assert!(after_db >= raw_db && ours_db > after_db + 5.0, "{method}: {json}");
    }
    // Draws depend on the seed, but not on threads. More draws are at least as good.
    assert_eq!(of(&["-j", "1"]).expect(0).json()["scenes"], json["scenes"]);
    let draws = |count: &str, seed: &str| {
        let typed = ["similarity", text(&captures), "--json", "--draws", count, "--seed", seed];
        run(&typed).expect(0).json()["rows"].clone()
    };
    let [of_40, of_20, other] = [draws("40", "2020"), draws("20", "2020"), draws("20", "7")];
    assert_eq!(of_20, json["rows"]);
    assert_ne!(other, of_20);
    for method in ["CEILNet", "Zhang et al."] {
        assert!(psnrs_db(&of_40, method)[1] >= psnrs_db(&of_20, method)[1]);
    }
    let planned = of(&["-n"]).expect(0).json();
    assert_eq!(
        (planned["dry_run"].as_bool(), &planned["rows"]),
        (Some(true), &Value::Array(vec![]))
    );
    let shown = run(&["similarity", text(&captures), "--draws", "2", "--spp", "4"]).expect(0);
    for part in ["2 scenes; mixtures: best of 2 draws", "| ours ", "| linear |"] {
        assert!(shown.stdout.contains(part), "{shown:?}");
    }
}

#[test]
fn unusable_folders_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    photographs(folder);
    let captures = folder.join("captures");
    std::fs::create_dir_all(captures.join("a-empty")).unwrap();
    let line = scene("one");
    capture(folder, "b-no-picture", &line);
    let both = capture(folder, "c-both", &line);
    let size = capture(folder, "d-size", &line);
    let mut large = line.clone();
    large["film"] = serde_json::json!({"width": 600, "height": 24, "spp": 1});
    let large = capture(folder, "e-large", &large);
    for path in [both.join("captured.png"), both.join("captured.exr"), size.join("captured.png")] {
        std::fs::copy(folder.join("a.png"), path).unwrap();
    }
    image::RgbImage::new(600, 24).save(large.join("captured.png")).unwrap();
    let similarity = || run(&["similarity", text(&captures), "--json", "--draws", "1"]);
    let refused = similarity().expect(4);
    assert!(refused.json()["error"].as_str().unwrap().contains("captured.exr"), "{refused:?}");

    let sound = capture(folder, "f-sound", &line);
    image::RgbImage::from_pixel(40, 24, image::Rgb([90; 3]))
        .save(sound.join("captured.png"))
        .unwrap();
    let json = similarity().expect(3).json();
    let left_out = json["left_out"].as_array().unwrap();
    let expected = [
        ("a-empty", "scene.json"),
        ("b-no-picture", "neither captured.png nor captured.exr"),
        ("c-both", "remove one of them"),
        ("d-size", "captured.png has 64 x 48 px, but the film of scene.json has 40 x 24 px"),
        ("e-large", "600 x 24 px are too many for Zhang's mixtures"),
    ];
    assert_eq!(left_out.len(), expected.len(), "{json}");
    for (found, (name, reason)) in left_out.iter().zip(expected) {
        let text = found["reason"].as_str().unwrap();
        assert!(found["scene"] == name && text.contains(reason), "{found}");
        assert!(text.contains(name), "{found}");
    }
    assert_eq!(json["scenes"].as_array().unwrap().len(), 1);
}

/// Compares with the picture of an independent renderer, which stands for the camera.
#[test]
fn an_independent_renderer_stands_for_the_camera() {
    let oracle = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/oracle/mitsuba");
    if !oracle.join("scene.json").is_file() {
        eprintln!("skipped: no reference images at {}", oracle.display());
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let capture = folder.path().join("mitsuba");
    std::fs::create_dir_all(capture.join("inputs")).unwrap();
    std::fs::copy(oracle.join("scene.json"), capture.join("scene.json")).unwrap();
    for name in ["front_rgb.png", "back_rgb.png", "front_depth.npy", "back_depth.npy"] {
        let name = Path::new("inputs").join(name);
        std::fs::copy(oracle.join(&name), capture.join(&name)).unwrap();
    }
    let bytes = std::fs::read(oracle.join("ref_input.npy")).unwrap();
    let values = npyz::NpyFile::new(&bytes[..]).unwrap().into_vec::<f32>().unwrap();
    let pixels: Vec<[f32; 3]> = values.chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect();
    let exr = encode_rgb_exr(&pixels, 256, 256).unwrap();
    std::fs::write(capture.join("captured.exr"), exr).unwrap();
    let ended = run(&["similarity", text(folder.path()), "--spp", "64", "--json"]).expect(0);
    let json = ended.json();
    let [ours_db, _] = psnrs_db(&json["rows"], "ours");
    eprintln!("ours: {ours_db:.2} dB");
    assert!(ours_db > 40.0, "{json}");
    for method in ["CEILNet", "Zhang et al."] {
        let [raw_db, after_db] = psnrs_db(&json["rows"], method);
        eprintln!("{method}: {raw_db:.2} dB, {after_db:.2} dB after the own factor");
        assert!(ours_db > after_db + 10.0, "{method}: {json}");
    }
}
