//! Tests training on real pairs in a temporary folder, inside the test's process, without a store or a farm.

use super::*;
use compose::Pair;
use glasshouse_line::ids::SceneId;
use image::RgbImage;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// The tuple files of a run in which every scene is quarantined.
struct NoTuples;

impl TupleFiles for NoTuples {
    fn get(&self, _: &SceneId, _: &str) -> Result<Option<Vec<u8>>, TupleFilesError> {
        Ok(None)
    }

    fn is_quarantined(&self, _: &SceneId) -> Result<bool, TupleFilesError> {
        Ok(true)
    }

    fn count(&self, _: &[SceneId]) -> Result<usize, TupleFilesError> {
        Ok(0)
    }
}

#[derive(Default)]
struct Seen {
    begun: Vec<Range<u64>>,
    steps: Vec<u64>,
    checkpoints: Vec<u64>,
    warnings: Vec<String>,
}

impl Watcher for Seen {
    fn begins(&mut self, steps: Range<u64>, _batch: usize) {
        self.begun.push(steps);
    }

    fn step(&mut self, step: u64, _losses: &StepLosses, _wall_s: f64) {
        self.steps.push(step);
    }

    fn checkpoint(&mut self, step: u64, _path: &Path, _validation_psnr_db: Option<f64>) {
        self.checkpoints.push(step);
    }

    fn warning(&mut self, text: &str) {
        self.warnings.push(text.to_owned());
    }
}

/// Writes three pairs of 40 x 36 px with all four layers.
pub(super) fn pairs(folder: &Path) -> Vec<Pair> {
    let layers = ["blended", "transmission", "reflection", "clean_reflection"];
    (0..3u32)
        .map(|index| {
            let [blended, transmission, reflection, clean_reflection] = [0, 1, 2, 3].map(|k| {
                let path = folder.join(format!("{index}-{}.png", layers[k as usize]));
                let picture = RgbImage::from_fn(40, 36, |x, y| {
                    image::Rgb([x * 5, y * 6, (x * y) / 8].map(|v| (v + 9 * k + index) as u8))
                });
                picture.save(&path).unwrap();
                path
            });
            Pair {
                name: index.to_string(),
                blended,
                transmission,
                reflection: Some(reflection),
                clean_reflection: Some(clean_reflection),
            }
        })
        .collect()
}

pub(super) fn small() -> TrainSettings {
    TrainSettings {
        features: FeatureSource::None,
        width: 4,
        discriminator_width: 2,
        crop_px: 32,
        real_share: 1.0,
        ..TrainSettings::default()
    }
}

pub(super) fn training<'a>(
    run: &Path,
    stage: Stage,
    steps: u64,
    pairs: &[Pair],
    settings: &'a dyn Fn(Option<&TrainSettings>) -> TrainSettings,
) -> Training<'a> {
    Training {
        run: run.to_owned(),
        name: None,
        stage,
        steps,
        scenes: &[],
        tuples: Arc::new(NoTuples),
        roots: glasshouse_line::Roots::default(),
        inputs: Box::new(plan::LocalFiles),
        pairs: Some(pairs.to_vec()),
        from: None,
        select: None,
        settings,
        features: None,
        checkpoint_every: Some(2),
        keep: 9,
        validate: 1,
        pictures_every: None,
        memory_bytes: 1 << 20,
        dry_run: false,
    }
}

fn model(run: &Path, step: u64) -> Vec<u8> {
    let folder = checkpoint_folder(&stage_folder(&run.join("train"), Stage::Backtrack), step);
    std::fs::read(folder.join("model.safetensors")).unwrap()
}

#[test]
fn training_resumes_to_the_same_bits_and_starts_the_next_stage() {
    let [photographs, whole, parts] = [(); 3].map(|()| tempfile::tempdir().unwrap());
    let (whole, parts) = (whole.path(), parts.path());
    let pairs = pairs(photographs.path());
    let fresh = |frozen: Option<&TrainSettings>| frozen.cloned().unwrap_or_else(small);
    let go = |folder: &Path, stage, steps, watcher: &mut dyn Watcher| {
        let training = training(folder, stage, steps, &pairs, &fresh);
        run(training, watcher, &AtomicBool::new(false)).unwrap()
    };
    let mut seen = Seen::default();
    let summary = go(whole, Stage::Backtrack, 4, &mut seen);
    assert!(seen.begun.iter().eq([&(0..4)]));
    assert_eq!(seen.steps, [1, 2, 3, 4]);
    assert_eq!((seen.checkpoints, seen.warnings.len()), (vec![0, 2, 4], 0));
    assert_eq!((summary.from_step, summary.real_pairs), (0, 3));
    assert!(summary.to_string().starts_with("reached step 4 (steps taken: 4), loss "));

    let first = go(parts, Stage::Backtrack, 2, &mut ());
    assert_eq!(first.trained.unwrap().step, 2);
    let mut seen = Seen::default();
    let rest = go(parts, Stage::Backtrack, 4, &mut seen);
    assert!(rest.from_step == 2 && seen.begun.iter().eq([&(2..4)]));
    assert!(model(whole, 4) == model(parts, 4));
    // No step is left.
    let done = go(parts, Stage::Backtrack, 3, &mut ());
    assert!(done.to_string().starts_with("already at step 4"), "{done}");
    let json = serde_json::to_value(&done).unwrap();
    assert_eq!((&json["steps_taken"], json.get("wall_s")), (&0.into(), None));

    let next = go(parts, Stage::Separation, 1, &mut ());
    let path = next.trained.unwrap().checkpoint.unwrap();
    let state = Checkpoint::read(&path).unwrap().state;
    assert_eq!(state.origin.backtrack.unwrap().0, 4);
}

#[test]
fn a_lying_state_is_refused_and_the_checkpoint_before_it_is_used() {
    let [photographs, folder] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let folder = folder.path();
    let pairs = pairs(photographs.path());
    let fresh = |frozen: Option<&TrainSettings>| frozen.cloned().unwrap_or_else(small);
    let go = |steps, watcher: &mut dyn Watcher| {
        let training = training(folder, Stage::Backtrack, steps, &pairs, &fresh);
        run(training, watcher, &AtomicBool::new(false)).unwrap()
    };
    go(4, &mut ());
    let stage = stage_folder(&folder.join("train"), Stage::Backtrack);
    let path = checkpoint_folder(&stage, 4);
    let state = std::fs::read_to_string(path.join("state.json")).unwrap();
    for (key, from, to, words) in [
        ("step", "4", "999999", "but the folder is of step 4"),
        ("generator_steps", "4", "7", "generator_steps is 7 at step 4"),
        ("discriminator_steps", "2", "3", "discriminator_steps is 3 at step 4 instead of 2"),
        ("width", "4", "0", "settings.width is 0"),
    ] {
        let from = format!("\"{key}\": {from},");
        assert!(state.contains(&from), "{state}");
        let lying = state.replacen(&from, &format!("\"{key}\": {to},"), 1);
        render::atomic_file::write(&path.join("state.json"), lying.as_bytes()).unwrap();
        let error = Checkpoint::read(&path).err().unwrap().to_string();
        assert!(error.contains(words) && error.contains("state.json"), "{error}");
        let (found, refused) = Checkpoint::newest(&stage, 0).unwrap();
        assert_eq!((found.unwrap().state.step, refused.len()), (2, 1));
    }
    // Training goes on from the checkpoint before, and names the damaged one.
    let mut seen = Seen::default();
    assert_eq!(go(4, &mut seen).from_step, 2);
    assert!(seen.warnings[0].contains("step 2 is used instead"), "{:?}", seen.warnings);
}

#[test]
fn impossible_training_is_refused_with_a_reason() {
    let [photographs, folder] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let folder = folder.path();
    let pairs = pairs(photographs.path());
    let stop = AtomicBool::new(false);
    let fresh = |frozen: Option<&TrainSettings>| frozen.cloned().unwrap_or_else(small);
    let backtrack = |steps| training(folder, Stage::Backtrack, steps, &pairs, &fresh);
    let refused = |training| run(training, &mut (), &stop).unwrap_err();
    let error = refused(training(folder, Stage::Separation, 2, &pairs, &fresh));
    assert!(matches!(error, TrainError::NoBacktrack { .. }), "{error}");
    let error = refused(Training { pairs: None, ..backtrack(2) });
    assert!(matches!(error, TrainError::NoRealPairs { .. }), "{error}");
    // A dry run writes no checkpoint.
    let dry = run(Training { dry_run: true, ..backtrack(2) }, &mut (), &stop).unwrap();
    assert_eq!(dry.to_string(), "would train; nothing is written");
    assert!(steps(&stage_folder(&folder.join("train"), Stage::Backtrack)).unwrap().is_empty());

    run(backtrack(2), &mut (), &stop).unwrap();
    let wider = |_: Option<&TrainSettings>| TrainSettings { width: 8, ..small() };
    let error = refused(Training { settings: &wider, ..backtrack(4) });
    match &error {
        TrainError::Frozen { differences, .. } => assert_eq!(differences, &["width: 4 -> 8"]),
        _ => panic!("{error}"),
    }
    let fewer = Some(pairs[..2].to_vec());
    let error = refused(Training { pairs: fewer, ..backtrack(4) });
    assert!(error.to_string().starts_with("the real pairs are not those"), "{error}");
    let _lock =
        super::resume::lock(&stage_folder(&folder.join("train"), Stage::Backtrack)).unwrap();
    let error = refused(backtrack(4));
    assert!(matches!(error, TrainError::Busy { .. }), "{error}");
}

#[test]
fn a_stop_before_the_first_step_leaves_no_checkpoint() {
    let [photographs, folder] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let pairs = pairs(photographs.path());
    let fresh = |_: Option<&TrainSettings>| small();
    let stop = AtomicBool::new(true);
    let training = training(folder.path(), Stage::Backtrack, 4, &pairs, &fresh);
    let trained = run(training, &mut (), &stop).unwrap().trained.unwrap();
    assert!(trained.stopped && trained.taken == 0 && trained.checkpoint.is_none());
}
