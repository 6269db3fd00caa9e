//! Options and threads of the networks for a command; loads the networks of a checkpoint.

use super::args::{Global, threads};
use super::exit_code::{Exit, Failure, failure};
use super::output::Output;
use crate::run::keys;
use plan::{FeatureSource, NetworkKind, Stage};
use std::path::{Path, PathBuf};
use train::{
    Best, Checkpoint, CheckpointState, Features, Separator, checkpoint_folder, stage_folder, steps,
    training_folder,
};

/// Builds the thread pool of the networks and returns the number of threads. The calling thread becomes one of them:
/// a training step consists of hundreds of short parallel loops, and starting each from another thread costs two
/// context switches.
pub(super) fn use_threads(global: &Global) -> usize {
    let threads = threads(global);
    // Fails on every call after the first in a process, because the pool already exists.
    let _ =
        rayon::ThreadPoolBuilder::new().num_threads(threads).use_current_thread().build_global();
    threads
}

/// Limits candle's own threads, which spin while they wait, to those of `-j`. candle reads the number from the environment
/// when it first uses them. Must be called before the program starts other threads.
#[allow(unsafe_code, reason = "a variable of the environment is set")]
pub(super) fn limit_candle_threads(global: &Global) {
    const NAME: &str = "CANDLE_NUM_THREADS";
    if std::env::var_os(NAME).is_none() {
        // SAFETY: no other thread runs yet, so none reads the environment.
        unsafe { std::env::set_var(NAME, threads(global).to_string()) };
    }
}

/// Returns the file of VGG-19 weights, if `--features` names one.
pub(super) fn weights_file(typed: Option<&str>) -> Option<&Path> {
    typed.filter(|typed| !["none", "random"].contains(typed)).map(Path::new)
}

/// Networks, and the checkpoint that they come from.
pub(super) struct Network {
    pub(super) separator: Separator,
    /// Folder of the checkpoint.
    pub(super) path: PathBuf,
    pub(super) state: CheckpointState,
}

impl Network {
    /// Opens the folder of a checkpoint, a stage or a run. `weights` is the file of VGG-19 weights, if the command line
    /// has one.
    pub(super) fn open(
        place: &Path,
        weights: Option<&str>,
        output: &Output,
    ) -> Result<Self, Failure> {
        Self::of(checkpoint(place, output)?, weights, output)
    }

    /// Returns the networks whose weights ship with the program.
    pub(super) fn shipped(output: &Output) -> Result<Self, Failure> {
        let checkpoint = Checkpoint::shipped().map_err(|e| Failure::new(Exit::Failed, e))?;
        Self::of(checkpoint, None, output)
    }

    fn of(checkpoint: Checkpoint, weights: Option<&str>, output: &Output) -> Result<Self, Failure> {
        let settings = &checkpoint.state.settings;
        if weights.is_some() && settings.features != FeatureSource::File {
            output.note(&format!(
                "--features is ignored for {}, because its network uses no weights from a file",
                checkpoint.path.display()
            ));
        }
        let file = weights_file(weights);
        let Features { vgg, blake3 } =
            Features::load(settings, file).map_err(|e| Failure::new(Exit::InvalidInput, e))?;
        if let (Some(path), Some(blake3)) = (file, &blake3) {
            output.note(&format!("VGG-19 from {}, BLAKE3 {blake3}", path.display()));
        }
        let separator = Separator::new(&checkpoint, vgg, blake3.as_deref())?;
        Ok(Self { separator, path: checkpoint.path, state: checkpoint.state })
    }

    /// Fails if tiles of this side are too small for the networks.
    pub(super) fn check_tile_px(&self, tile_px: Option<u32>) -> Result<(), Failure> {
        let least = self.separator.networks().least_tile_px();
        let path = self.path.display();
        match tile_px.filter(|px| (*px as usize) < least) {
            None => Ok(()),
            Some(px) => Err(failure!(
                Exit::Usage,
                "--tile-px {px} is too small for the networks of {path}: give {least} or more"
            )),
        }
    }

    /// Returns the name of the table row: `name`, or stage and step. Adds the features if they differ from the paper's.
    pub(super) fn row_name(&self, name: Option<&str>) -> String {
        let state = &self.state;
        let name = name
            .map_or_else(|| format!("{} step {}", state.stage.name(), state.step), str::to_owned);
        match state.settings.features {
            // A U-Net has no features.
            _ if state.settings.network == NetworkKind::Unet => name,
            FeatureSource::File => name,
            FeatureSource::Random => format!("{name} (features random)"),
            FeatureSource::None => format!("{name} (features none)"),
        }
    }
}

/// Reads the checkpoint at a place. Of several, it is the one that validation chose, or the newest without validation;
/// scores and separated pictures therefore come from the same networks.
pub(super) fn checkpoint(place: &Path, output: &Output) -> Result<Checkpoint, Failure> {
    let is_step = |name: &str| name.starts_with("step-");
    let name = place.file_name().map(std::ffi::OsStr::to_string_lossy);
    if place.join("state.json").is_file() || (place.is_dir() && name.is_some_and(|n| is_step(&n))) {
        return Checkpoint::read(place).map_err(|e| Failure::new(Exit::InvalidInput, e));
    }
    let is_run = is_run(place);
    let folder = if is_run {
        only_training(place)?
    } else {
        // The folder of a training has one for each stage.
        let of_training = stage_folder(place, Stage::Separation);
        if of_training.is_dir() { of_training } else { place.to_owned() }
    };
    if let Some(best) = Best::read(&folder)? {
        match Checkpoint::read(&checkpoint_folder(&folder, best.step)) {
            Ok(checkpoint) => return Ok(checkpoint),
            Err(error) => {
                output
                    .warning(&format!("{error}; using the newest checkpoint instead of the best"));
            }
        }
    }
    let (newest, refused) = Checkpoint::newest(&folder, 1)
        .map_err(|e| failure!(Exit::Failed, "cannot list {}: {e}", folder.display()))?;
    for error in refused {
        output.warning(&error.to_string());
    }
    let place = place.display();
    newest.ok_or_else(|| {
        if is_run {
            failure!(
                Exit::InvalidInput,
                "{place} has no usable checkpoint of the separation stage; `glasshouse train {place} --stage separation --steps S` makes one"
            )
        } else {
            failure!(
                Exit::InvalidInput,
                "{place} holds no checkpoint; give the folder of a checkpoint (step-NNNNNNN), a stage (RUN/train/separation), a named training (RUN/train/NAME) or a run"
            )
        }
    })
}

/// True if the folder is a run.
pub(super) fn is_run(place: &Path) -> bool {
    place.join(keys::SPEC).is_file()
}

/// A training of a run with checkpoints of the separation stage.
pub(super) struct RunTraining {
    /// `None` for the training without a name.
    pub(super) name: Option<String>,
    pub(super) folder: PathBuf,
}

/// Lists the trainings of a run that have checkpoints of the separation stage, the one without a name first.
pub(super) fn trainings(run: &Path) -> Result<Vec<RunTraining>, Failure> {
    let all = training_folder(run, None);
    let failed = |e| failure!(Exit::Failed, "cannot list {}: {e}", all.display());
    let mut names = vec![None];
    match std::fs::read_dir(&all) {
        Ok(entries) => {
            for entry in entries {
                let name = entry.map_err(failed)?.file_name();
                names.extend(name.to_str().map(|name| Some(name.to_owned())));
            }
        }
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(failed(error)),
    }
    names.sort_unstable();
    let mut trainings = Vec::new();
    for name in names {
        let folder = training_folder(run, name.as_deref());
        let steps = steps(&stage_folder(&folder, Stage::Separation)).map_err(failed)?;
        if steps.last().is_some_and(|newest| *newest > 0) {
            trainings.push(RunTraining { name, folder });
        }
    }
    Ok(trainings)
}

/// Returns the folder of the separation stage of a run's only training, or of its training without a name.
fn only_training(run: &Path) -> Result<PathBuf, Failure> {
    let trainings = trainings(run)?;
    let named: Vec<&str> = trainings.iter().filter_map(|t| t.name.as_deref()).collect();
    let folder = match &trainings[..] {
        [only] => only.folder.clone(),
        [first, ..] if first.name.is_none() => first.folder.clone(),
        [] => training_folder(run, None),
        _ => {
            let (run, names) = (run.display(), named.join(", "));
            return Err(failure!(
                Exit::Usage,
                "{run} has several trainings: give {run}/train/NAME with one of {names}"
            ));
        }
    };
    Ok(stage_folder(&folder, Stage::Separation))
}
