//! Exports, report and raw files of scenes with a sensor.

use crate::export::{RECIPE, arguments, content, finished};
use crate::report::report;
use crate::support::outputs::manifest;
use crate::support::program::{Ended, run, text};
use image::GenericImageView;
use std::path::{Path, PathBuf};
use std::process::Command;
use tempfile::TempDir;

fn photographed() -> (TempDir, PathBuf) {
    finished(&RECIPE.replace("[glass]", "[sensor]\nraw = true\n[glass]"))
}

/// Names of the exported photographs, by file of the tuple.
const FILES: [(&str, &str, &str); 3] = [
    ("photo.jpg", "input", "blended"),
    ("photo_transmission.png", "transmission", "transmission_layer"),
    ("photo_glass_reflection.png", "glass_reflection", "reflection_layer"),
];

#[test]
fn photographs_are_exported_in_place_of_layers() {
    let (folder, made) = photographed();
    for format in ["imagefolder", "pairs"] {
        let out = folder.path().join(format);
        let more = ["--format", format, "--encoding", "photograph"];
        run(&arguments(&made, &out, &more)).expect(0);
        for line in manifest(&made) {
            let (scene, split) = (line["id"].as_str().unwrap(), line["split"].as_str().unwrap());
            for (file, layer, pairs) in FILES {
                let name = if format == "pairs" { pairs } else { layer };
                let exported = image::open(out.join(format!("{split}/{name}/{scene}.png")));
                let own = image::open(made.join("tuples").join(scene).join(file)).unwrap();
                assert!(exported.unwrap().to_rgb8() == own.to_rgb8(), "{scene}/{file}");
            }
        }
        let names: Vec<PathBuf> = content(&out).into_keys().collect();
        let has_clean = |path: &PathBuf| path.to_string_lossy().contains("clean_reflection");
        assert!(!names.iter().any(has_clean), "no camera sees R: {names:?}");
    }
    let out = folder.path().join("webdataset");
    let more = ["--format", "webdataset", "--encoding", "photograph"];
    run(&arguments(&made, &out, &more)).expect(0);
    let card = std::fs::read_to_string(out.join("README.md")).unwrap();
    assert!(card.contains("behind a camera with noise and JPEG"), "{card}");
    let exr = folder.path().join("exr");
    let more = ["--format", "exr", "--encoding", "photograph"];
    run(&arguments(&made, &exr, &more)).expect(2).says(&["OpenEXR files hold linear light"]);
    let (_plain, plain) = finished(RECIPE);
    let more = ["--format", "pairs", "--encoding", "photograph"];
    run(&arguments(&plain, &exr, &more)).expect(4).says(&[
        "has no photographs",
        "[sensor]",
        "glasshouse develop",
    ]);
}

#[test]
fn the_report_shows_photographs_beside_the_layers() {
    let (_folder, made) = photographed();
    let (page, _) = report(&made, 0, &[]);
    for line in manifest(&made) {
        let scene = line["id"].as_str().unwrap();
        for (file, layer, _) in FILES {
            assert!(page.contains(&format!("alt=\"{file} of {scene}\"")), "{file}");
            assert!(page.contains(&format!("alt=\"{layer} of {scene}\"")), "{layer}");
        }
        let camera = line["sensor"]["name"].as_str().unwrap();
        assert!(page.contains(&format!("photographed by {camera}")), "{camera}");
    }
    assert!(!page.contains("raw.dng of"));
}

/// LibRaw reads the numbers of the converter, bit for bit, and develops a picture like ours.
#[test]
fn raw_files_are_opened_by_libraw() {
    let recipe = RECIPE.replace("width = 24\nheight = 16", "width = 96\nheight = 64");
    let (_folder, made) = finished(&recipe.replace("[glass]", "[sensor]\nraw = true\n[glass]"));
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/camera/read_raw.py");
    let python = std::env::var_os("GLASSHOUSE_PYTHON").unwrap_or_else(|| "python3".into());
    let Ok(output) = Command::new(python).arg(script).arg(made.join("tuples")).output() else {
        eprintln!("skipped: raw.dng by rawpy: Python is not installed");
        return;
    };
    let ended: Ended = output.into();
    match ended.code {
        Some(0) => eprintln!("read by rawpy: {}", ended.stdout.trim()),
        Some(77) => eprintln!("{}", ended.stdout.trim()),
        _ => panic!("{ended:#?}"),
    }
}

/// `render` writes the photographs and the labels of a scene, too.
#[test]
fn render_writes_photographs_and_labels() {
    let recipe = RECIPE.replace("[glass]", "layers = [\"input\", \"transmission\", \"glass_reflection\", \"coverage\", \"front_depth\", \"ghosts\", \"reflected_share\"]\n[sensor]\n[glass]");
    let (folder, made) = finished(&recipe);
    let tuple = made.join("tuples/train-sample-000000");
    let out = folder.path().join("out");
    let record = tuple.join("tuple.json");
    let call = ["render", text(&record), "--out", text(&out), "--json"];
    let said = run(&call).expect(0).json();
    for (file, ..) in FILES {
        let [again, own] = [out.join(file), tuple.join(file)].map(|p| std::fs::read(p).unwrap());
        assert!(again == own, "{file}");
    }
    assert_eq!(image::open(out.join("photo.jpg")).unwrap().dimensions(), (24, 16));
    assert_eq!(said["photographs"]["sensor_version"], 1);
    let stored =
        render::formats::decode_exr_channels(&std::fs::read(tuple.join("tuple.exr")).unwrap());
    let stored = stored.unwrap();
    for (label, channels) in [
        ("coverage", ["Y"; 3]),
        ("front_depth", ["Z"; 3]),
        ("reflected_share", ["R", "G", "B"]),
        ("ghosts", ["R", "G", "B"]),
    ] {
        let exr = std::fs::read(out.join(format!("{label}.exr"))).unwrap();
        let exr = render::formats::decode_exr_channels(&exr).unwrap();
        for (colour, _) in ["R", "G", "B"].into_iter().zip(channels) {
            let (_, values) = exr.list.iter().find(|(name, _)| name == colour).unwrap();
            // `tuple.exr` has halves, and names the channels of labels after them.
            let of_label: Vec<_> =
                stored.list.iter().filter(|(n, _)| n.starts_with(label)).collect();
            let own = of_label
                .iter()
                .find(|(n, _)| n.ends_with(&format!(".{colour}")))
                .unwrap_or(&of_label[0]);
            for (value, half) in values.iter().zip(&own.1) {
                let same = (value - half).abs() <= 1e-3 * value.abs().max(1e-4);
                assert!(same || value == half, "{label}.{colour}: {value} {half}");
            }
        }
        assert!(said["labels"][label]["mean"].is_number(), "{label}");
    }
}
