//! Why a training cannot begin or go on.

use super::checkpoint::CheckpointError;
use super::source::{ExampleError, TupleFilesError};
use super::vgg_file::FeaturesError;
use plan::SettingError;
use render::atomic_file::WriteError;
use std::path::PathBuf;

/// A training that cannot begin or go on.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// Another process has the stage.
    #[error("another process is training in {}; wait for it, or stop it", folder.display())]
    Busy { folder: PathBuf },
    /// The stage's lock file.
    #[error("cannot lock {}: {source}", path.display())]
    Lock { path: PathBuf, source: std::io::Error },
    /// There is no BT-net that SP-net could learn through.
    #[error(
        "the separation stage begins with a BT-net, and {run} has none: train it first with `glasshouse train {run} --stage backtrack --steps S`, or leave it out with --no-a-priori",
        run = run.display()
    )]
    NoBacktrack { run: PathBuf },
    /// A setting out of its range.
    #[error(transparent)]
    Setting(#[from] SettingError),
    /// Settings are frozen with the first checkpoint.
    #[error(
        "the settings differ from those of {}:\n  {}\nleave them out, or undo the change of the recipe's [train], to go on with that training; or train in a new run",
        checkpoint.display(),
        differences.join("\n  ")
    )]
    Frozen {
        checkpoint: PathBuf,
        /// `name: old -> new`.
        differences: Vec<String>,
    },
    /// Real pairs are asked for, and no folder of them was given.
    #[error("a share of {share} of the steps sees real pairs: give their folder with --real")]
    NoRealPairs { share: f64 },
    /// The checkpoint learned from something else.
    #[error(
        "{changed} are not those that {} was trained with; give the same, or train in a new run",
        checkpoint.display()
    )]
    OtherOrigin {
        /// The train scenes, the real pairs or VGG-19's weights.
        changed: &'static str,
        checkpoint: PathBuf,
    },
    /// VGG-19.
    #[error(transparent)]
    Features(#[from] FeaturesError),
    /// The place that holds the tuples does not list them.
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
    /// The loss is no number.
    #[error(
        "the loss of step {step} is {loss}: the last checkpoint before it is whole; a smaller learning rate may help (a new training: settings are frozen)"
    )]
    NotFinite {
        /// From 1.
        step: u64,
        loss: f32,
    },
}
