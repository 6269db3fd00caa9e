//! Tests training of the U-Net on real pairs in a temporary folder, and one step against PyTorch (`tests/train/unet.py`).

use super::run_tests::{pairs, small, training};
use super::*;
use candle_core::{Device, Tensor};
use compose::Pair;
use std::collections::HashMap;
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// Returns settings with everything that a step of the U-Net can have.
fn settings() -> TrainSettings {
    TrainSettings {
        network: NetworkKind::Unet,
        start: Start::Residual,
        a_priori: false,
        bound: 1.0,
        batch: 2,
        adversarial_weight: 0.0,
        gradient_weight: 1.0,
        learning_rate: 2e-3,
        optimizer: OptimizerKind::Adamw,
        betas: [0.9, 0.99],
        weight_decay: 1e-2,
        schedule: ScheduleKind::Cosine,
        warmup_steps: 2,
        clip_norm: 0.5,
        ema: 0.9,
        ..small()
    }
}

/// Trains to a step with the checkpoint's settings, changed by `change`.
fn train(
    folder: &Path,
    steps: u64,
    pairs: &[Pair],
    change: fn(TrainSettings) -> TrainSettings,
) -> Result<TrainSummary, TrainError> {
    let settings =
        |frozen: Option<&TrainSettings>| change(frozen.cloned().unwrap_or_else(settings));
    let training = training(folder, Stage::Separation, steps, pairs, &settings);
    run(training, &mut (), &AtomicBool::new(false))
}

fn path(folder: &Path, step: u64) -> std::path::PathBuf {
    checkpoint_folder(&stage_folder(&folder.join("train"), Stage::Separation), step)
}

fn files(folder: &Path, step: u64) -> [Vec<u8>; 3] {
    ["model.safetensors", "optimizer.safetensors", "state.json"]
        .map(|name| std::fs::read(path(folder, step).join(name)).unwrap())
}

#[test]
fn a_resumed_unet_has_the_same_bits() {
    let [photographs, whole, parts] = [(); 3].map(|()| tempfile::tempdir().unwrap());
    let pairs = pairs(photographs.path());
    train(whole.path(), 6, &pairs, |s| s).unwrap();
    train(parts.path(), 6, &pairs, |s| s).unwrap();
    // As if the program had been killed in step 5.
    for step in [4, 6] {
        std::fs::remove_dir_all(path(parts.path(), step)).unwrap();
    }
    let resumed = train(parts.path(), 6, &pairs, |s| s).unwrap();
    assert_eq!(resumed.from_step, 2);
    assert!(files(whole.path(), 6) == files(parts.path(), 6));
    // The model holds the running means, and the optimiser's file holds the trained weights.
    let checkpoint = Checkpoint::read(&path(whole.path(), 6)).unwrap();
    let numbers = |t: &Tensor| t.flatten_all().unwrap().to_vec1::<f32>().unwrap();
    let mean = numbers(&checkpoint.model["separation.last"]);
    assert_ne!(mean, numbers(&checkpoint.moments["weight.separation.last"]));
    assert_eq!(checkpoint.state.settings.schedule_steps, 6);
    assert!(checkpoint.state.history.is_empty());
    // The separator works with the running means, and does not brighten.
    let separator = Separator::new(&checkpoint, None, None).unwrap();
    let input = image::RgbImage::from_fn(70, 45, |x, y| {
        image::Rgb([(x * 3) as u8, (y * 5) as u8, (x + y) as u8])
    });
    let made = separator.separate(&input, crate::WorkSize::default()).unwrap();
    let (transmission, reflection) = (made.transmission, made.glass_reflection);
    assert!(
        input.pixels().zip(transmission.pixels()).all(|(i, t)| (0..3).all(|c| t.0[c] <= i.0[c]))
    );
    assert_eq!(reflection.dimensions(), (70, 45));
    let learner = separator.networks().separation.unwrap();
    let found = learner.variables().into_iter().find(|(name, _)| name == "last").unwrap().1;
    assert_eq!(numbers(&found), mean);
}

#[test]
fn rates_may_change_when_a_unet_resumes() {
    let [photographs, folder] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let (folder, pairs) = (folder.path(), pairs(photographs.path()));
    train(folder, 2, &pairs, |s| s).unwrap();
    let error = train(folder, 4, &pairs, |s| s).unwrap_err();
    assert!(matches!(error, TrainError::ScheduleEnds { end: 2, steps: 4 }), "{error}");
    let frozen = train(folder, 4, &pairs, |s| TrainSettings { ema: 0.5, ..s }).unwrap_err();
    assert!(matches!(frozen, TrainError::ScheduleEnds { .. }));
    let longer = |s| TrainSettings { schedule_steps: 4, learning_rate: 1e-3, ..s };
    train(folder, 4, &pairs, longer).unwrap();
    let state = Checkpoint::read(&path(folder, 4)).unwrap().state;
    let changes = &state.history[0];
    assert_eq!(changes.after_step, 2);
    assert_eq!(changes.changes, ["learning_rate: 0.002 -> 0.001", "schedule_steps: 2 -> 4"]);
    let frozen = train(folder, 4, &pairs, |s| TrainSettings { ema: 0.5, ..s }).unwrap_err();
    match frozen {
        TrainError::Frozen { differences, .. } => assert_eq!(differences, ["ema: 0.9 -> 0.5"]),
        error => panic!("{error}"),
    }
}

#[test]
fn a_unet_needs_no_bt_net_and_has_none() {
    let [photographs, folder] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let (folder, pairs) = (folder.path(), pairs(photographs.path()));
    let generators = |_: Option<&TrainSettings>| small();
    let unet = |_: Option<&TrainSettings>| settings();
    let stop = AtomicBool::new(false);
    let refused = training(folder, Stage::Backtrack, 2, &pairs, &unet);
    let error = run(refused, &mut (), &stop).unwrap_err().to_string();
    assert!(error.contains("--stage separation --network unet"), "{error}");
    // A BT-net of the same run is not used.
    run(training(folder, Stage::Backtrack, 1, &pairs, &generators), &mut (), &stop).unwrap();
    let trained = run(training(folder, Stage::Separation, 1, &pairs, &unet), &mut (), &stop);
    let path = trained.unwrap().trained.unwrap().checkpoint.unwrap();
    let checkpoint = Checkpoint::read(&path).unwrap();
    assert_eq!(checkpoint.state.origin.backtrack, None);
    assert!(checkpoint.model.keys().all(|name| name.starts_with("separation.")));
    let other = training(folder, Stage::Separation, 2, &pairs, &generators);
    match run(other, &mut (), &stop).unwrap_err() {
        TrainError::Frozen { differences, .. } => {
            assert!(differences.contains(&"network: \"unet\" -> \"generator\"".to_owned()));
        }
        error => panic!("{error}"),
    }
}

/// Widths, learning rate and other constants of `tests/train/unet.py`.
#[test]
fn steps_equal_pytorch() {
    let bytes = include_bytes!("../../tests/train/unet.safetensors");
    let fixture: HashMap<String, Tensor> =
        candle_core::safetensors::load_buffer(bytes, &Device::Cpu).unwrap();
    let settings =
        TrainSettings { schedule_steps: 20, clip_norm: 0.05, bound: 1.2, width: 3, ..settings() };
    let mut learner = Learner::new(Stage::Separation, &settings, None).unwrap();
    learner.set_model(&fixture, "").unwrap();
    let batch = Batch {
        input: fixture["input"].clone(),
        transmission: fixture["transmission"].clone(),
        glass_reflection: None,
        clean_reflection: None,
    };
    let off = |found: &Tensor, expected: &Tensor| {
        let square = |t: Tensor| t.sqr().unwrap().sum_all().unwrap().to_scalar::<f32>().unwrap();
        (square((found - expected).unwrap()) / square(expected.clone())).sqrt()
    };
    let made = learner.separation.as_ref().unwrap().forward(&batch.input, &[]).unwrap();
    let made = off(&made.transmission, &fixture["made"]);
    assert!(made < 1e-5, "{made}");
    let (_, gradients) = learner.gradients(&batch).unwrap();
    for moments in &learner.generator_adam.moments {
        let expected = &fixture[&format!("gradient.{}", moments.name)];
        let worst = off(gradients.get(&moments.variable).unwrap(), expected);
        assert!(worst < 1e-4, "gradient of {}: {worst}", moments.name);
    }
    let losses: Vec<f32> = fixture["losses"].to_vec1().unwrap();
    for (step, expected) in (0..).zip(losses) {
        let found = learner.step(step, &batch, &mut |_| {}).unwrap().total;
        assert!((found / expected - 1.0).abs() < 1e-4, "step {step}: {found} {expected}");
    }
    for (name, mean) in learner.model() {
        let worst = off(&mean, &fixture[&format!("mean.{name}")]);
        assert!(worst < 1e-3, "mean of {name}: {worst}");
    }
}
