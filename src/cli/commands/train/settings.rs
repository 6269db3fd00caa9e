//! The settings of training on the command line.

use clap::{Args as ClapArgs, ValueEnum};
use plan::{
    ExampleKind, FeatureSource, FeatureStyle, NetworkKind, OptimizerKind, PixelSource, Preset,
    ScheduleKind, Start, TrainSettings,
};

/// Settings that the first checkpoint records; later commands need not repeat them.
#[derive(Debug, Default, ClapArgs)]
#[command(
    next_help_heading = "Settings (recorded by the first checkpoint; only rates may change later)"
)]
pub(super) struct SettingArgs {
    /// Settings of a published training, in place of the defaults or of the recipe's; needs --features FILE
    #[arg(long, value_enum)]
    preset: Option<PresetName>,
    /// Image features: none, random (VGG-19 with random weights), or a file of torchvision's vgg19 weights (.safetensors
    /// or .pth) [default: none]
    #[arg(long, value_name = "none|random|FILE")]
    pub(super) features: Option<String>,
    /// Computation of the features [default: torch]
    #[arg(long, value_enum)]
    feature_style: Option<StyleName>,
    /// Divisor of the widths of a random VGG-19 [default: 1]
    #[arg(long, value_name = "N")]
    vgg_divisor: Option<usize>,
    /// Network that separates; a U-Net starts as residual and has no a priori loss [default: generator]
    #[arg(long, value_enum)]
    network: Option<NetworkName>,
    /// Initial weights of the networks [default: identity; of a U-Net: residual]
    #[arg(long, value_enum)]
    start: Option<StartName>,
    /// Largest light of T* as a multiple of the light of I [default: none]
    #[arg(long, value_name = "FACTOR|none", value_parser = bound)]
    bound: Option<f64>,
    /// Channels of the generators, or of a U-Net at its largest size [default: 64]
    #[arg(long, value_name = "N")]
    width: Option<usize>,
    /// Channels after the discriminator's first convolution [default: 64]
    #[arg(long, value_name = "N")]
    discriminator_width: Option<usize>,
    /// Examples per step [default: 1]
    #[arg(long, value_name = "N")]
    batch: Option<usize>,
    /// Side of the square crop of an example, px [default: 256]
    #[arg(long, value_name = "PX")]
    crop: Option<usize>,
    /// Do not mirror examples
    #[arg(long)]
    no_flip: bool,
    /// Learning rate; with a schedule, the largest [default: 1e-4]
    #[arg(long, value_name = "RATE")]
    learning_rate: Option<f64>,
    /// Learning rate of the discriminators; 0 for that of the networks [default: 0]
    #[arg(long, value_name = "RATE")]
    discriminator_learning_rate: Option<f64>,
    /// Optimiser of the networks [default: adam]
    #[arg(long, value_enum)]
    optimizer: Option<OptimizerName>,
    /// Decay rates of the optimiser's two running means [default: 0.9,0.999]
    #[arg(long, value_name = "B1,B2", value_delimiter = ',', num_args = 1)]
    betas: Vec<f64>,
    /// Weight decay of AdamW [default: 0]
    #[arg(long, value_name = "D")]
    weight_decay: Option<f64>,
    /// Course of the learning rate [default: constant]
    #[arg(long, value_enum)]
    schedule: Option<ScheduleName>,
    /// First steps, in which the learning rate rises from 0 [default: 0]
    #[arg(long, value_name = "N")]
    warmup_steps: Option<u64>,
    /// Step at which the cosine ends [default: --steps of the first call]
    #[arg(long, value_name = "S")]
    schedule_steps: Option<u64>,
    /// Steps after which schedule "step" multiplies the rate
    #[arg(long, value_name = "S,S,...", value_delimiter = ',')]
    decay_steps: Vec<u64>,
    /// Factor of schedule "step" [default: 0.5]
    #[arg(long, value_name = "F")]
    decay_factor: Option<f64>,
    /// Largest norm of the gradients of a step; 0 for no limit [default: 0]
    #[arg(long, value_name = "NORM")]
    clip_norm: Option<f64>,
    /// Decay of the running mean of the weights, which checkpoints use; 0 for none [default: 0]
    #[arg(long, value_name = "DECAY")]
    ema: Option<f64>,
    /// Weight of mean absolute differences [default: 1]
    #[arg(long, value_name = "W")]
    pixel_weight: Option<f64>,
    /// Weight of mean absolute differences of slopes between neighbouring pixels [default: 0]
    #[arg(long, value_name = "W")]
    gradient_weight: Option<f64>,
    /// Weight of feature losses [default: 0.2]
    #[arg(long, value_name = "W")]
    feature_weight: Option<f64>,
    /// Weight of adversarial losses; 0 disables the discriminator [default: 0.01]
    #[arg(long, value_name = "W")]
    adversarial_weight: Option<f64>,
    /// Train without the a priori loss: SP-net does not learn through BT-net (the paper's ablation)
    #[arg(long)]
    no_a_priori: bool,
    /// Train on the first N scenes of the split "train" only; 0 for all [default: 0]
    #[arg(long, value_name = "N")]
    scenes: Option<usize>,
    /// Source of the examples [default: rendered]
    #[arg(long, value_enum)]
    examples: Option<ExampleName>,
    /// Camera of composed examples and mixtures of tuples: blur, noise, curve, JPEG [default: on]
    #[arg(long, value_enum)]
    camera: Option<Switch>,
    /// Files of a tuple to read [default: exr]
    #[arg(long, value_enum)]
    pixels: Option<PixelName>,
    /// Share of the steps that use pairs of --real [default: 0]
    #[arg(long, value_name = "SHARE")]
    real_share: Option<f64>,
    /// Train while the farm still merges: the first epoch follows the manifest's order and waits for tuples
    #[arg(long)]
    follow: bool,
    /// Seed of weights, order, crops and flips [default: 2020]
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum ExampleName {
    /// The run's tuples.
    Rendered,
    /// A tuple's front with another tuple's reflection, in linear light.
    Composed,
    /// A tuple's transmission with another tuple's blurred transmission, in linear light.
    LinearMixtures,
    /// The same, less what exceeds white, and with a vignette, as Zhang et al. mix photographs.
    ZhangMixtures,
    /// The same with codes in place of linear light, as CEILNet mixes photographs.
    CeilnetMixtures,
    /// The run's photographs, blended by Zhang et al.'s recipe.
    Zhang,
    /// The run's photographs, blended by CEILNet's recipe.
    Ceilnet,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum PresetName {
    /// The text of Kim, Huo and Yoon.
    #[value(name = "kim2020-text")]
    Text,
    /// Their program: pixels weigh 52, caffe's features, rates 2e-4 and 1e-4.
    #[value(name = "kim2020-code")]
    Code,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum StyleName {
    /// As torchvision.
    Torch,
    /// As the programs of Zhang et al. and Kim et al., with average pools.
    Caffe,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Switch {
    On,
    Off,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum PixelName {
    /// tuple.exr, with floating-point pixels.
    Exr,
    /// The PNGs, with 8-bit pixels.
    Png,
    /// The photographs of scenes with a sensor.
    Photograph,
}

impl From<PixelName> for PixelSource {
    fn from(name: PixelName) -> Self {
        match name {
            PixelName::Exr => Self::Exr,
            PixelName::Png => Self::Png,
            PixelName::Photograph => Self::Photograph,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum NetworkName {
    /// The paper's generators, for T* and R~*.
    Generator,
    /// A residual U-Net, for T* alone.
    Unet,
}

impl From<NetworkName> for NetworkKind {
    fn from(name: NetworkName) -> Self {
        match name {
            NetworkName::Generator => Self::Generator,
            NetworkName::Unet => Self::Unet,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum StartName {
    /// Convolutions that copy channels, and a random last layer.
    Identity,
    /// Random convolutions.
    Random,
    /// The whole network as the identity: T* = I.
    Residual,
}

impl From<StartName> for Start {
    fn from(name: StartName) -> Self {
        match name {
            StartName::Identity => Self::Identity,
            StartName::Random => Self::Random,
            StartName::Residual => Self::Residual,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum OptimizerName {
    /// Without weight decay.
    Adam,
    /// With decoupled weight decay.
    Adamw,
}

impl From<OptimizerName> for OptimizerKind {
    fn from(name: OptimizerName) -> Self {
        match name {
            OptimizerName::Adam => Self::Adam,
            OptimizerName::Adamw => Self::Adamw,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ScheduleName {
    /// The same rate in every step.
    Constant,
    /// Half a cosine, to 0 at --schedule-steps.
    Cosine,
    /// A factor at each of --decay-steps.
    Step,
}

impl From<ScheduleName> for ScheduleKind {
    fn from(name: ScheduleName) -> Self {
        match name {
            ScheduleName::Constant => Self::Constant,
            ScheduleName::Cosine => Self::Cosine,
            ScheduleName::Step => Self::Step,
        }
    }
}

impl SettingArgs {
    /// Returns `base`, overridden by the settings on the command line.
    pub(super) fn over(&self, base: &TrainSettings) -> TrainSettings {
        let preset = self.preset.map(|name| match name {
            PresetName::Text => Preset::Kim2020Text,
            PresetName::Code => Preset::Kim2020Code,
        });
        let mut settings = preset.map_or_else(|| base.clone(), TrainSettings::preset);
        settings.features = match self.features.as_deref() {
            None => settings.features,
            Some("none") => FeatureSource::None,
            Some("random") => FeatureSource::Random,
            Some(_) => FeatureSource::File,
        };
        let style = self.feature_style.map(|name| match name {
            StyleName::Torch => FeatureStyle::Torch,
            StyleName::Caffe => FeatureStyle::Caffe,
        });
        put(&mut settings.feature_style, style);
        put(&mut settings.network, self.network.map(Into::into));
        if self.network == Some(NetworkName::Unet) {
            settings.start = Start::Residual;
            settings.a_priori = false;
        }
        put(&mut settings.start, self.start.map(Into::into));
        put(&mut settings.bound, self.bound);
        self.optimizer_over(&mut settings);
        put(&mut settings.vgg_divisor, self.vgg_divisor);
        put(&mut settings.width, self.width);
        put(&mut settings.discriminator_width, self.discriminator_width);
        put(&mut settings.batch, self.batch);
        put(&mut settings.crop_px, self.crop);
        put(&mut settings.pixel_weight, self.pixel_weight);
        put(&mut settings.gradient_weight, self.gradient_weight);
        put(&mut settings.feature_weight, self.feature_weight);
        put(&mut settings.adversarial_weight, self.adversarial_weight);
        put(&mut settings.real_share, self.real_share);
        put(&mut settings.seed, self.seed);
        put(&mut settings.scenes, self.scenes);
        let examples = self.examples.map(|name| match name {
            ExampleName::Rendered => ExampleKind::Rendered,
            ExampleName::Composed => ExampleKind::Composed,
            ExampleName::LinearMixtures => ExampleKind::LinearMixtures,
            ExampleName::ZhangMixtures => ExampleKind::ZhangMixtures,
            ExampleName::CeilnetMixtures => ExampleKind::CeilnetMixtures,
            ExampleName::Zhang => ExampleKind::Zhang,
            ExampleName::Ceilnet => ExampleKind::Ceilnet,
        });
        put(&mut settings.examples, examples);
        let camera = self.camera.map(|switch| switch == Switch::On);
        put(&mut settings.composition.camera.enabled, camera);
        put(&mut settings.pixels, self.pixels.map(Into::into));
        settings.flip &= !self.no_flip;
        settings.a_priori &= !self.no_a_priori;
        settings.follow |= self.follow;
        settings
    }

    fn optimizer_over(&self, settings: &mut TrainSettings) {
        put(&mut settings.learning_rate, self.learning_rate);
        put(&mut settings.discriminator_learning_rate, self.discriminator_learning_rate);
        put(&mut settings.optimizer, self.optimizer.map(Into::into));
        put(&mut settings.betas, self.betas.as_slice().try_into().ok());
        put(&mut settings.weight_decay, self.weight_decay);
        put(&mut settings.schedule, self.schedule.map(Into::into));
        put(&mut settings.warmup_steps, self.warmup_steps);
        put(&mut settings.schedule_steps, self.schedule_steps);
        if !self.decay_steps.is_empty() {
            settings.decay_steps.clone_from(&self.decay_steps);
        }
        put(&mut settings.decay_factor, self.decay_factor);
        put(&mut settings.clip_norm, self.clip_norm);
        put(&mut settings.ema, self.ema);
    }
}

fn put<T: Copy>(place: &mut T, typed: Option<T>) {
    *place = typed.unwrap_or(*place);
}

/// Parses the factor of the bound; "none" is 0.
fn bound(text: &str) -> Result<f64, String> {
    if text == "none" {
        return Ok(0.0);
    }
    text.parse().map_err(|_| "expected a number or none".to_owned())
}
