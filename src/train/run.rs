//! The training of one stage in a run's folder, resumed from its checkpoints.

use super::checkpoint::{
    Checkpoint, Past, clear, code_path, prune, stage_folder, steps, training_folder,
};
use super::checks::{Checks, ChosenOn};
use super::error::TrainError;
use super::resume::{Beginning, lock};
use super::session::{Best, Schedule, Session, Trained, Watcher};
use super::trained_on::check_and_note;
use super::vgg_file::Features;
use compose::Pair;
use crossbeam::channel::bounded;
use examples::Loader;
use examples::{ExampleSampler, SceneSource};
use examples::{PairSource, PhotographSource, TupleFiles, TupleSource};
use glasshouse_line::{Roots, SceneLine, Split};
use plan::{InputFiles, Stage, TrainSettings};
use render::atomic_file::WriteError;
use serde::Serialize;
use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

/// Limits of the default number of steps between checkpoints, a twentieth of all steps.
const CHECKPOINT_EVERY: [u64; 2] = [10, 1000];

/// One stage's training: networks, data and schedule.
pub struct Training<'a> {
    /// Folder of the run.
    pub run: PathBuf,
    /// Name of the training; checkpoints go to `train/NAME/STAGE` in the run, or to `train/STAGE` without a name.
    pub name: Option<String>,
    pub stage: Stage,
    /// Total number of steps, including those of earlier calls.
    pub steps: u64,
    /// Scenes of the run. Training reads the splits `train` and `validation`, and never `test`.
    pub scenes: &'a [SceneLine],
    pub tuples: Arc<dyn TupleFiles>,
    /// Named folders of the photographs, for mixtures.
    pub roots: Roots,
    pub inputs: Box<dyn InputFiles + Send + Sync>,
    /// Real pairs; `None` if no folder was given.
    pub pairs: Option<Vec<Pair>>,
    /// Checkpoint whose weights a new training takes.
    pub from: Option<Checkpoint>,
    /// Real pairs that choose the best checkpoint, in place of the split `validation`, and their folder.
    pub select: Option<(PathBuf, Vec<Pair>)>,
    /// Function that returns the settings, given those of a checkpoint, if any.
    pub settings: &'a dyn Fn(Option<&TrainSettings>) -> TrainSettings,
    /// File of VGG-19's weights, if the settings need one.
    pub features: Option<PathBuf>,
    /// Number of steps between checkpoints; `None` for a twentieth of `steps`, from 10 to 1,000.
    pub checkpoint_every: Option<u64>,
    /// Number of newest checkpoints to keep; the best is also kept.
    pub keep: usize,
    /// Largest number of validation scenes or of pairs of `select`. Without any, every checkpoint counts the same and none is the best.
    pub validate: usize,
    /// Number of steps between grids of pictures; 0 for no grids, `None` for a grid per checkpoint.
    pub pictures_every: Option<u64>,
    /// Memory for examples, bytes.
    pub memory_bytes: usize,
    /// True to check only, without training or writing.
    pub dry_run: bool,
}

/// The result of training, with the keys of `glasshouse.train/1`.
#[derive(Clone, Debug, Serialize)]
pub struct TrainSummary {
    #[serde(serialize_with = "render::path_text::one")]
    pub run: PathBuf,
    pub name: Option<String>,
    pub stage: &'static str,
    pub dry_run: bool,
    /// Number of steps of earlier calls.
    pub from_step: u64,
    /// Number of trainable weights.
    pub parameters: usize,
    /// Number of train scenes.
    pub scenes: usize,
    pub real_pairs: usize,
    pub settings: TrainSettings,
    pub threads: usize,
    /// Instruction set of matrix products.
    pub code_path: &'static str,
    /// `None` after a dry run.
    #[serde(flatten)]
    pub trained: Option<Trained>,
    /// `None` after a dry run, or if no step was left.
    #[serde(flatten)]
    pub pace: Option<Pace>,
}

/// Speed of the training.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Pace {
    pub wall_s: f64,
    /// `None` if no step was taken.
    pub images_per_s: Option<f64>,
}

impl fmt::Display for TrainSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some(trained) = &self.trained else {
            return f.write_str("would train; nothing is written");
        };
        match trained.taken {
            0 => write!(f, "already at step {}", trained.step)?,
            taken => write!(f, "reached step {} (steps taken: {taken})", trained.step)?,
        }
        if let Some(loss) = trained.loss {
            write!(f, ", loss {loss:.4}")?;
        }
        if let Some(db) = trained.validation_psnr_db {
            write!(f, ", {db:.2} dB on validation scenes")?;
        }
        if let Some(path) = &trained.checkpoint {
            write!(f, "\n{}", path.display())?;
        }
        Ok(())
    }
}

impl Training<'_> {
    /// Returns the folder of the training.
    pub(super) fn folder(&self) -> PathBuf {
        training_folder(&self.run, self.name.as_deref())
    }

    /// Returns run and name as on the command line.
    pub(super) fn typed(&self) -> String {
        let run = self.run.display();
        self.name.as_ref().map_or_else(|| run.to_string(), |name| format!("{run} --name {name}"))
    }
}

/// Trains up to `training.steps` total steps or until `stop` is set. Resumes from the newest checkpoint of the stage;
/// the separation stage starts with the newest BT-net.
pub fn run(
    mut training: Training<'_>,
    watcher: &mut dyn Watcher,
    stop: &AtomicBool,
) -> Result<TrainSummary, TrainError> {
    let stage = training.stage;
    let folder = stage_folder(&training.folder(), stage);
    let lock = if training.dry_run { None } else { Some(lock(&folder)?) };
    let mut beginning = Beginning::find(&training.folder(), stage, watcher)?;
    beginning.start_from(training.from.take())?;
    let settings = beginning.settings(&training)?;
    let features = load_features(&training, &settings, watcher)?;
    let mut lines = of_split(training.scenes, Split::Train);
    if settings.scenes > 0 {
        lines.truncate(settings.scenes);
    }
    let pairs = training.pairs.clone().unwrap_or_default();
    let origin = beginning.origin(&lines, &pairs, features.blake3, watcher)?;
    if settings.examples.needs_tuples() {
        check_tuples(&lines, &training, settings.follow, beginning.step(), watcher)?;
    }
    let learner = beginning.learner(stage, &settings, features.vgg)?;
    let mut summary = TrainSummary {
        run: training.run.clone(),
        name: training.name.clone(),
        stage: stage.name(),
        dry_run: training.dry_run,
        from_step: beginning.step(),
        parameters: learner.parameters(),
        scenes: lines.len(),
        real_pairs: pairs.len(),
        settings: settings.clone(),
        threads: rayon::current_num_threads(),
        code_path: code_path(),
        trained: None,
        pace: None,
    };
    if training.dry_run {
        return Ok(summary);
    }
    clear(&folder).map_err(|source| WriteError { path: folder.clone(), source })?;
    let chosen_on = ChosenOn::of(&training)?;
    if let Some(own) = &beginning.own {
        // The process that wrote the checkpoint may have ended before it updated `best.json`. Scores on other images than
        // those of `best.json` are not comparable.
        let before = Best::read(&folder)?.map(|best| best.chosen_on);
        let same = before.is_none_or(|before| Some(before) == chosen_on);
        if let Some(chosen_on) = chosen_on.filter(|_| same) {
            Best::note(&folder, own.state.step, own.state.validation_psnr_db, chosen_on)?;
        }
        // Nor removed old checkpoints. If newer ones are damaged, the old ones stay.
        let newest =
            steps(&folder).map_err(|source| TrainError::Read { path: folder.clone(), source })?;
        if newest.last() == Some(&own.state.step) {
            let best = Best::read(&folder)?.map(|best| best.step);
            prune(&folder, training.keep, best)
                .map_err(|source| WriteError { path: folder.clone(), source })?;
        }
    }
    if let Some(own) = beginning.own.as_ref().filter(|own| own.state.step >= training.steps) {
        summary.trained = Some(Trained {
            step: own.state.step,
            taken: 0,
            checkpoint: Some(own.path.clone()),
            loss: None,
            validation_psnr_db: own.state.validation_psnr_db,
            busy_s: 0.0,
            stopped: false,
        });
        return Ok(summary);
    }
    let checks = Checks::of(&training, &settings, watcher)?;
    let schedule = schedule(&training);
    let steps = beginning.step()..schedule.until;
    let (stop_sender, stopped) = bounded(0);
    let memory = training.memory_bytes;
    let scenes = scene_source(training, &settings, lines);
    let sampler = ExampleSampler::new(&settings, scenes, PairSource { pairs }, memory, stopped)?;
    let baselines = beginning.baselines(stage, &settings, &sampler);
    let past = Past { origin, history: beginning.history(&settings), baselines };
    let own = beginning.own.as_ref();
    let mut session = Session::new(&folder, learner, settings.clone(), past, checks, own)?;
    // As many readers as compute threads: their examples are due together, and a reader that is ahead waits.
    let readers = rayon::current_num_threads();
    let mut loader = Loader::start(sampler, steps.clone(), readers, stop_sender);
    watcher.begins(steps, settings.batch);
    let clock = Instant::now();
    let trained = session.run(&mut loader, &schedule, watcher, stop)?;
    if lock.is_some_and(|lock| !lock.is_in_place()) {
        return Err(TrainError::Moved { folder });
    }
    let images = trained.taken as f64 * settings.batch as f64;
    summary.pace = Some(Pace {
        wall_s: clock.elapsed().as_secs_f64(),
        images_per_s: (trained.taken > 0).then(|| images / trained.busy_s.max(1e-9)),
    });
    summary.trained = Some(trained);
    Ok(summary)
}

fn load_features(
    training: &Training,
    settings: &TrainSettings,
    watcher: &mut dyn Watcher,
) -> Result<Features, TrainError> {
    let file = training.features.as_deref();
    let features = Features::load(settings, file)?;
    if let (Some(path), Some(blake3)) = (file, &features.blake3) {
        watcher.note(&format!("VGG-19 from {}, BLAKE3 {blake3}", path.display()));
    }
    Ok(features)
}

pub(super) fn of_split(scenes: &[SceneLine], split: Split) -> Vec<SceneLine> {
    let lines = scenes.iter().filter(|line| line.split == split);
    lines.cloned().collect()
}

/// Warns of train scenes without a tuple, and fails if others changed since the training's earlier calls, which took `step` steps.
fn check_tuples(
    lines: &[SceneLine],
    training: &Training,
    follow: bool,
    step: u64,
    watcher: &mut dyn Watcher,
) -> Result<(), TrainError> {
    warn_of_missing(lines, &*training.tuples, follow, watcher)?;
    let folder = stage_folder(&training.folder(), training.stage);
    // A dry run, and a call that takes no step, write nothing.
    let writes = !training.dry_run && step < training.steps;
    check_and_note(&folder, lines, &*training.tuples, (step > 0, writes))
}

/// Warns of train scenes without a tuple.
fn warn_of_missing(
    lines: &[SceneLine],
    tuples: &dyn TupleFiles,
    follow: bool,
    watcher: &mut dyn Watcher,
) -> Result<(), TrainError> {
    let ids: Vec<_> = lines.iter().map(|line| line.id.clone()).collect();
    let there = tuples.count(&ids).map_err(TrainError::Tuples)?;
    let (missing, all) = (lines.len() - there, lines.len());
    if missing > 0 {
        watcher.warning(&if follow {
            format!(
                "{missing} of {all} train scenes have no tuple yet; training waits for them"
            )
        } else {
            format!(
                "{missing} of {all} train scenes have no tuple: other scenes replace them; --follow waits for the farm"
            )
        });
    }
    Ok(())
}

fn schedule(training: &Training) -> Schedule {
    let [least, most] = CHECKPOINT_EVERY;
    let every = (training.steps / 20).clamp(least, most);
    let checkpoint_every = training.checkpoint_every.unwrap_or(every);
    Schedule {
        until: training.steps,
        checkpoint_every,
        keep: training.keep,
        pictures_every: training.pictures_every.unwrap_or(checkpoint_every),
    }
}

fn scene_source(
    training: Training,
    settings: &TrainSettings,
    lines: Vec<SceneLine>,
) -> SceneSource {
    if settings.examples.needs_tuples() {
        return SceneSource::Tuples(TupleSource {
            files: training.tuples,
            lines,
            pixels: settings.pixels,
        });
    }
    SceneSource::Photographs(PhotographSource {
        lines,
        roots: training.roots,
        base: training.run,
        inputs: training.inputs,
    })
}
