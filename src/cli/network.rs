//! The networks that a command works with: which checkpoint, with which features.

use super::args::{Global, threads};
use super::exit_code::{Exit, Failure};
use super::output::Output;
use crate::run::keys;
use anyhow::anyhow;
use clap::{Args as ClapArgs, ValueEnum};
use plan::{FeatureSource, Stage};
use std::path::{Path, PathBuf};
use train::candle_core::Device;
use train::{
    Best, Checkpoint, CheckpointState, Features, Separator, SeparatorError, checkpoint_folder,
    stage_folder,
};

/// Side of tiles.
pub(super) const TILE_PX: u32 = 768;

/// How networks are taken to work.
#[derive(Debug, ClapArgs)]
pub(super) struct NetworkArgs {
    /// VGG-19 weights, for networks that were trained with features of a file: the same file
    #[arg(long, value_name = "FILE")]
    pub(super) features: Option<String>,
    /// Larger pictures are done in overlapping tiles of this side, px: less memory, and another norm for each tile
    #[arg(long, value_name = "PX", default_value_t = TILE_PX, value_parser = clap::value_parser!(u32).range(272..=16384))]
    pub(super) tile_px: u32,
}

/// Where networks compute.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(super) enum DeviceName {
    /// The processor.
    #[default]
    Cpu,
    /// The first GPU.
    #[cfg(feature = "cuda")]
    Cuda,
}

impl DeviceName {
    /// Opens it.
    #[cfg_attr(
        not(feature = "cuda"),
        allow(clippy::unnecessary_wraps, reason = "a GPU may not be there")
    )]
    pub(super) fn open(self) -> Result<Device, Failure> {
        match self {
            Self::Cpu => Ok(Device::Cpu),
            #[cfg(feature = "cuda")]
            Self::Cuda => Device::new_cuda(0).map_err(|e| {
                let error = anyhow::anyhow!(
                    "no GPU can be used ({e}): see docs/training.md, or leave --device out"
                );
                Failure::new(Exit::Failed, error)
            }),
        }
    }
}

/// Makes the pool of threads that networks compute on, and says how many they are.
pub(super) fn use_threads(global: &Global) -> usize {
    let threads = threads(global);
    // `run` comes here twice: the pool stands already.
    let _ = rayon::ThreadPoolBuilder::new().num_threads(threads).build_global();
    threads
}

/// The file of VGG-19's weights, if `--features` names one.
pub(super) fn weights_file(typed: Option<&str>) -> Option<&Path> {
    typed.filter(|typed| !["none", "random"].contains(typed)).map(Path::new)
}

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
        let file = weights_file(weights);
        let Features { vgg, blake3 } = Features::load(settings, file, &Device::Cpu)
            .map_err(|e| Failure::new(Exit::InvalidInput, e))?;
        if let (Some(path), Some(blake3)) = (file, &blake3) {
            output.note(&format!("VGG-19 from {}, BLAKE3 {blake3}", path.display()));
        }
        let separator = Separator::new(&checkpoint, vgg, blake3.as_deref()).map_err(|error| {
            let exit = match error {
                SeparatorError::OtherFeatures { .. } => Exit::Disagrees,
                _ => Exit::InvalidInput,
            };
            Failure::new(exit, error)
        })?;
        Ok(Self { separator, path: checkpoint.path, state: checkpoint.state })
    }

    /// How a table's row is called: `name`, or stage and step, and what is unlike the paper's features.
    pub(super) fn row_name(&self, name: Option<&str>) -> String {
        let state = &self.state;
        let name = name
            .map_or_else(|| format!("{} step {}", state.stage.name(), state.step), str::to_owned);
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
    let folder = if is_run { stage_folder(place, Stage::Separation) } else { place.to_owned() };
    if which == Which::Best
        && let Some(best) = Best::read(&folder)
    {
        match Checkpoint::read(&checkpoint_folder(&folder, best.step), &Device::Cpu) {
            Ok(checkpoint) => return Ok(checkpoint),
            Err(error) => {
                output.warning(&format!("{error}; it was the best, the newest is taken instead"))
            }
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
