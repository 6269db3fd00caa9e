//! `[train]` of a recipe: all settings that change the result of training.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

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

/// Source of training examples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ExampleKind {
    /// The run's tuples, rendered with glass and lens.
    #[default]
    Rendered,
    /// Image-space mixtures of the scenes' photographs by the method of Zhang, Ng and Chen (CVPR 2018).
    Zhang,
    /// Image-space mixtures of the scenes' photographs by the method of Fan et al. (CEILNet, ICCV 2017).
    Ceilnet,
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
}

/// `[train]`: training that `run` starts when all tuples are complete.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TrainRecipe {
    /// Number of steps of BT-net alone.
    pub backtrack_steps: u64,
    /// Number of steps of SP-net and BT-net together.
    pub separation_steps: u64,
    /// Settings of both stages. Most defaults are from the paper or from Zhang et al.
    #[serde(default)]
    pub settings: TrainSettings,
}

/// Settings of training, fixed by the first checkpoint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TrainSettings {
    /// Seed of initial weights, random features, and the order and augmentation of examples.
    pub seed: u64,
    /// Image features for the hypercolumn and the feature loss.
    pub features: FeatureSource,
    /// Divisor of the widths of VGG-19, a power of two; 1 for the published widths.
    pub vgg_divisor: usize,
    /// Number of hidden channels of the generators.
    pub width: usize,
    /// Number of channels after the discriminators' first convolution.
    pub discriminator_width: usize,
    /// Initial weights of the generators.
    pub start: Start,
    /// Number of examples per step.
    pub batch: usize,
    /// Side of the square crop of an example, px.
    pub crop_px: usize,
    /// True if examples are mirrored with probability 1/2.
    pub flip: bool,
    /// Adam's step size.
    pub learning_rate: f64,
    /// Weight of the mean absolute differences. The paper does not state a value.
    pub pixel_weight: f64,
    /// Weight of the feature losses; 0.2 in the paper.
    pub feature_weight: f64,
    /// Weight of the adversarial losses; 0 omits the discriminators. Zhang et al. use 1 with 100 for all other losses.
    pub adversarial_weight: f64,
    /// Number of steps between updates of the discriminators; 2 in Zhang et al.
    pub discriminator_every: u64,
    /// True if SP-net also gets the gradients of the a priori loss, through BT-net.
    pub a_priori: bool,
    /// Source of the examples.
    pub examples: ExampleKind,
    /// Files of a tuple that contain the pixels.
    pub pixels: PixelSource,
    /// Share of steps with real photographs, from 0 to 1.
    pub real_share: f64,
    /// True to wait for missing tuples; the first epoch then uses the manifest's order, in which a farm renders scenes.
    pub follow: bool,
}

impl Default for TrainSettings {
    fn default() -> Self {
        Self {
            seed: 2020,
            features: FeatureSource::None,
            vgg_divisor: 1,
            width: 64,
            discriminator_width: 64,
            start: Start::Identity,
            batch: 1,
            crop_px: 256,
            flip: true,
            learning_rate: 1e-4,
            pixel_weight: 1.0,
            feature_weight: 0.2,
            adversarial_weight: 0.01,
            discriminator_every: 2,
            a_priori: true,
            examples: ExampleKind::Rendered,
            pixels: PixelSource::Exr,
            real_share: 0.0,
            follow: false,
        }
    }
}

/// Error of a setting out of range.
#[derive(Debug, PartialEq, thiserror::Error)]
#[error("{name} is {value}, but must be {expected}")]
pub struct SettingError {
    pub name: &'static str,
    pub value: String,
    pub expected: &'static str,
}

impl TrainSettings {
    /// Checks the ranges of all settings.
    pub fn validate(&self) -> Result<(), SettingError> {
        let refuse = |name, value: String, expected| Err(SettingError { name, value, expected });
        let sizes = [
            ("width", self.width, 3..=1024, "from 3 to 1024"),
            ("discriminator_width", self.discriminator_width, 1..=1024, "from 1 to 1024"),
            ("batch", self.batch, 1..=1024, "from 1 to 1024"),
            ("crop_px", self.crop_px, 32..=8192, "from 32 to 8192"),
            ("vgg_divisor", self.vgg_divisor, 1..=64, "from 1 to 64"),
        ];
        for (name, value, range, expected) in sizes {
            if !range.contains(&value) {
                return refuse(name, value.to_string(), expected);
            }
        }
        if !self.vgg_divisor.is_power_of_two() {
            return refuse("vgg_divisor", self.vgg_divisor.to_string(), "a power of two");
        }
        // The negated conditions also reject NaN, because every comparison with NaN is false.
        let rate = self.learning_rate;
        if !(rate > 0.0 && rate < f64::INFINITY) {
            return refuse("learning_rate", rate.to_string(), "above 0");
        }
        for (name, value) in [
            ("pixel_weight", self.pixel_weight),
            ("feature_weight", self.feature_weight),
            ("adversarial_weight", self.adversarial_weight),
        ] {
            if !(0.0..f64::INFINITY).contains(&value) {
                return refuse(name, value.to_string(), "0 or above");
            }
        }
        if !(0.0..=1.0).contains(&self.real_share) {
            return refuse("real_share", self.real_share.to_string(), "from 0 to 1");
        }
        if self.discriminator_every == 0 {
            return refuse("discriminator_every", "0".to_owned(), "1 or above");
        }
        Ok(())
    }

    /// Lists the differences from `other`: `name: own value -> other value`.
    pub fn differences(&self, other: &Self) -> Vec<String> {
        let fields = |settings: &Self| match serde_json::to_value(settings) {
            Ok(serde_json::Value::Object(fields)) => fields,
            _ => serde_json::Map::new(),
        };
        let (mine, others) = (fields(self), fields(other));
        mine.iter()
            .filter_map(|(name, value)| {
                let other = others.get(name)?;
                (value != other).then(|| format!("{name}: {value} -> {other}"))
            })
            .collect()
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
        ];
        for (name, settings) in bad {
            assert_eq!(settings.validate().unwrap_err().name, name);
        }
        let other = TrainSettings { width: 16, a_priori: false, ..settings.clone() };
        assert_eq!(settings.differences(&other), ["width: 64 -> 16", "a_priori: true -> false"]);
        assert!(settings.differences(&settings).is_empty());
    }
}
