//! `docs/convert_tensorflow.py` against the outputs of TensorFlow (`tests/train/bundle.py`).

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use train::candle_core::{Device, Tensor, safetensors};
use train::{Checkpoint, Separator, Vgg};

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// Runs the script, or returns `None` on a machine without Python.
fn convert(prefix: &Path, more: &[&str], out: &Path) -> Option<Output> {
    let script = root().join("docs/convert_tensorflow.py");
    let mut command = Command::new("python3");
    match command.arg(script).arg(prefix).args(more).arg("--out").arg(out).output() {
        Ok(output) => Some(output),
        Err(error) => {
            eprintln!("skipped: no python3: {error}");
            None
        }
    }
}

/// Returns the length of the difference of two tensors by that of the second.
fn off(found: &[f32], expected: &Tensor) -> f64 {
    let expected = expected.flatten_all().unwrap().to_vec1::<f32>().unwrap();
    assert_eq!(found.len(), expected.len());
    let square = |v: f64| v * v;
    let pairs = found.iter().zip(&expected);
    let difference: f64 = pairs.map(|(a, b)| square(f64::from(a - b))).sum();
    let length: f64 = expected.iter().map(|b| square(f64::from(*b))).sum();
    (difference / length).sqrt()
}

#[test]
fn a_converted_checkpoint_gives_the_outputs_of_tensorflow() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("converted");
    let prefix = root().join("tests/train/bundle/model");
    let digest = "0123456789abcdef";
    let Some(ended) = convert(&prefix, &["--features-blake3", digest], &out) else { return };
    let said = String::from_utf8_lossy(&ended.stderr).into_owned();
    assert!(ended.status.success(), "{said}");

    let load = |bytes: &[u8]| -> HashMap<String, Tensor> {
        safetensors::load_buffer(bytes, &Device::Cpu).unwrap()
    };
    let given = load(include_bytes!("step.safetensors"));
    let expected = load(include_bytes!("bundle.safetensors"));
    // Verifies the digests.
    let checkpoint = Checkpoint::read(&out).unwrap();
    assert_eq!(checkpoint.state.settings.vgg_divisor, 32);
    let vgg = Vgg::new(&given, 32).unwrap();
    let separator = Separator::new(&checkpoint, Some(vgg), Some(digest)).unwrap();
    let networks = separator.networks();
    let (image, vgg) = (&expected["image"], networks.vgg.unwrap());
    let made = networks.separation.unwrap().forward(image, &vgg.features(image).unwrap()).unwrap();
    let numbers = |t: &Tensor| t.flatten_all().unwrap().to_vec1::<f32>().unwrap();
    let r = made.glass_reflection.unwrap();
    let back = networks.backtrack.unwrap().forward(&r, &vgg.features(&r).unwrap()).unwrap();
    for (name, found) in [
        ("transmission", &made.transmission),
        ("glass_reflection", &r),
        ("clean_reflection", &back),
    ] {
        let off = off(&numbers(found), &expected[name]);
        assert!(off < 1e-4, "{name}: {off}");
    }
}

#[test]
fn damaged_checkpoints_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let prefix = folder.path().join("model");
    let ending = |ending: &str| folder.path().join(format!("model.{ending}"));
    let given = root().join("tests/train/bundle");
    let data = "data-00000-of-00001";
    let sound = std::fs::read(given.join(format!("model.{data}"))).unwrap();
    let index = std::fs::read(given.join("model.index")).unwrap();
    let refused = |more: &[&str], part: &str| {
        let out = folder.path().join("out");
        let Some(ended) = convert(&prefix, more, &out) else { return };
        let said = String::from_utf8_lossy(&ended.stderr).into_owned();
        assert!(!ended.status.success() && said.contains(part) && !out.exists(), "{said}");
        assert!(!said.contains("Traceback"), "{said}");
    };
    let digest = ["--features-blake3", "00"];
    refused(&digest, "model.index");
    let write = |name: &str, bytes: &[u8]| {
        std::fs::write(ending(name), bytes).unwrap();
    };
    write("index", &index);
    write(data, &sound);
    refused(&[], "--features-blake3");
    let mut bytes = sound.clone();
    let middle = bytes.len() / 2;
    bytes.iter_mut().skip(middle).for_each(|byte| *byte ^= 1);
    write(data, &bytes);
    refused(&digest, "does not match its checksum");
    write(data, &sound[..64]);
    refused(&digest, "does not match its checksum");
    let mut bytes = index.clone();
    bytes[20] ^= 1;
    write("index", &bytes);
    refused(&digest, "a block of the index does not match its checksum");
    write("index", b"not an index");
    refused(&digest, "it is not the index of a checkpoint");
}
