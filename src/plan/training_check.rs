//! Checks of the settings of training.

use super::training::{NetworkKind, OptimizerKind, PixelSource, Start, TrainSettings};
use compose::CompositionError;

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
        self.validate_network()?;
        self.validate_optimizer()?;
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
            ("discriminator_learning_rate", self.discriminator_learning_rate),
            ("pixel_weight", self.pixel_weight),
            ("gradient_weight", self.gradient_weight),
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
        if self.examples.is_composed() && self.pixels != PixelSource::Exr {
            let value = format!("{:?}", self.pixels).to_lowercase();
            return refuse("pixels", value, "exr for examples composed in linear light");
        }
        if let Some(sensor) = &self.sensor {
            if !self.examples.is_composed() {
                let value = "given".to_owned();
                return refuse("sensor", value, "left out unless examples are composed");
            }
            if let Err(error) = sensor.check_numbers() {
                let expected = "a table that a recipe's [sensor] may have";
                return refuse("sensor", format!("wrong ({error})"), expected);
            }
        }
        Ok(self.composition.validate()?)
    }

    /// Checks the settings that depend on the architecture.
    fn validate_network(&self) -> Result<(), SettingError> {
        if self.network == NetworkKind::Unet {
            if self.start != Start::Residual {
                let start = format!("{:?}", self.start).to_lowercase();
                return refuse("start", start, "residual for a U-Net");
            }
            if self.a_priori {
                return refuse(
                    "a_priori",
                    "true".to_owned(),
                    "false for a U-Net: it has no BT-net",
                );
            }
        }
        if !(0.0..f64::INFINITY).contains(&self.bound) {
            return refuse("bound", self.bound.to_string(), "above 0, or 0 for no bound");
        }
        Ok(())
    }

    fn validate_optimizer(&self) -> Result<(), SettingError> {
        for beta in self.betas {
            if !(0.0..1.0).contains(&beta) {
                return refuse("betas", beta.to_string(), "from 0 to below 1");
            }
        }
        for (name, value) in [("weight_decay", self.weight_decay), ("clip_norm", self.clip_norm)] {
            if !(0.0..f64::INFINITY).contains(&value) {
                return refuse(name, value.to_string(), "0 or above");
            }
        }
        if self.weight_decay > 0.0 && self.optimizer != OptimizerKind::Adamw {
            let value = self.weight_decay.to_string();
            return refuse("weight_decay", value, "0 unless the optimizer is adamw");
        }
        if !(0.0..1.0).contains(&self.ema) {
            return refuse("ema", self.ema.to_string(), "from 0 to below 1");
        }
        if !(self.decay_factor > 0.0 && self.decay_factor <= 1.0) {
            return refuse("decay_factor", self.decay_factor.to_string(), "above 0 and at most 1");
        }
        let is_ascending = self.decay_steps.windows(2).all(|pair| pair[0] < pair[1]);
        if !is_ascending || self.decay_steps.first() == Some(&0) {
            let steps = format!("{:?}", self.decay_steps);
            return refuse("decay_steps", steps, "steps above 0 in ascending order");
        }
        Ok(())
    }
}

impl From<CompositionError> for SettingError {
    fn from(error: CompositionError) -> Self {
        let CompositionError { name, value, expected } = error;
        Self { name, value, expected }
    }
}

fn refuse(name: &'static str, value: String, expected: &'static str) -> Result<(), SettingError> {
    Err(SettingError { name, value, expected })
}
