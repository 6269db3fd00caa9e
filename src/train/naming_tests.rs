//! Tests several trainings of a run: names, first weights, and real pairs that choose the best checkpoint.

use super::run_tests::{pairs, small, training};
use super::*;
use compose::Pair;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

fn unet(frozen: Option<&TrainSettings>) -> TrainSettings {
    let new = || TrainSettings {
        network: NetworkKind::Unet,
        start: Start::Residual,
        a_priori: false,
        adversarial_weight: 0.0,
        learning_rate: 2e-3,
        ..small()
    };
    frozen.cloned().unwrap_or_else(new)
}

fn go(training: Training) -> Result<TrainSummary, TrainError> {
    run(training, &mut (), &AtomicBool::new(false))
}

fn named<'a>(run: &Path, name: &str, steps: u64, pairs: &[Pair]) -> Training<'a> {
    Training {
        name: Some(name.to_owned()),
        ..training(run, Stage::Separation, steps, pairs, &unet)
    }
}

fn step(run: &Path, name: &str, step: u64) -> PathBuf {
    checkpoint_folder(&stage_folder(&training_folder(run, Some(name)), Stage::Separation), step)
}

fn read(path: &Path) -> Checkpoint {
    Checkpoint::read(path).unwrap()
}

fn model(path: &Path) -> Vec<u8> {
    std::fs::read(path.join("model.safetensors")).unwrap()
}

#[test]
fn named_trainings_do_not_meet() {
    let [photographs, folder] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let (pairs, folder) = (pairs(photographs.path()), folder.path());
    let summary = go(named(folder, "a", 2, &pairs)).unwrap();
    assert_eq!(summary.name.as_deref(), Some("a"));
    let other = |frozen: Option<&TrainSettings>| TrainSettings { seed: 9, ..unet(frozen) };
    go(Training { settings: &other, ..named(folder, "b", 2, &pairs) }).unwrap();
    go(training(folder, Stage::Separation, 2, &pairs, &unet)).unwrap();
    let unnamed = checkpoint_folder(&folder.join("train/separation"), 2);
    assert_eq!(model(&unnamed), model(&step(folder, "a", 2)));
    assert_ne!(model(&unnamed), model(&step(folder, "b", 2)));
    assert_eq!(read(&step(folder, "b", 2)).state.settings.seed, 9);
}

#[test]
fn a_training_can_start_from_the_weights_of_another() {
    let [photographs, folder] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let (pairs, folder) = (pairs(photographs.path()), folder.path());
    go(named(folder, "a", 3, &pairs)).unwrap();
    let first = || Some(read(&step(folder, "a", 3)));
    // A step of this rate changes no weight.
    let still =
        |frozen: Option<&TrainSettings>| TrainSettings { learning_rate: 1e-30, ..unet(frozen) };
    let from =
        |steps, from| Training { from, settings: &still, ..named(folder, "b", steps, &pairs) };
    assert_eq!(go(from(1, first())).unwrap().from_step, 0);
    assert_eq!(model(&step(folder, "b", 1)), model(&step(folder, "a", 3)));
    let origin = |n| read(&step(folder, "b", n)).state.origin.from_blake3;
    let digest = read(&step(folder, "a", 3)).state.files["model.safetensors"].clone();
    assert_eq!(origin(1), Some(digest.clone()));
    // Resuming keeps the training's own weights and the note of the first ones, with and without the option.
    go(from(2, first())).unwrap();
    assert_eq!(go(from(3, None)).unwrap().from_step, 2);
    assert_eq!(origin(3), Some(digest));
    let error = go(from(4, Some(read(&step(folder, "a", 2))))).unwrap_err();
    assert!(matches!(error, TrainError::OtherOrigin { .. }), "{error}");
    // The architecture is that of the weights.
    let wider = |_: Option<&TrainSettings>| TrainSettings { width: 8, ..unet(None) };
    let error = go(Training { from: first(), settings: &wider, ..named(folder, "c", 1, &pairs) });
    let error = error.unwrap_err().to_string();
    assert!(error.contains("width: 4 -> 8"), "{error}");
}

#[test]
fn real_pairs_choose_the_best_checkpoint() {
    let [photographs, folder] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let (pairs, folder) = (pairs(photographs.path()), folder.path());
    let select = |steps, chosen: &[Pair]| Training {
        select: Some((photographs.path().to_owned(), chosen.to_vec())),
        validate: 2,
        ..named(folder, "a", steps, &pairs)
    };
    let summary = go(select(4, &pairs)).unwrap();
    assert!(summary.trained.unwrap().validation_psnr_db.is_some());
    let stage = stage_folder(&training_folder(folder, Some("a")), Stage::Separation);
    let best = Best::read(&stage).unwrap().unwrap();
    let ChosenOn::RealPairs(digest) = &best.chosen_on else { panic!("{best:?}") };
    assert_eq!(digest.len(), 64);
    // Other pictures choose anew, even if their scores are lower.
    let chosen_on = ChosenOn::RealPairs("of other pairs".to_owned());
    let other = Best { step: 2, validation_psnr_db: 99.0, chosen_on };
    let other = serde_json::to_vec(&other).unwrap();
    render::atomic_file::write(&stage.join("best.json"), &other).unwrap();
    go(select(6, &pairs)).unwrap();
    let again = Best::read(&stage).unwrap().unwrap();
    assert_eq!((again.step, &again.chosen_on), (6, &best.chosen_on));
    let missing = Pair { blended: "nowhere.png".into(), ..pairs[0].clone() };
    let error = go(select(8, &[missing])).unwrap_err();
    assert!(matches!(error, TrainError::Read { .. }), "{error}");
}
