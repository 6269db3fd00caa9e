//! `[train.settings.composition]`: distributions from which examples are composed in linear light.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Distributions of composed examples: a F_i + b R~_j, exposure and camera. Ranges are `[low, high]` and include both ends.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Composition {
    /// Share of examples whose reflection comes from another tuple; the others keep their tuple's own, with its ghosts
    /// and its parallax. Mixtures always use another tuple.
    pub other_share: f64,
    /// Mean luminance of the reflection over that of the front.
    pub strength: Strength,
    /// Share of examples without a reflection.
    pub none_share: f64,
    /// Share of examples whose reflection covers only a part of the picture. Its strength is that before the cover.
    pub partial_cover: f64,
    /// Share of composed examples whose reflection is blurred, as by a rough pane.
    pub rough: f64,
    /// Standard deviation of this blur, px; log-uniform.
    pub rough_px: [f64; 2],
    /// Share of examples whose surfaces, of the front and of the reflection, get textures.
    pub textured: f64,
    /// Standard deviation of the logarithm of a texture's factors of light, of each kind of surface; log-uniform.
    pub texture_sigma: [f64; 2],
    /// Standard deviation of the logarithms of three factors, one per channel, of the whole picture's white balance.
    pub white_balance: f64,
    /// The same for the reflection alone.
    pub reflection_white_balance: f64,
    /// Side of the front's crop over the example's side; uniform. A tuple's size bounds it.
    pub front_scale: [f64; 2],
    /// Side of another tuple's crop over the example's side; uniform. A tuple's size bounds it.
    pub reflection_scale: [f64; 2],
    /// Light of the target.
    pub target_light: TargetLight,
    /// Factor of all layers' light.
    pub exposure: Exposure,
    /// The front and the reflection of mixtures.
    pub mixture: Mixtures,
    /// The camera behind the glass.
    pub camera: Camera,
}

/// Mean luminance of the reflection over that of the front, before the camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Strength {
    /// That of the reflection's tuple, over its whole film.
    OfTuple,
    /// A log-normal distribution; values outside its range are drawn again.
    LogNormal(LogNormal),
    /// A distribution by its quantiles: rising values at evenly spaced probabilities from 0 to 1, linear between them.
    Quantiles(Vec<f64>),
}

/// A log-normal distribution, cut to a range.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LogNormal {
    /// Median of the distribution before the cut.
    pub median: f64,
    /// Standard deviation of the logarithm before the cut.
    pub sigma: f64,
    /// Range that values are cut to.
    pub range: [f64; 2],
}

/// Light of the target, T. A pane takes light from the front, in double and coated glazings a fifth and more.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TargetLight {
    /// That of the front without a pane.
    WithoutPane,
    /// The mean luminance of the front through the pane, by one factor for all channels, as a camera that exposes each of
    /// the two pictures would see them.
    ThroughPane,
}

/// Factor of all layers' light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Exposure {
    /// The exposure of the front's tuple.
    OfTuple,
    /// A percentile of the input gets a given level.
    Percentile(PercentileExposure),
}

/// Exposure by a percentile of the input.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PercentileExposure {
    /// Percentile, from 0 to 100, of the pixels' brightest channels; uniform.
    pub percentile: [f64; 2],
    /// Level of the percentile, where 1 is the largest value of a picture; uniform.
    pub level: [f64; 2],
    /// Mean luminance of the front to which the levels are restricted. If no level meets it, the nearest one is used.
    pub front_mean: [f64; 2],
}

/// Mixtures: photographs without glass, with the strengths, exposures and cameras of composed examples.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Mixtures {
    /// Factor of the transmission in the input; uniform.
    pub transmitted: [f64; 2],
    /// Standard deviation of the reflection's blur, px; uniform.
    pub blur_px: [f64; 2],
}

/// A simple camera. The curve and the blur apply to the input and to all targets, and noise and JPEG to the input alone.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Camera {
    /// False for layers coded in sRGB, without the effects below.
    pub enabled: bool,
    /// Share of examples with blur.
    pub blur_share: f64,
    /// Standard deviation of the blur, px; uniform.
    pub blur_px: [f64; 2],
    /// Variance of shot noise over the linear value; log-uniform.
    pub shot_noise: [f64; 2],
    /// Standard deviation of read noise, as a linear value; log-uniform.
    pub read_noise: [f64; 2],
    /// Standard deviation of the logarithm of the curve's exponent.
    pub gamma_sigma: f64,
    /// Weight of an S-shaped curve; uniform.
    pub s_curve: [f64; 2],
    /// Share of examples that pass through JPEG.
    pub jpeg_share: f64,
    /// Quality of JPEG, from 1 to 100; uniform.
    pub jpeg_quality: [u8; 2],
}

impl Default for Composition {
    fn default() -> Self {
        Self {
            other_share: 0.8,
            strength: Strength::LogNormal(LogNormal {
                median: 0.4,
                sigma: 1.0,
                range: [0.03, 1.5],
            }),
            none_share: 0.05,
            partial_cover: 0.0,
            rough: 0.0,
            rough_px: [0.5, 6.0],
            textured: 0.0,
            texture_sigma: [0.03, 0.45],
            white_balance: 0.08,
            reflection_white_balance: 0.15,
            front_scale: [1.0, 1.0],
            reflection_scale: [1.0, 2.0],
            target_light: TargetLight::ThroughPane,
            exposure: Exposure::Percentile(PercentileExposure {
                percentile: [93.0, 99.8],
                level: [0.1, 1.3],
                front_mean: [0.03, 0.4],
            }),
            mixture: Mixtures::default(),
            camera: Camera::default(),
        }
    }
}

impl Default for Mixtures {
    fn default() -> Self {
        Self { transmitted: [0.8, 1.0], blur_px: [0.5, 5.0] }
    }
}

impl Default for Camera {
    fn default() -> Self {
        Self {
            enabled: true,
            blur_share: 0.5,
            blur_px: [0.0, 0.7],
            shot_noise: [1e-5, 1e-3],
            read_noise: [1e-4, 4e-3],
            gamma_sigma: 0.12,
            s_curve: [-0.25, 0.35],
            jpeg_share: 0.7,
            jpeg_quality: [60, 98],
        }
    }
}

/// Error of a setting out of range.
#[derive(Debug, PartialEq, thiserror::Error)]
#[error("{name} is {value}, but must be {expected}")]
pub struct CompositionError {
    pub name: &'static str,
    pub value: String,
    pub expected: &'static str,
}

impl Composition {
    /// Returns the settings with which a composed example is its tuple, bit for bit.
    pub fn off() -> Self {
        Self {
            other_share: 0.0,
            strength: Strength::OfTuple,
            none_share: 0.0,
            white_balance: 0.0,
            reflection_white_balance: 0.0,
            front_scale: [1.0; 2],
            reflection_scale: [1.0; 2],
            target_light: TargetLight::WithoutPane,
            exposure: Exposure::OfTuple,
            camera: Camera { enabled: false, ..Camera::default() },
            ..Self::default()
        }
    }

    /// Checks the ranges of all settings.
    pub fn validate(&self) -> Result<(), CompositionError> {
        let camera = &self.camera;
        for (name, share) in [
            ("composition.other_share", self.other_share),
            ("composition.none_share", self.none_share),
            ("composition.partial_cover", self.partial_cover),
            ("composition.rough", self.rough),
            ("composition.textured", self.textured),
            ("composition.camera.blur_share", camera.blur_share),
            ("composition.camera.jpeg_share", camera.jpeg_share),
        ] {
            check(name, [share; 2], [0.0, 1.0], "from 0 to 1")?;
        }
        for (name, sigma) in [
            ("composition.white_balance", self.white_balance),
            ("composition.reflection_white_balance", self.reflection_white_balance),
            ("composition.camera.gamma_sigma", camera.gamma_sigma),
        ] {
            check(name, [sigma; 2], [0.0, 1.0], "from 0 to 1")?;
        }
        let scale = "a rising range from 1 to 4";
        check("composition.front_scale", self.front_scale, [1.0, 4.0], scale)?;
        check("composition.reflection_scale", self.reflection_scale, [1.0, 4.0], scale)?;
        check(
            "composition.mixture.transmitted",
            self.mixture.transmitted,
            [0.01, 1.0],
            "a rising range from 0.01 to 1",
        )?;
        let blur = "a rising range from 0 to 20";
        check(
            "composition.rough_px",
            self.rough_px,
            [0.01, 20.0],
            "a rising range from 0.01 to 20",
        )?;
        check(
            "composition.texture_sigma",
            self.texture_sigma,
            [0.001, 1.0],
            "a rising range from 0.001 to 1",
        )?;
        check("composition.mixture.blur_px", self.mixture.blur_px, [0.0, 20.0], blur)?;
        check("composition.camera.blur_px", camera.blur_px, [0.0, 20.0], blur)?;
        let noise = "a rising range from 1e-9 to 1";
        check("composition.camera.shot_noise", camera.shot_noise, [1e-9, 1.0], noise)?;
        check("composition.camera.read_noise", camera.read_noise, [1e-9, 1.0], noise)?;
        check(
            "composition.camera.s_curve",
            camera.s_curve,
            [-0.9, 0.9],
            "a rising range from -0.9 to 0.9",
        )?;
        let quality = camera.jpeg_quality.map(f64::from);
        check(
            "composition.camera.jpeg_quality",
            quality,
            [1.0, 100.0],
            "a rising range from 1 to 100",
        )?;
        self.strength.validate()?;
        if let Exposure::Percentile(exposure) = &self.exposure {
            let percentile = "a rising range from 0 to 100";
            check(
                "composition.exposure.percentile",
                exposure.percentile,
                [0.0, 100.0],
                percentile,
            )?;
            let light = "a rising range from 0.001 to 100";
            check("composition.exposure.level", exposure.level, [1e-3, 100.0], light)?;
            check("composition.exposure.front_mean", exposure.front_mean, [1e-3, 100.0], light)?;
        }
        Ok(())
    }
}

impl Strength {
    fn validate(&self) -> Result<(), CompositionError> {
        match self {
            Self::OfTuple => Ok(()),
            Self::LogNormal(strength) => strength.validate(),
            Self::Quantiles(values) => {
                let is_usable = values.len() >= 2
                    && values.iter().all(|value| (0.0..=1e6).contains(value))
                    && values.is_sorted();
                let error = || CompositionError {
                    name: "composition.strength.quantiles",
                    value: format!("{values:?}"),
                    expected: "two or more rising numbers from 0 to 1e6",
                };
                is_usable.then_some(()).ok_or_else(error)
            }
        }
    }
}

impl LogNormal {
    /// Least share of the distribution in its range, so that few values are drawn again.
    const LEAST_SHARE: f64 = 0.01;

    fn validate(&self) -> Result<(), CompositionError> {
        let light = "a rising range from 1e-6 to 1e6";
        check("composition.strength.range", self.range, [1e-6, 1e6], light)?;
        check("composition.strength.median", [self.median; 2], [1e-6, 1e6], "from 1e-6 to 1e6")?;
        check("composition.strength.sigma", [self.sigma; 2], [0.0, 10.0], "from 0 to 10")?;
        if self.share() < Self::LEAST_SHARE {
            return Err(CompositionError {
                name: "composition.strength.range",
                value: format!("{:?}", self.range),
                expected: "a range that holds at least a hundredth of the distribution",
            });
        }
        Ok(())
    }

    /// Returns the share of the distribution in its range.
    fn share(&self) -> f64 {
        let [low, high] = self.range;
        if self.sigma == 0.0 {
            return if (low..=high).contains(&self.median) { 1.0 } else { 0.0 };
        }
        let below = |value: f64| {
            let deviations = libm::log(value / self.median) / self.sigma;
            0.5 * libm::erfc(-deviations * std::f64::consts::FRAC_1_SQRT_2)
        };
        below(high) - below(low)
    }
}

/// Checks that a range rises and lies within bounds; the comparisons also reject NaN.
fn check(
    name: &'static str,
    [low, high]: [f64; 2],
    [least, most]: [f64; 2],
    expected: &'static str,
) -> Result<(), CompositionError> {
    if least <= low && low <= high && high <= most {
        return Ok(());
    }
    let value =
        if low.to_bits() == high.to_bits() { low.to_string() } else { format!("[{low}, {high}]") };
    Err(CompositionError { name, value, expected })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_checked() {
        Composition::default().validate().unwrap();
        Composition::off().validate().unwrap();
        let refused = |change: fn(&mut Composition)| {
            let mut settings = Composition::default();
            change(&mut settings);
            settings.validate().unwrap_err().to_string()
        };
        let text = refused(|c| c.none_share = 1.5);
        assert_eq!(text, "composition.none_share is 1.5, but must be from 0 to 1");
        let text = refused(|c| c.reflection_scale = [2.0, 1.0]);
        assert!(text.contains("[2, 1], but must be a rising range from 1 to 4"), "{text}");
        assert!(refused(|c| c.white_balance = f64::NAN).contains("white_balance is NaN"));
        let text = refused(|c| c.camera.jpeg_quality = [0, 90]);
        assert!(text.starts_with("composition.camera.jpeg_quality is [0, 90], but"), "{text}");
        assert!(refused(|c| c.camera.blur_px = [-1.0, 1.0]).starts_with("composition.camera.blur"));
        assert!(refused(|c| c.rough_px = [0.0, 6.0]).contains("a rising range from 0.01 to 20"));
        assert!(refused(|c| c.texture_sigma = [0.0, 0.1]).contains("texture_sigma is [0, 0.1]"));
        assert!(refused(|c| c.partial_cover = -0.1).contains("partial_cover is -0.1"));
        let narrow = LogNormal { median: 0.01, sigma: 1.0, range: [1.0, 2.0] };
        let strength = Strength::LogNormal(narrow);
        let settings = Composition { strength, ..Composition::default() };
        let text = settings.validate().unwrap_err().to_string();
        assert!(text.contains("a hundredth of the distribution"), "{text}");
        for values in [vec![], vec![0.4], vec![0.4, 0.3], vec![-0.1, 0.3], vec![0.1, f64::NAN]] {
            let strength = Strength::Quantiles(values);
            let settings = Composition { strength, ..Composition::default() };
            let text = settings.validate().unwrap_err().to_string();
            assert!(text.contains("but must be two or more rising numbers"), "{text}");
        }
    }

    #[test]
    fn settings_are_words_or_tables_and_unknown_keys_are_refused() {
        let read = |text: &str| serde_json::from_str::<Composition>(text);
        let json = serde_json::to_string(&Composition::default()).unwrap();
        assert_eq!(read(&json).unwrap(), Composition::default());
        assert_eq!(read("{}").unwrap(), Composition::default());
        let words = read(r#"{"strength": "of_tuple", "exposure": "of_tuple"}"#).unwrap();
        assert_eq!((words.strength, words.exposure), (Strength::OfTuple, Exposure::OfTuple));
        for wrong in [r#"{"camera": {"blurr": 1}}"#, r#"{"strength": "weak"}"#, r#"{"shre": 0}"#] {
            assert!(read(wrong).is_err(), "{wrong}");
        }
    }
}
