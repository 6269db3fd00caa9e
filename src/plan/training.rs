//! `[train]` of a recipe: all settings that change the result of training.

use super::sensor::SensorRecipe;
use compose::Composition;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// A stage of training, which determines the networks that learn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    /// BT-net alone: R~ -> R.
    Backtrack,
    /// SP-net, I -> (T, R~), followed by BT-net, which also learns if the a priori loss is used.
    Separation,
}

impl Stage {
    /// Returns the name on the command line, which is also the name of the folder of checkpoints.
    pub fn name(self) -> &'static str {
        match self {
            Self::Backtrack => "backtrack",
            Self::Separation => "separation",
        }
    }
}

/// Image features for the hypercolumn and the feature loss.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FeatureSource {
    /// No features: the networks read red, green and blue, and the loss has no feature term.
    #[default]
    None,
    /// VGG-19 with random weights from `seed`; the paper uses trained weights.
    Random,
    /// VGG-19 with weights from a file.
    File,
}

/// Computation of the image features of a VGG-19.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FeatureStyle {
    /// As torchvision: R, G and B normalised by ImageNet's means and deviations, maximum pools. Features are resized with
    /// pixel centres at halves.
    #[default]
    Torch,
    /// As the programs of Zhang et al. and of Kim et al.: codes from 0 to 255 in the order B, G, R less 123.68, 116.779 and
    /// 103.939, average pools. The hypercolumn has the features divided by 255, resized as in TensorFlow 1.
    Caffe,
}

/// Source of training examples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ExampleKind {
    /// The run's tuples, rendered with glass and lens.
    #[default]
    Rendered,
    /// a F_i + b R~_j in linear light, composed of the run's tuples.
    Composed,
    /// The same of the tuples' transmissions, a T_i + b blur(T_j): linear light without glass.
    LinearMixtures,
    /// Linear mixtures whose reflections are darkened as Zhang, Ng and Chen (CVPR 2018) do.
    ZhangMixtures,
    /// Mixtures of the transmissions' codes as CEILNet's, with the numbers of composed examples.
    CeilnetMixtures,
    /// Image-space mixtures of the scenes' photographs by the method of Zhang, Ng and Chen (CVPR 2018).
    Zhang,
    /// Image-space mixtures of the scenes' photographs by the method of Fan et al. (CEILNet, ICCV 2017).
    Ceilnet,
}

impl ExampleKind {
    /// True if the examples are made of the run's tuples.
    pub fn needs_tuples(self) -> bool {
        self == Self::Rendered || self.is_composed()
    }

    /// True if the examples follow the settings of `composition`.
    pub fn is_composed(self) -> bool {
        matches!(
            self,
            Self::Composed | Self::LinearMixtures | Self::ZhangMixtures | Self::CeilnetMixtures
        )
    }
}

/// Files of a tuple that contain the pixels for training.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PixelSource {
    /// `tuple.exr`: sRGB-coded, clamped to [0, 1], not rounded to 8 bits.
    #[default]
    Exr,
    /// The 8-bit PNGs.
    Png,
    /// The photographs of scenes with a sensor: I behind the camera, T and R~ without noise. R, which no camera sees, is its
    /// PNG if the photographs have the film's size, and is missing otherwise.
    Photograph,
}

/// Architecture of the network that separates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum NetworkKind {
    /// The paper's generators: SP-net for T* and R~*, and BT-net.
    #[default]
    Generator,
    /// A residual U-Net at half of the size, for T* alone: no BT-net and no backtrack stage.
    Unet,
}

/// Rule of the optimiser of the networks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum OptimizerKind {
    /// Adam (Kingma and Ba, ICLR 2015), without weight decay.
    #[default]
    Adam,
    /// Adam with decoupled weight decay (Loshchilov and Hutter, ICLR 2019).
    Adamw,
}

/// Course of the learning rate after the warm-up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ScheduleKind {
    /// The same rate in every step.
    #[default]
    Constant,
    /// Half a cosine, from the rate to 0 at step `schedule_steps`, where training ends.
    Cosine,
    /// The rate times `decay_factor` for each of `decay_steps` that is past.
    Step,
}

/// Initial weights of generators.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Start {
    /// Each convolution except the last copies the first input channels (Zhang et al.).
    #[default]
    Identity,
    /// Each convolution except the last has normal weights with standard deviation sqrt(2 / inputs) (He et al.).
    Random,
    /// The networks begin as the identity: the last convolution begins with zeros, and its output is added to the input
    /// image (T* = I, R~* = 0, R* = R~). The other convolutions of generators are those of `identity`; those of a U-Net
    /// have uniform weights within +-1 / sqrt(inputs), as in PyTorch.
    Residual,
}

/// Settings of training. The first checkpoint fixes all of them except [`FREE`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TrainSettings {
    /// Seed of initial weights, random features, and the order and augmentation of examples.
    pub seed: u64,
    /// Image features for the hypercolumn and the feature loss.
    pub features: FeatureSource,
    /// Architecture of the network that separates; a U-Net needs `start = "residual"` and `a_priori = false`.
    pub network: NetworkKind,
    /// Divisor of the widths of VGG-19, a power of two; 1 for the published widths.
    pub vgg_divisor: usize,
    /// Number of hidden channels of the generators, or of a U-Net at its largest size.
    pub width: usize,
    /// Number of channels after the discriminators' first convolution.
    pub discriminator_width: usize,
    /// Initial weights of the generators.
    pub start: Start,
    /// Largest light of T* as a multiple of the light of I, per pixel and channel; 0 for no bound. A reflection only
    /// adds light, and glass transmits more than 1 / 1.2 of it.
    pub bound: f64,
    /// Number of examples per step.
    pub batch: usize,
    /// Side of the square crop of an example, px.
    pub crop_px: usize,
    /// True if examples are mirrored with probability 1/2.
    pub flip: bool,
    /// Step size of the optimisers; with a schedule, the largest.
    pub learning_rate: f64,
    /// Rule of the networks' optimiser. Discriminators learn by Adam.
    pub optimizer: OptimizerKind,
    /// Decay rates of the running means of gradients and of squared gradients.
    pub betas: [f64; 2],
    /// Share of each weight that a step of AdamW removes, times the learning rate.
    pub weight_decay: f64,
    /// Course of the learning rate.
    pub schedule: ScheduleKind,
    /// Number of first steps in which the rate rises in proportion to the step.
    pub warmup_steps: u64,
    /// Last step of the cosine; 0 for the number of steps of the first call.
    pub schedule_steps: u64,
    /// Steps after which the rate is multiplied by `decay_factor`, in ascending order.
    pub decay_steps: Vec<u64>,
    /// Factor of the rate at each of `decay_steps`.
    pub decay_factor: f64,
    /// Largest norm of the gradients of all weights together; larger gradients are scaled down to it. 0 for no limit.
    pub clip_norm: f64,
    /// Decay of the running mean of the weights that the checkpoint's model holds, at most n / (n + 20) in step n; 0 to
    /// use the weights themselves.
    pub ema: f64,
    /// Weight of the mean absolute differences. The paper does not state a value.
    pub pixel_weight: f64,
    /// Weight of the mean absolute differences of neighbouring pixels' differences, along rows plus along columns.
    pub gradient_weight: f64,
    /// Weight of the feature losses; 0.2 in the paper.
    pub feature_weight: f64,
    /// Weight of the adversarial losses; 0 omits the discriminators. Zhang et al. use 1 with 100 for all other losses.
    pub adversarial_weight: f64,
    /// Number of steps between updates of the discriminators; 2 in Zhang et al.
    pub discriminator_every: u64,
    /// True if SP-net also gets the gradients of the a priori loss, through BT-net.
    pub a_priori: bool,
    /// Number of scenes of the split `train` to use, the first ones; 0 for all. Shows how many scenes are enough.
    pub scenes: usize,
    /// Source of the examples.
    pub examples: ExampleKind,
    /// Distributions of composed examples and of mixtures of tuples; the other kinds ignore them.
    pub composition: Composition,
    /// The camera of composed examples and of mixtures, with the keys of a recipe's `[sensor]`, in place of
    /// `composition.camera`. Each example draws its numbers. Its exposure is used only if that of `composition` is `of_tuple`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sensor: Option<Box<SensorRecipe>>,
    /// Files of a tuple that contain the pixels.
    pub pixels: PixelSource,
    /// Share of steps with real photographs, from 0 to 1.
    pub real_share: f64,
    /// True to wait for missing tuples; the first epoch then uses the manifest's order, in which a farm renders scenes.
    pub follow: bool,
    /// Computation of the features.
    pub feature_style: FeatureStyle,
    /// Step size of the discriminators' optimiser; with a schedule, the largest. 0 for `learning_rate`.
    pub discriminator_learning_rate: f64,
}

impl Default for TrainSettings {
    fn default() -> Self {
        Self {
            seed: 2020,
            features: FeatureSource::None,
            network: NetworkKind::Generator,
            vgg_divisor: 1,
            width: 64,
            discriminator_width: 64,
            start: Start::Identity,
            bound: 0.0,
            batch: 1,
            crop_px: 256,
            flip: true,
            learning_rate: 1e-4,
            optimizer: OptimizerKind::Adam,
            betas: [0.9, 0.999],
            weight_decay: 0.0,
            schedule: ScheduleKind::Constant,
            warmup_steps: 0,
            schedule_steps: 0,
            decay_steps: Vec::new(),
            decay_factor: 0.5,
            clip_norm: 0.0,
            ema: 0.0,
            pixel_weight: 1.0,
            gradient_weight: 0.0,
            feature_weight: 0.2,
            adversarial_weight: 0.01,
            discriminator_every: 2,
            a_priori: true,
            scenes: 0,
            examples: ExampleKind::Rendered,
            composition: Composition::default(),
            sensor: None,
            pixels: PixelSource::Exr,
            real_share: 0.0,
            follow: false,
            feature_style: FeatureStyle::Torch,
            discriminator_learning_rate: 0.0,
        }
    }
}

/// Settings that may change when a training resumes.
pub const FREE: [&str; 9] = [
    "learning_rate",
    "discriminator_learning_rate",
    "weight_decay",
    "schedule",
    "warmup_steps",
    "schedule_steps",
    "decay_steps",
    "decay_factor",
    "clip_norm",
];

impl TrainSettings {
    /// Returns the networks' learning rate in a step, counted from 1.
    pub fn rate(&self, step: u64) -> f64 {
        self.scheduled(self.learning_rate, step)
    }

    /// Returns the discriminators' learning rate in a step, counted from 1.
    pub fn discriminator_rate(&self, step: u64) -> f64 {
        match self.discriminator_learning_rate {
            0.0 => self.rate(step),
            largest => self.scheduled(largest, step),
        }
    }

    fn scheduled(&self, largest: f64, step: u64) -> f64 {
        let warmth = match self.warmup_steps {
            0 => 1.0,
            warmup => (step as f64 / warmup as f64).min(1.0),
        };
        let course = match self.schedule {
            ScheduleKind::Constant => 1.0,
            ScheduleKind::Cosine => {
                let done = step as f64 / self.schedule_steps.max(1) as f64;
                0.5 * (1.0 + libm::cos(std::f64::consts::PI * done.min(1.0)))
            }
            ScheduleKind::Step => {
                let past = self.decay_steps.iter().filter(|decay| **decay < step).count();
                (0..past).fold(1.0, |course, _| course * self.decay_factor)
            }
        };
        largest * warmth * course
    }

    /// Lists the differences from `other`: `name: own value -> other value`.
    pub fn differences(&self, other: &Self) -> Vec<String> {
        let fields = |settings: &Self| serde_json::to_value(settings).unwrap_or_default();
        let mut differences = Vec::new();
        list_differences("", &fields(self), &fields(other), &mut differences);
        differences
    }
}

/// Adds the differences of two values to a list; those of tables under the path of their keys.
fn list_differences(path: &str, mine: &Value, other: &Value, differences: &mut Vec<String>) {
    if let (Value::Object(mine), Value::Object(others)) = (mine, other)
        && mine.keys().all(|name| others.contains_key(name))
    {
        for (name, value) in mine {
            let separator = if path.is_empty() { "" } else { "." };
            list_differences(
                &format!("{path}{separator}{name}"),
                value,
                &others[name],
                differences,
            );
        }
    } else if mine != other {
        differences.push(format!("{path}: {mine} -> {other}"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_checked_and_differences_named() {
        let settings = TrainSettings::default();
        settings.validate().unwrap();
        let bad = [
            ("width", TrainSettings { width: 2, ..settings.clone() }),
            ("learning_rate", TrainSettings { learning_rate: f64::NAN, ..settings.clone() }),
            ("feature_weight", TrainSettings { feature_weight: -1.0, ..settings.clone() }),
            ("real_share", TrainSettings { real_share: 1.5, ..settings.clone() }),
            ("vgg_divisor", TrainSettings { vgg_divisor: 3, ..settings.clone() }),
            ("start", TrainSettings { network: NetworkKind::Unet, ..settings.clone() }),
            ("bound", TrainSettings { bound: -1.0, ..settings.clone() }),
            (
                "discriminator_learning_rate",
                TrainSettings { discriminator_learning_rate: -1.0, ..settings.clone() },
            ),
            ("weight_decay", TrainSettings { weight_decay: 0.1, ..settings.clone() }),
            ("betas", TrainSettings { betas: [0.9, 1.0], ..settings.clone() }),
            ("ema", TrainSettings { ema: 1.0, ..settings.clone() }),
            ("clip_norm", TrainSettings { clip_norm: f64::NAN, ..settings.clone() }),
            ("decay_steps", TrainSettings { decay_steps: vec![5, 5], ..settings.clone() }),
            ("decay_factor", TrainSettings { decay_factor: 0.0, ..settings.clone() }),
        ];
        let mut composition = Composition::default();
        composition.camera.jpeg_share = 2.0;
        let bad = bad.into_iter().chain([
            ("composition.camera.jpeg_share", TrainSettings { composition, ..settings.clone() }),
            (
                "pixels",
                TrainSettings {
                    examples: ExampleKind::Composed,
                    pixels: PixelSource::Png,
                    ..settings.clone()
                },
            ),
        ]);
        for (name, settings) in bad {
            assert_eq!(settings.validate().unwrap_err().name, name);
        }
        let other = TrainSettings { width: 16, a_priori: false, ..settings.clone() };
        assert_eq!(settings.differences(&other), ["width: 64 -> 16", "a_priori: true -> false"]);
        assert!(settings.differences(&settings).is_empty());
        let mut other = settings.clone();
        other.composition.camera.blur_share = 0.0;
        other.composition.strength = compose::Strength::OfTuple;
        let named = settings.differences(&other);
        assert_eq!(named[1], "composition.camera.blur_share: 0.5 -> 0.0");
        assert!(named[0].starts_with("composition.strength: {") && named.len() == 2, "{named:?}");
    }

    #[test]
    fn rates_follow_the_schedule() {
        let of = |schedule| TrainSettings { schedule, learning_rate: 2.0, ..Default::default() };
        let constant = TrainSettings { warmup_steps: 4, ..of(ScheduleKind::Constant) };
        assert_eq!([1, 2, 4, 5, 900].map(|step| constant.rate(step)), [0.5, 1.0, 2.0, 2.0, 2.0]);
        let cosine = TrainSettings { schedule_steps: 10, ..of(ScheduleKind::Cosine) };
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
        near(cosine.rate(5), 1.0);
        near(cosine.rate(10), 0.0);
        near(cosine.rate(1), 1.0 + libm::cos(0.1 * std::f64::consts::PI));
        let decay_steps = vec![3, 5];
        let step = TrainSettings { decay_steps, decay_factor: 0.1, ..of(ScheduleKind::Step) };
        assert_eq!([1, 3, 4, 5].map(|n| step.rate(n)), [2.0, 2.0, 0.2, 0.2]);
        near(step.rate(6), 0.02);
    }

    #[test]
    fn settings_of_earlier_versions_keep_their_meaning() {
        let old = r#"{"seed": 1, "width": 16, "start": "random", "learning_rate": 0.001}"#;
        let settings: TrainSettings = serde_json::from_str(old).unwrap();
        assert_eq!(settings.network, NetworkKind::Generator);
        assert_eq!((settings.bound, settings.ema, settings.clip_norm), (0.0, 0.0, 0.0));
        assert_eq!([1, 10_000].map(|step| settings.rate(step)), [0.001; 2]);
    }
}
