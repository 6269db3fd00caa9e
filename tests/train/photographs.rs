//! Training on photographs and behind calibrated sensors.

use crate::support::program::{run, text};
use std::path::PathBuf;
use tempfile::TempDir;

const RECIPE: &str = r#"
schema = "glasshouse.recipe/1"
name = "photographs"
seed = 5
[film]
width = 56
height = 48
spp = 4
[sensor]
camera = "imx686"
[sources.sample]
layout = "sample"
count = 8
width = 128
height = 96
[[split]]
name = "train"
pairs = { sample = 3 }
[[split]]
name = "test"
pairs = { sample = 1 }
[train]
backtrack_steps = 0
separation_steps = 3
[train.settings]
network = "unet"
start = "residual"
a_priori = false
adversarial_weight = 0.0
feature_weight = 0.0
width = 3
crop_px = 40
examples = "composed"
[train.settings.sensor]
camera = { choice = ["imx686", "nikon-d850"] }
scale = { choice = [0.9, 1.0] }
"#;

fn finished(recipe: &str) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("photographs.toml");
    std::fs::write(&path, recipe).unwrap();
    let made = folder.path().join("run");
    run(&["run", text(&path), "--out", text(&made), "-q"]).expect(0);
    (folder, made)
}

/// Returns the weights of a step.
fn weights(run: &std::path::Path, step: u64) -> Vec<u8> {
    let folder = run.join(format!("train/separation/step-{step:07}"));
    std::fs::read(folder.join("model.safetensors")).unwrap()
}

/// A recipe's training behind a sensor repeats to the bit with other numbers of threads, and depends on the sensor.
#[test]
fn composed_examples_behind_a_sensor_repeat() {
    let (_folder, one) = finished(RECIPE);
    let (_other, two) = finished(RECIPE);
    let more = ["train", text(&one), "--stage", "separation", "--steps", "5", "-j", "1"];
    run(&more).expect(0);
    let more = ["train", text(&two), "--stage", "separation", "--steps", "5", "-j", "2"];
    run(&more).expect(0);
    assert!(weights(&one, 5) == weights(&two, 5));
    let simple = RECIPE.split("[train.settings.sensor]").next().unwrap();
    let (_simple, three) = finished(simple);
    assert!(weights(&one, 3) != weights(&three, 3));
    // Resuming with another sensor is refused, as every other frozen setting.
    let state = one.join("train/separation/step-0000003/state.json");
    let text_of = std::fs::read_to_string(state).unwrap();
    assert!(text_of.contains("\"nikon-d850\""), "the state has the sensor");
}

#[test]
fn photographs_are_trained_on_and_scored() {
    let recipe = RECIPE.split("[train]").next().unwrap();
    let (_folder, made) = finished(recipe);
    let of = |pixels: &str, more: &[&str]| {
        let mut all = vec!["evaluate", text(&made), "--pixels", pixels, "--json"];
        all.extend(more);
        run(&all).expect(0).json()
    };
    let input = |scores: &serde_json::Value| {
        let rows = scores["rows"].as_array().unwrap();
        let row = rows.iter().find(|row| row["method"] == "input").unwrap().clone();
        row["psnr_colour_db"].as_f64().unwrap()
    };
    let small = ["--width", "3", "--crop", "40", "--discriminator-width", "2", "--no-a-priori"];
    let mut train = vec!["train", text(&made), "--stage", "separation", "--steps", "2"];
    train.extend(small);
    train.extend(["--pixels", "photograph"]);
    run(&train).expect(0);
    let out = made.join("scores");
    let exact = of("png", &["--out", text(&out)]);
    let photographed = of("photograph", &["--out", text(&out)]);
    // Noise and JPEG make the photograph of I differ more from that of T.
    assert!((input(&exact) - input(&photographed)).abs() > 0.05, "{exact} {photographed}");
    let plain = recipe.replace("[sensor]\ncamera = \"imx686\"\n", "");
    let (_plain, plain) = finished(&plain);
    let mut train = vec!["train", text(&plain), "--stage", "separation", "--steps", "2"];
    train.extend(small);
    train.extend(["--pixels", "photograph"]);
    run(&train).expect(4).says(&["has no photographs: render a recipe with [sensor]"]);
}
