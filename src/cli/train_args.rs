//! What can be typed after `train`, `evaluate` and `separate`.

use super::args::{Global, RootArgs};
#[cfg(feature = "cuda")]
use super::exit_code::Exit;
use super::exit_code::Failure;
use super::split_name::SplitName;
use super::work_cmd::threads;
use clap::{Args as ClapArgs, ValueEnum};
use compose::Protocol;
use plan::{ExampleKind, FeatureSource, PixelSource, Stage, TrainSettings};
use std::path::{Path, PathBuf};
use train::candle_core::Device;

/// Checkpoints that are kept.
const KEEP: usize = 3;
/// Scenes that are validated on.
const VALIDATE: usize = 8;
/// Memory for examples.
const MEMORY_GB: f64 = 2.0;
/// Side of tiles.
const TILE_PX: u32 = 768;

/// Makes the pool of threads that networks compute on, and says how many they are.
pub(super) fn use_threads(global: &Global) -> usize {
    let threads = threads(global);
    // `run` comes here twice: the pool stands already.
    let _ = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build_global();
    threads
}

/// Where networks compute.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum DeviceName {
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

/// `--stage`
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum StageName {
    /// BT-net alone: R~ -> R.
    Backtrack,
    /// SP-net, I -> T and R~, with BT-net behind it.
    Separation,
}

impl From<StageName> for Stage {
    fn from(name: StageName) -> Self {
        match name {
            StageName::Backtrack => Self::Backtrack,
            StageName::Separation => Self::Separation,
        }
    }
}

/// `--examples`
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ExampleName {
    /// The run's tuples.
    Rendered,
    /// Its photographs, mixed as images by Zhang et al.'s recipe.
    Zhang,
    /// Its photographs, mixed as images by CEILNet's recipe.
    Ceilnet,
}

/// `--pixels`
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum PixelName {
    /// tuple.exr: not rounded to 8 bit.
    Exr,
    /// The PNGs.
    Png,
}

/// `train`
#[derive(Debug, ClapArgs)]
pub struct TrainArgs {
    /// Folder of the run
    pub run: PathBuf,
    /// Which networks learn; separation begins with the newest checkpoint of backtrack
    #[arg(long, value_enum)]
    pub stage: StageName,
    /// Steps in all; a training that has fewer goes on, whenever it was stopped
    #[arg(long, value_name = "S", value_parser = clap::value_parser!(u64).range(1..))]
    pub steps: u64,
    /// Folder of real pairs: blended/ and transmission_layer/, or as SIR2 and CEILNet name them
    #[arg(long, value_name = "DIR", requires = "real_share")]
    pub real: Option<PathBuf>,
    /// Write a checkpoint every so many steps [default: a twentieth of --steps, 10 to 1000]
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u64).range(1..))]
    pub checkpoint_every: Option<u64>,
    /// Checkpoints to keep, besides the best
    #[arg(long, value_name = "N", default_value_t = KEEP)]
    pub keep: usize,
    /// Scenes of the split "test" to measure every checkpoint on; the first ones
    #[arg(long, value_name = "N", default_value_t = VALIDATE)]
    pub validate: usize,
    /// Write a grid of pictures every so many steps; 0 for none [default: as --checkpoint-every]
    #[arg(long, value_name = "K")]
    pub pictures_every: Option<u64>,
    /// Memory for examples that were read, GB: a set that fits is read once
    #[arg(long, value_name = "GB", default_value_t = MEMORY_GB)]
    pub memory_gb: f64,
    /// Where networks compute; on a GPU last bits differ from run to run
    #[arg(long, value_enum, default_value = "cpu", hide = cfg!(not(feature = "cuda")))]
    pub device: DeviceName,
    /// Where the run's tuples are, if not in its folder
    #[arg(long, value_name = "URL", env = "GLASSHOUSE_STORE")]
    pub store: Option<String>,
    /// Named roots.
    #[command(flatten)]
    pub roots: RootArgs,
    /// What is learned from, and how. Last: its heading is for all that follows.
    #[command(flatten)]
    pub settings: SettingArgs,
    /// In place of `settings`: what the recipe of `run` says.
    #[arg(skip)]
    pub(super) recipe: Option<TrainSettings>,
}

/// Settings: frozen with the first checkpoint, from then on they need not be given.
#[derive(Debug, Default, ClapArgs)]
#[command(next_help_heading = "Settings (frozen with the first checkpoint; left out, they stay)")]
pub struct SettingArgs {
    /// What images are described by: none, random (VGG-19 with random weights), or a file of torchvision's vgg19 weights
    /// (.safetensors or .pth) [default: none]
    #[arg(long, value_name = "none|random|FILE")]
    pub features: Option<String>,
    /// Divides the widths of a random VGG-19 [default: 1]
    #[arg(long, value_name = "N")]
    pub vgg_divisor: Option<usize>,
    /// Channels of the generators [default: 64]
    #[arg(long, value_name = "N")]
    pub width: Option<usize>,
    /// Channels after the discriminator's first convolution [default: 64]
    #[arg(long, value_name = "N")]
    pub discriminator_width: Option<usize>,
    /// Examples a step [default: 1]
    #[arg(long, value_name = "N")]
    pub batch: Option<usize>,
    /// Side of the square that is cut from an example, px [default: 256]
    #[arg(long, value_name = "PX")]
    pub crop: Option<usize>,
    /// Do not mirror examples
    #[arg(long)]
    pub no_flip: bool,
    /// Step size of Adam [default: 1e-4]
    #[arg(long, value_name = "RATE")]
    pub learning_rate: Option<f64>,
    /// Weight of mean absolute differences [default: 1]
    #[arg(long, value_name = "W")]
    pub pixel_weight: Option<f64>,
    /// Weight of feature losses [default: 0.2]
    #[arg(long, value_name = "W")]
    pub feature_weight: Option<f64>,
    /// Weight of adversarial losses; 0: no discriminator [default: 0.01]
    #[arg(long, value_name = "W")]
    pub adversarial_weight: Option<f64>,
    /// Without the a priori loss: SP-net does not learn through BT-net (the paper's ablation)
    #[arg(long)]
    pub no_a_priori: bool,
    /// Where examples come from [default: rendered]
    #[arg(long, value_enum)]
    pub examples: Option<ExampleName>,
    /// From which files of a tuple [default: exr]
    #[arg(long, value_enum)]
    pub pixels: Option<PixelName>,
    /// Share of the steps that see pairs of --real [default: 0]
    #[arg(long, value_name = "SHARE")]
    pub real_share: Option<f64>,
    /// Train while the farm still merges: the first epoch goes in the manifest's order and waits for tuples
    #[arg(long)]
    pub follow: bool,
    /// Seed of weights, order, crops and flips [default: 2020]
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
}

impl SettingArgs {
    /// `base` with what was typed in its place.
    pub(super) fn over(&self, base: &TrainSettings) -> TrainSettings {
        let mut settings = base.clone();
        settings.features = match self.features.as_deref() {
            None => settings.features,
            Some("none") => FeatureSource::None,
            Some("random") => FeatureSource::Random,
            Some(_) => FeatureSource::File,
        };
        put(&mut settings.vgg_divisor, self.vgg_divisor);
        put(&mut settings.width, self.width);
        put(&mut settings.discriminator_width, self.discriminator_width);
        put(&mut settings.batch, self.batch);
        put(&mut settings.crop_px, self.crop);
        put(&mut settings.learning_rate, self.learning_rate);
        put(&mut settings.pixel_weight, self.pixel_weight);
        put(&mut settings.feature_weight, self.feature_weight);
        put(&mut settings.adversarial_weight, self.adversarial_weight);
        put(&mut settings.real_share, self.real_share);
        put(&mut settings.seed, self.seed);
        let examples = self.examples.map(|name| match name {
            ExampleName::Rendered => ExampleKind::Rendered,
            ExampleName::Zhang => ExampleKind::Zhang,
            ExampleName::Ceilnet => ExampleKind::Ceilnet,
        });
        put(&mut settings.examples, examples);
        let pixels = self.pixels.map(|name| match name {
            PixelName::Exr => PixelSource::Exr,
            PixelName::Png => PixelSource::Png,
        });
        put(&mut settings.pixels, pixels);
        settings.flip &= !self.no_flip;
        settings.a_priori &= !self.no_a_priori;
        settings.follow |= self.follow;
        settings
    }
}

/// What was typed, in its place.
fn put<T: Copy>(place: &mut T, typed: Option<T>) {
    if let Some(value) = typed {
        *place = value;
    }
}

/// How networks are taken to work.
#[derive(Debug, ClapArgs)]
pub struct NetworkArgs {
    /// VGG-19 weights, for networks that were trained with features of a file: the same file
    #[arg(long, value_name = "FILE")]
    pub features: Option<String>,
    /// Larger pictures are done in overlapping tiles of this side, px: less memory, and another norm for each tile
    #[arg(long, value_name = "PX", default_value_t = TILE_PX, value_parser = clap::value_parser!(u32).range(272..=16384))]
    pub tile_px: u32,
}

/// `separate`
#[derive(Debug, ClapArgs)]
pub struct SeparateArgs {
    /// A checkpoint's folder; or a stage's or a run's, for its best checkpoint, or its newest where none was measured
    pub checkpoint: PathBuf,
    /// Pictures, JPEG or PNG
    #[arg(required = true)]
    pub images: Vec<PathBuf>,
    /// Folder to write NAME.transmission.png and NAME.glass_reflection.png to
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// The networks.
    #[command(flatten)]
    pub network: NetworkArgs,
}

/// `--protocol`
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ProtocolName {
    /// Kim et al.'s: PSNR of all channels together, SSIM of the grey pictures.
    Paper,
    /// Of ERRNet and those after it: means over the channels.
    Errnet,
    /// Side by side.
    Both,
}

impl From<ProtocolName> for Protocol {
    fn from(name: ProtocolName) -> Self {
        match name {
            ProtocolName::Paper => Self::Paper,
            ProtocolName::Errnet => Self::Errnet,
            ProtocolName::Both => Self::Both,
        }
    }
}

/// `evaluate`
#[derive(Debug, ClapArgs)]
pub struct EvaluateArgs {
    /// Folder of a run; or of pairs: blended/ and transmission_layer/, or as SIR2 and CEILNet name them
    #[arg(value_name = "RUN|DIR")]
    pub place: PathBuf,
    /// Networks to score, named as here or by stage and step; a folder as of `separate`; repeatable [default: the run's own]
    #[arg(long = "checkpoint", value_name = "[NAME=]FOLDER")]
    pub checkpoints: Vec<String>,
    /// Which scenes of a run
    #[arg(long, value_enum, default_value = "test")]
    pub split: SplitName,
    /// Which scores the table shows; the files have all
    #[arg(long, value_enum, default_value = "both")]
    pub protocol: ProtocolName,
    /// Folder to write evaluation.md, .csv, .png (some pictures) and .json to [default: RUN/train/evaluation; of pairs: none]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Fit the input's gain to pairs of this folder, or to this run's train scenes [default: the run's own; of pairs: no gain]
    #[arg(long, value_name = "RUN|DIR")]
    pub fit_gain: Option<PathBuf>,
    /// Score only the first N pairs
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub limit: Option<u32>,
    /// The networks.
    #[command(flatten)]
    pub network: NetworkArgs,
    /// Where the run's tuples are, if not in its folder
    #[arg(long, value_name = "URL", env = "GLASSHOUSE_STORE")]
    pub store: Option<String>,
}

impl TrainArgs {
    /// A stage of a recipe's `[train]`: the run's settings, everything else as nobody said otherwise.
    pub(super) fn of_recipe(
        run: &Path,
        stage: StageName,
        steps: u64,
        settings: &TrainSettings,
    ) -> Self {
        Self {
            run: run.to_owned(),
            stage,
            steps,
            settings: SettingArgs::default(),
            recipe: Some(settings.clone()),
            real: None,
            // Validation takes longer than a step of small networks.
            checkpoint_every: Some((steps / 4).max(1)),
            keep: KEEP,
            validate: VALIDATE,
            pictures_every: None,
            memory_gb: MEMORY_GB,
            device: DeviceName::Cpu,
            store: None,
            roots: RootArgs { roots: Vec::new() },
        }
    }
}

impl EvaluateArgs {
    /// The networks of a run on its test scenes.
    pub(super) fn of_run(run: &Path) -> Self {
        Self {
            place: run.to_owned(),
            checkpoints: Vec::new(),
            split: SplitName::Test,
            protocol: ProtocolName::Both,
            out: None,
            fit_gain: None,
            limit: None,
            network: NetworkArgs {
                features: None,
                tile_px: TILE_PX,
            },
            store: None,
        }
    }
}
