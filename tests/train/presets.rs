//! Tests the settings and weights of published trainings.

use crate::support::program::{run, text};
use crate::training::place;
use std::path::Path;
use std::process::Command;

/// Weights of a VGG-19 whose widths are those published divided by 32.
fn features() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/train/step.safetensors")
}

#[test]
fn a_preset_replaces_the_defaults() {
    let (place, features) = (place(), features());
    let run_folder = text(&place.run);
    let train = |stage: &str, steps: &str, more: &str, code: i32| {
        let mut words = vec!["train", run_folder, "--stage", stage, "--steps", steps, "--json"];
        words.extend(more.split_whitespace());
        run(&words).expect(code)
    };
    let small = "--width 4 --crop 40 --discriminator-width 2 --vgg-divisor 32";
    let code = format!("--preset kim2020-code {small}");
    train("backtrack", "2", &code, 4).says(&["--features FILE"]);
    let file = format!("--features {}", text(&features));
    let settings = train("backtrack", "2", &format!("{code} {file}"), 0).json()["settings"].clone();
    let expected = serde_json::json!({
        "features": "file",
        "feature_style": "caffe",
        "pixel_weight": 52.0,
        "feature_weight": 0.2,
        "adversarial_weight": 0.01,
        "learning_rate": 2e-4,
        "discriminator_learning_rate": 1e-4,
        "vgg_divisor": 32,
    });
    for (name, expected) in expected.as_object().unwrap() {
        assert_eq!(settings[name], *expected, "{name}");
    }
    // The second stage takes over the settings. Rates are free, and the other preset is not.
    let taken = train("separation", "1", &file, 0).json()["settings"].clone();
    assert_eq!(taken["feature_style"], "caffe");
    train("separation", "2", &format!("{file} --discriminator-learning-rate 5e-5"), 0);
    let text = format!("--preset kim2020-text {small} {file}");
    train("separation", "3", &text, 5).says(&["feature_style", "pixel_weight"]);
}

#[test]
fn converted_weights_separate_a_picture() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let (folder, features) = (tempfile::tempdir().unwrap(), features());
    let converted = folder.path().join("converted");
    let digest = blake3::hash(&std::fs::read(&features).unwrap()).to_hex().to_string();
    let mut command = Command::new("python3");
    command.arg(root.join("docs/convert_tensorflow.py")).arg(root.join("tests/train/bundle/model"));
    command.args(["--features-blake3", &digest]).arg("--out").arg(&converted);
    match command.status() {
        Ok(status) => assert!(status.success()),
        Err(error) => {
            eprintln!("skipped: no python3: {error}");
            return;
        }
    }
    let photo = folder.path().join("photo.png");
    image::RgbImage::from_fn(48, 40, |x, y| image::Rgb([(5 * x) as u8, (6 * y) as u8, 90]))
        .save(&photo)
        .unwrap();
    let out = folder.path().join("out");
    let network = ["--network", text(&converted), "--features", text(&features)];
    let words = ["separate", text(&photo), "--out", text(&out), "--json"];
    let json = run(&[&words[..], &network].concat()).expect(0).json();
    assert_eq!(json["features"], "file");
    assert!(json["images"][0]["clean_reflection"].is_string(), "{json}");
}
