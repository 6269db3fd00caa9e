//! `[sensor]` of a recipe: the camera of the photographs.

use super::draw::{Draw, nine_digits};
use super::sensor_model::{SensorModel, sensor_models};
use compose::{matrix_inverse, tukey_deviation};
use glasshouse_line::param::Choice;
use glasshouse_line::param::OneOf;
use glasshouse_line::param::{Normal, Param};
use glasshouse_line::{Mosaic, Sensor, SensorExposure, Subsampling, Tone};
use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize, de};

/// `[sensor]`: the camera of the photographs. Each scene draws its numbers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SensorRecipe {
    /// Name of a calibrated sensor (docs/camera.md), or a choice of names. Default: any of them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera: Option<OneOf<SensorName>>,
    /// A sensor of the reader's own, in place of `camera`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub model: Option<SensorModel>,
    /// Exposure, from a meter that sees the input. Default: percentile 98 to 99.9 gets 0.75 to 1.1.
    pub exposure: ExposureRecipe,
    /// Standard deviation of the blur of the optics, px. Default 0.2 to 0.6.
    pub blur_px: Param,
    /// Gain, DN per electron, in the calibrated range. Default: the lower third of its logarithms, the light of a day.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gain_dn_per_e: Option<Param>,
    /// Electrons that a photosite holds. Default: the converter is full first.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub full_well_e: Option<Param>,
    /// Colours of the first photosites, or a choice. Default: any of the four.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mosaic: Option<OneOf<Mosaic>>,
    /// Errors of the white balance: factors of red, green and blue. Default: normal around 1 for red and blue.
    pub white_balance_error: [Param; 3],
    /// Kind of the curve, or a choice of kinds. Default: parametric twice as often as sRGB and filmic.
    pub tone: OneOf<ToneKind>,
    /// Exponent of the parametric curve.
    pub gamma: Param,
    /// Weight of the S-shaped part of the parametric curve.
    pub s_curve: Param,
    /// Exposure of the filmic curve.
    pub filmic: Param,
    /// Width and height of the photograph over those of the film. Default 1.
    pub scale: Param,
    /// Weight of the difference from a blurred photograph. Default 0 to 0.6.
    pub sharpen: Param,
    /// Standard deviation of that blur, px. Default 0.6 to 1.2.
    pub sharpen_px: Param,
    /// Quality of the JPEG: a whole number or a choice. Default 70 to 98.
    pub jpeg_quality: Param,
    /// Resolution of the JPEG's colours, or a choice. Default: half twice as often as full.
    pub jpeg_subsampling: OneOf<Subsampling>,
    /// True for `raw.dng`, too. Default false.
    pub raw: bool,
}

/// `sensor.exposure`: a factor, or a percentile with its level.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(
    untagged,
    deny_unknown_fields,
    expecting = "exposure must be { factor = .. } or { percentile = .., level = .. }"
)]
pub enum ExposureRecipe {
    /// A factor of the light.
    Factor {
        /// The factor.
        factor: Param,
    },
    /// A percentile of the input's brightest channels gets a level; 1 is the largest code.
    Metered {
        /// Percentile, above 0 and up to 100.
        percentile: Param,
        /// Level.
        level: Param,
    },
}

/// Kind of a curve from linear values to codes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ToneKind {
    /// IEC 61966-2-1.
    Srgb,
    /// sRGB with an exponent and an S-shaped part.
    Parametric,
    /// Hable's curve, which compresses highlights.
    Filmic,
}

/// The name of a calibrated sensor. All names are known.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct SensorName(String);

impl<'de> Deserialize<'de> for SensorName {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let name = String::deserialize(deserializer)?;
        let known = &sensor_models().by_name;
        if known.contains_key(&name) {
            return Ok(Self(name));
        }
        let all: Vec<_> = known.keys().map(String::as_str).collect();
        Err(de::Error::custom(format!(
            "unknown sensor {name:?}, expected one of {}",
            all.join(", ")
        )))
    }
}

fn normal(mean: f64, std: f64, min: f64, max: f64) -> Param {
    Param::Normal(Normal { mean, std, min, max })
}

impl Default for SensorRecipe {
    fn default() -> Self {
        let balance = || normal(1.0, 0.03, 0.9, 1.1);
        let weighted = |weights: &[f64]| Some(weights.to_vec());
        let tones = vec![ToneKind::Srgb, ToneKind::Parametric, ToneKind::Filmic];
        let colours = vec![Subsampling::Half, Subsampling::Full];
        let qualities = [70.0, 75.0, 80.0, 85.0, 90.0, 92.0, 95.0, 98.0];
        Self {
            camera: None,
            model: None,
            exposure: ExposureRecipe::Metered {
                percentile: Param::Uniform([98.0, 99.9]),
                level: Param::Uniform([0.75, 1.1]),
            },
            blur_px: Param::Uniform([0.2, 0.6]),
            gain_dn_per_e: None,
            full_well_e: None,
            mosaic: None,
            white_balance_error: [balance(), Param::Constant(1.0), balance()],
            tone: OneOf(Choice { values: tones, weights: weighted(&[1.0, 2.0, 1.0]) }),
            gamma: normal(1.0, 0.08, 0.75, 1.3),
            s_curve: Param::Uniform([-0.1, 0.35]),
            filmic: Param::LogUniform([1.0, 4.0]),
            scale: Param::Constant(1.0),
            sharpen: Param::Uniform([0.0, 0.6]),
            sharpen_px: Param::Uniform([0.6, 1.2]),
            jpeg_quality: Param::Choice(qualities.to_vec().into()),
            jpeg_subsampling: OneOf(Choice { values: colours, weights: weighted(&[2.0, 1.0]) }),
            raw: false,
        }
    }
}

impl SensorRecipe {
    /// Returns all numbers that scenes draw, with their keys.
    pub(super) fn params(&self) -> Vec<(String, &Param)> {
        let exposure = match &self.exposure {
            ExposureRecipe::Factor { factor } => vec![("exposure.factor", factor)],
            ExposureRecipe::Metered { percentile, level } => {
                vec![("exposure.percentile", percentile), ("exposure.level", level)]
            }
        };
        let optional = [("gain_dn_per_e", &self.gain_dn_per_e), ("full_well_e", &self.full_well_e)];
        let given = optional.into_iter().filter_map(|(key, param)| Some((key, param.as_ref()?)));
        let others = [
            ("blur_px", &self.blur_px),
            ("white_balance_error[0]", &self.white_balance_error[0]),
            ("white_balance_error[1]", &self.white_balance_error[1]),
            ("white_balance_error[2]", &self.white_balance_error[2]),
            ("gamma", &self.gamma),
            ("s_curve", &self.s_curve),
            ("filmic", &self.filmic),
            ("scale", &self.scale),
            ("sharpen", &self.sharpen),
            ("sharpen_px", &self.sharpen_px),
            ("jpeg_quality", &self.jpeg_quality),
        ];
        let all = exposure.into_iter().chain(given).chain(others);
        all.map(|(key, param)| (format!("sensor.{key}"), param)).collect()
    }

    /// Draws the sensor of a line.
    pub(crate) fn draw(&self, draw: Draw<'_>) -> Sensor {
        let value = |key: &str, param: &Param| draw.value(&format!("sensor.{key}"), param);
        let (name, model) = self.drawn_model(draw);
        let [low, high] = model.ln_gain;
        let range = Param::LogUniform([low, low + (high - low) / 3.0].map(libm::exp));
        let gain = value("gain_dn_per_e", self.gain_dn_per_e.as_ref().unwrap_or(&range));
        let spread = normal(0.0, 1.0, -3.0, 3.0);
        let scale_dn = |key: &str, noise: super::sensor_model::NoiseModel| {
            let scale = noise.scale_dn(libm::log(gain), value(key, &spread));
            nine_digits(scale * noise.lambda.map_or(1.0, tukey_deviation))
        };
        let balanced = model.srgb_to_balanced().expect("the matrix was checked");
        Sensor {
            name,
            exposure: match &self.exposure {
                ExposureRecipe::Factor { factor } => {
                    SensorExposure::Factor { factor: value("exposure.factor", factor) }
                }
                ExposureRecipe::Metered { percentile, level } => SensorExposure::Metered {
                    percentile: value("exposure.percentile", percentile),
                    level: value("exposure.level", level),
                },
            },
            blur_px: value("blur_px", &self.blur_px),
            gain_dn_per_e: gain,
            full_well_e: self.full_well_e.as_ref().map(|param| value("full_well_e", param)),
            bits: model.bits,
            black_level_dn: model.black_level_dn,
            read_noise_dn: scale_dn("read_noise", model.read_noise),
            read_noise_lambda: model.read_noise.lambda,
            row_noise_dn: scale_dn("row_noise", model.row_noise),
            mosaic: self.drawn_mosaic(draw),
            white_balance: drawn_white_balance(&model, draw),
            white_balance_error: [0, 1, 2]
                .map(|c| value(&format!("white_balance_error[{c}]"), &self.white_balance_error[c])),
            colour_matrix: matrix_inverse(&balanced).map(|row| row.map(nine_digits)),
            tone: self.drawn_tone(draw),
            scale: value("scale", &self.scale),
            sharpen: value("sharpen", &self.sharpen),
            sharpen_px: value("sharpen_px", &self.sharpen_px),
            jpeg_quality: value("jpeg_quality", &self.jpeg_quality) as u8,
            jpeg_subsampling: *draw.pick("sensor.jpeg_subsampling", &self.jpeg_subsampling.0),
            raw: self.raw,
        }
    }

    fn drawn_model(&self, draw: Draw<'_>) -> (Option<String>, SensorModel) {
        if let Some(model) = &self.model {
            return (None, model.clone());
        }
        let known = &sensor_models().by_name;
        let name = match &self.camera {
            Some(OneOf(choice)) => draw.pick("sensor.camera", choice).0.clone(),
            None => draw
                .pick("sensor.camera", &known.keys().cloned().collect::<Vec<_>>().into())
                .clone(),
        };
        let model = known[&name].clone();
        (Some(name), model)
    }

    fn drawn_mosaic(&self, draw: Draw<'_>) -> Mosaic {
        let all = || vec![Mosaic::Rggb, Mosaic::Bggr, Mosaic::Grbg, Mosaic::Gbrg].into();
        let choice = self.mosaic.as_ref().map_or_else(all, |OneOf(choice)| choice.clone());
        *draw.pick("sensor.mosaic", &choice)
    }

    fn drawn_tone(&self, draw: Draw<'_>) -> Tone {
        match draw.pick("sensor.tone", &self.tone.0) {
            ToneKind::Srgb => Tone::Srgb,
            ToneKind::Parametric => Tone::Parametric {
                gamma: draw.value("sensor.gamma", &self.gamma),
                s_curve: draw.value("sensor.s_curve", &self.s_curve),
            },
            ToneKind::Filmic => {
                Tone::Filmic { exposure: draw.value("sensor.filmic", &self.filmic) }
            }
        }
    }

    /// Returns the sensors from which scenes draw.
    pub(super) fn models(&self) -> Vec<(String, &SensorModel)> {
        if let Some(model) = &self.model {
            return vec![("sensor.model".to_owned(), model)];
        }
        let known = sensor_models().by_name.iter();
        let is_named = |name: &String| {
            self.camera.as_ref().is_none_or(|OneOf(c)| c.values.iter().any(|n| n.0 == *name))
        };
        known
            .filter(|(name, _)| is_named(name))
            .map(|(name, model)| (name.clone(), model))
            .collect()
    }
}

fn drawn_white_balance(model: &SensorModel, draw: Draw<'_>) -> [f64; 3] {
    let red = draw.value("sensor.red_gain", &Param::Uniform(model.red_gain));
    let blue = match (model.blue_gain_of_red, model.blue_gain) {
        (Some([constant, linear, square]), _) => {
            nine_digits(constant + linear * red + square * red * red)
        }
        (None, Some(range)) => draw.value("sensor.blue_gain", &Param::Uniform(range)),
        (None, None) => 1.0,
    };
    [red, 1.0, blue]
}
