//! Settings of published trainings.

use super::training::{FeatureSource, FeatureStyle, TrainSettings};
use schemars::JsonSchema;
use serde::Deserialize;

/// A published training of Kim, Huo and Yoon (CVPR 2020). Both need VGG-19 weights from a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
pub enum Preset {
    /// As the paper's text: the feature loss weighs 0.2, and the rate of Adam is 1e-4. The text states no weights of the
    /// pixels' differences and of the adversarial loss; these are Glasshouse's defaults.
    #[serde(rename = "kim2020-text")]
    Kim2020Text,
    /// As the authors' program (main.py of sookim813/Reflection_removal_rendering at b85666ab). Its feature loss contains
    /// the mean absolute difference of codes from 0 to 255, which is part of `pixel_weight` here: 1 + 0.2 x 255 = 52.
    #[serde(rename = "kim2020-code")]
    Kim2020Code,
}

impl TrainSettings {
    /// Returns the settings of a published training.
    pub fn preset(preset: Preset) -> Self {
        let text = Self {
            features: FeatureSource::File,
            pixel_weight: 1.0,
            feature_weight: 0.2,
            adversarial_weight: 0.01,
            learning_rate: 1e-4,
            ..Self::default()
        };
        match preset {
            Preset::Kim2020Text => text,
            Preset::Kim2020Code => Self {
                feature_style: FeatureStyle::Caffe,
                pixel_weight: 52.0,
                learning_rate: 2e-4,
                discriminator_learning_rate: 1e-4,
                ..text
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_differ_where_text_and_program_differ() {
        let [text, code] = [Preset::Kim2020Text, Preset::Kim2020Code].map(TrainSettings::preset);
        for settings in [&text, &code] {
            settings.validate().unwrap();
        }
        let expected = [
            "discriminator_learning_rate: 0.0 -> 0.0001",
            "feature_style: \"torch\" -> \"caffe\"",
            "learning_rate: 0.0001 -> 0.0002",
            "pixel_weight: 1.0 -> 52.0",
        ];
        let mut found = text.differences(&code);
        found.sort();
        assert_eq!(found, expected);
        assert_eq!((code.rate(9), code.discriminator_rate(9)), (2e-4, 1e-4));
        assert_eq!(text.rate(9), text.discriminator_rate(9));
        assert_eq!(TrainSettings::default().differences(&text), ["features: \"none\" -> \"file\""]);
    }
}
