//! Tests that networks with values that are not finite are neither written nor used.

use crate::support::program::{run, text};
use crate::training::{Place, place, small};
use image::RgbImage;
use serde_json::Value;
use std::path::Path;

/// Changes the first values of a tensor file, and makes `state.json` match the new bytes.
fn change(step: &Path, file: &str, values: usize, change: impl Fn(f32) -> f32) {
    let path = step.join(file);
    let mut bytes = std::fs::read(&path).unwrap();
    let header = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    for value in bytes[8 + header..].chunks_exact_mut(4).take(values) {
        let changed = change(f32::from_le_bytes(value.try_into().unwrap()));
        value.copy_from_slice(&changed.to_le_bytes());
    }
    std::fs::write(&path, &bytes).unwrap();
    let state = step.join("state.json");
    let mut json: Value = serde_json::from_slice(&std::fs::read(&state).unwrap()).unwrap();
    json["files"][file] = blake3::hash(&bytes).to_hex().to_string().into();
    std::fs::write(&state, json.to_string()).unwrap();
}

#[test]
fn an_exploding_training_leaves_no_checkpoint() {
    let place = place();
    for (steps, words) in [("1", "the networks of step 1 are not written"), ("9", "step 2")] {
        let more = small(&["--learning-rate", "1e10", "--checkpoint-every", "9"]);
        let ended = run(&place.arguments("backtrack", steps, &more)).expect(1);
        ended.says(&[words, "A smaller --learning-rate may help"]);
        assert!(!place.folder_of("backtrack", 1).exists());
        assert!(!place.run.join("train/backtrack/best.json").exists());
    }
    // The refusal does not hinder another attempt, with another rate than that of the checkpoint of step 0.
    place.train("backtrack", "1", &small(&["--learning-rate", "1e-4"]));
}

fn trained() -> Place {
    let place = place();
    place.train("backtrack", "2", &small(&[]));
    place.train("separation", "2", &["--checkpoint-every", "1"]);
    place
}

#[test]
fn a_checkpoint_that_is_not_finite_is_refused_by_name() {
    let place = trained();
    let photo = place.run.join("photo.png");
    RgbImage::from_fn(40, 40, |x, y| image::Rgb([x as u8 * 6, y as u8 * 6, 90]))
        .save(&photo)
        .unwrap();
    let out = place.run.join("separated");
    let newest = place.folder_of("separation", 2);
    let separate = |network: &Path| {
        run(&["separate", "--network", text(network), text(&photo), "--out", text(&out)])
    };
    separate(&newest).expect(0);
    for (file, value) in [("optimizer.safetensors", f32::INFINITY), ("model.safetensors", f32::NAN)]
    {
        change(&newest, file, 1, |_| value);
        let words = ["step-0000002", file, "is not finite"];
        separate(&newest).expect(4).says(&words);
        run(&["evaluate", text(&place.run), "--checkpoint", text(&newest)]).expect(4).says(&words);
    }
    // Training continues from the checkpoint before it.
    let ended = run(&place.arguments("separation", "3", &[])).expect(0);
    ended.says(&["step-0000002", "is not finite", "step 1 is used instead"]);
}

#[test]
fn finite_weights_that_make_no_finite_pictures_are_refused() {
    let place = trained();
    let newest = place.folder_of("separation", 2);
    change(&newest, "model.safetensors", usize::MAX, |weight| weight * 1e30);
    let photo = place.run.join("photo.png");
    RgbImage::from_pixel(40, 40, image::Rgb([200, 150, 90])).save(&photo).unwrap();
    let out = place.run.join("separated");
    let ended = run(&["separate", "--network", text(&newest), text(&photo), "--out", text(&out)]);
    ended.expect(4).says(&["step-0000002", "values that are not finite"]);
    run(&place.arguments("separation", "3", &[])).expect(4).says(&["step-0000002", "remove it"]);
}
