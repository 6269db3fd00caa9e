//! The networks that a command works with: which checkpoint, with which features.

use super::exit_code::{Exit, Failure};
use super::output::Output;
use super::train_cmd::stage_folder;
use super::train_vgg::{Features, features};
use crate::run::keys;
use anyhow::anyhow;
use plan::{FeatureSource, Stage};
use std::path::{Path, PathBuf};
use train::candle_core::Device;
use train::{Best, Checkpoint, CheckpointState, Separator, SeparatorError, checkpoint_folder};

/// Networks, ready to work.
pub(super) struct Network {
    pub(super) separator: Separator,
    /// Folder of the checkpoint.
    pub(super) path: PathBuf,
    pub(super) state: CheckpointState,
}

/// Which of a stage's checkpoints.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Which {
    /// The best on validation scenes, or the newest where none was measured.
    Best,
    /// The newest. Scores are taken of it: the best was chosen by scenes that would be scored.
    Newest,
}

impl Network {
    /// Of a checkpoint's folder, a stage's or a run's. `weights` is VGG-19's file, if one was typed.
    pub(super) fn open(
        place: &Path,
        which: Which,
        weights: Option<&str>,
        output: &Output,
    ) -> Result<Self, Failure> {
        let checkpoint = checkpoint(place, which, output)?;
        let settings = &checkpoint.state.settings;
        if weights.is_some() && settings.features != FeatureSource::File {
            output.note(&format!(
                "{} sees no features of a file: --features is not used for it",
                checkpoint.path.display()
            ));
        }
        let Features { vgg, blake3 } =
            features(settings, weights, &train::candle_core::Device::Cpu, output)?;
        let separator = Separator::new(&checkpoint, vgg, blake3.as_deref()).map_err(|error| {
            let exit = match error {
                SeparatorError::OtherFeatures { .. } => Exit::Disagrees,
                _ => Exit::InvalidInput,
            };
            Failure::new(exit, error)
        })?;
        Ok(Self {
            separator,
            path: checkpoint.path,
            state: checkpoint.state,
        })
    }

    /// How a table's row is called: `name`, or stage and step, and what is unlike the paper's features.
    pub(super) fn row_name(&self, name: Option<&str>) -> String {
        let state = &self.state;
        let name = name.map_or_else(
            || format!("{} step {}", state.stage.name(), state.step),
            str::to_owned,
        );
        match state.settings.features {
            FeatureSource::File => name,
            FeatureSource::Random => format!("{name} (features random)"),
            FeatureSource::None => format!("{name} (features none)"),
        }
    }
}

fn checkpoint(place: &Path, which: Which, output: &Output) -> Result<Checkpoint, Failure> {
    let is_step = |name: &str| name.starts_with("step-");
    let name = place.file_name().map(std::ffi::OsStr::to_string_lossy);
    if place.join("state.json").is_file() || (place.is_dir() && name.is_some_and(|n| is_step(&n))) {
        return Checkpoint::read(place, &Device::Cpu)
            .map_err(|e| Failure::new(Exit::InvalidInput, e));
    }
    let is_run = place.join(keys::SPEC).is_file();
    let folder = if is_run {
        stage_folder(place, Stage::Separation)
    } else {
        place.to_owned()
    };
    if which == Which::Best
        && let Some(best) = Best::read(&folder)
    {
        match Checkpoint::read(&checkpoint_folder(&folder, best.step), &Device::Cpu) {
            Ok(checkpoint) => return Ok(checkpoint),
            Err(error) => output.warning(&format!(
                "{error}; it was the best, the newest is taken instead"
            )),
        }
    }
    let (newest, refused) = Checkpoint::newest(&folder, &Device::Cpu);
    for error in refused {
        output.warning(&error.to_string());
    }
    newest.ok_or_else(|| {
        let error = if is_run {
            anyhow!(
                "{run} has no checkpoint of the separation stage that can be used; `glasshouse train {run} --stage separation --steps S` makes one",
                run = place.display()
            )
        } else {
            anyhow!(
                "{} holds no checkpoint; give a checkpoint's folder (step-NNNNNNN), that of its stage (RUN/train/separation), or a run",
                place.display()
            )
        };
        Failure::new(Exit::InvalidInput, error)
    })
}
