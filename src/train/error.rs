//! Errors of training.

use super::checkpoint::CheckpointError;
use super::names::first_names;
use super::vgg_file::FeaturesError;
use examples::{ExampleError, TupleFilesError};
use plan::SettingError;
use render::atomic_file::WriteError;
use std::path::PathBuf;

#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    #[error("another process is training in {}; wait for it, or stop it", folder.display())]
    Busy { folder: PathBuf },
    #[error(
        "the folder {} was deleted, moved or replaced during training: put it back if it was moved, and train again",
        folder.display()
    )]
    Moved { folder: PathBuf },
    #[error("cannot read {}: {source}; check the disk, and train again", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error("cannot lock {}: {source}", path.display())]
    Lock { path: PathBuf, source: std::io::Error },
    #[error(
        "the separation stage begins with a BT-net, and {} has none: train it first with `glasshouse train {run} --stage backtrack --steps S`, or omit the a priori loss with --no-a-priori",
        folder.display()
    )]
    NoBacktrack {
        /// Folder of the training.
        folder: PathBuf,
        /// Run and name on the command line.
        run: String,
    },
    #[error(
        "a U-Net has no BT-net, so it has no backtrack stage: train it with `glasshouse train {run} --stage separation --network unet --steps S`"
    )]
    NoBacktrackStage {
        /// Run and name on the command line.
        run: String,
    },
    #[error(
        "the cosine of the learning rate ends at step {end}, before step {steps}: train to step {end}, or continue with --schedule-steps {steps} (the rate then rises again, to the larger cosine) or another --schedule"
    )]
    ScheduleEnds { end: u64, steps: u64 },
    #[error(transparent)]
    Setting(#[from] SettingError),
    #[error(
        "the settings differ from those of {}:\n  {}\nomit them, or undo the change of the recipe's [train], to resume that training; or begin another one with --name NAME",
        checkpoint.display(),
        differences.join("\n  ")
    )]
    Frozen {
        checkpoint: PathBuf,
        /// One entry per setting: `name: old -> new`.
        differences: Vec<String>,
    },
    #[error("a share of {share} of the steps needs real pairs: name their folder with --real")]
    NoRealPairs { share: f64 },
    #[error(
        "{changed} are not those that {} was trained with; use the same, or begin another training with --name NAME",
        checkpoint.display()
    )]
    OtherOrigin {
        /// The changed input: train scenes, real pairs, VGG-19's weights or first weights.
        changed: &'static str,
        checkpoint: PathBuf,
    },
    #[error(
        "{} of the tuples that {} was trained with changed or are missing: {}; begin another training with --name NAME, or put them back",
        names.len(), folder.display(), first_names(names)
    )]
    OtherTuples {
        /// Folder of the stage.
        folder: PathBuf,
        /// Names of the scenes, sorted.
        names: Vec<String>,
    },
    #[error("the weights of {} do not fit the networks: {source}", path.display())]
    From { path: PathBuf, source: candle_core::Error },
    #[error("{} holds no pair that can be read: give a folder of pairs for --select", folder.display())]
    NothingToSelect { folder: PathBuf },
    #[error(transparent)]
    Features(#[from] FeaturesError),
    #[error(transparent)]
    Tuples(TupleFilesError),
    #[error(transparent)]
    Example(#[from] ExampleError),
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    #[error(transparent)]
    Write(#[from] WriteError),
    #[error(transparent)]
    Tensor(#[from] candle_core::Error),
    #[error(
        "the loss of step {step} is {loss}; earlier checkpoints stay. A smaller --learning-rate may help"
    )]
    NotFinite { step: u64, loss: f32 },
}
