//! Calibrated sensors, `sensors.toml`: noise, levels and colours, with a source for each number.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::LazyLock;

/// A calibrated sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SensorModel {
    /// One line for readers.
    pub description: String,
    /// Keys of [`SensorModels::sources`], from which the numbers come.
    #[serde(default)]
    pub sources: Vec<String>,
    /// Bits of the converter.
    pub bits: u32,
    /// Number of the converter without light.
    pub black_level_dn: u32,
    /// Range of the logarithm of the gain, in DN per electron.
    pub ln_gain: [f64; 2],
    /// Read noise.
    pub read_noise: NoiseModel,
    /// Noise that the photosites of a row share.
    pub row_noise: NoiseModel,
    /// From CIE XYZ to raw values.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub xyz_to_camera: Option<[[f64; 3]; 3]>,
    /// From linear sRGB to balanced raw values, in place of `xyz_to_camera`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub srgb_to_camera: Option<[[f64; 3]; 3]>,
    /// Range of the factor that makes red raw values of neutral light equal to green ones.
    pub red_gain: [f64; 2],
    /// Range of the factor of blue.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub blue_gain: Option<[f64; 2]>,
    /// Polynomial of the factor of blue in that of red, in place of `blue_gain`: constant, linear and square term.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub blue_gain_of_red: Option<[f64; 3]>,
}

/// The scale of a noise, DN, as a function of the gain: exp(slope ln K + intercept + deviation z), with a normal number z.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NoiseModel {
    /// Exponent of the gain.
    pub slope: f64,
    /// Logarithm of the scale at a gain of 1.
    pub intercept: f64,
    /// Standard deviation of the logarithm.
    #[serde(default)]
    pub deviation: f64,
    /// Shape of Tukey's lambda distribution, -0.4 to 0.5; normal if missing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lambda: Option<f64>,
}

/// The file of all calibrated sensors.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorModels {
    /// Sources of the numbers, by key.
    pub sources: BTreeMap<String, String>,
    /// Sensors by name.
    #[serde(rename = "sensor")]
    pub by_name: BTreeMap<String, SensorModel>,
}

/// Returns the sensors that the program knows.
pub fn sensor_models() -> &'static SensorModels {
    static FILE: LazyLock<SensorModels> = LazyLock::new(|| {
        toml::from_str(include_str!("sensors.toml")).expect("a test parses the file")
    });
    &FILE
}

/// From linear sRGB to CIE XYZ (IEC 61966-2-1).
const SRGB_TO_XYZ: [[f64; 3]; 3] = [
    [0.412_456_4, 0.357_576_1, 0.180_437_5],
    [0.212_672_9, 0.715_152_2, 0.072_175],
    [0.019_333_9, 0.119_192, 0.950_304_1],
];

impl SensorModel {
    /// Returns the matrix from linear sRGB to balanced raw values: neutral light has equal values in all channels. `None` unless
    /// exactly one of the two matrices is given, with rows whose sums are not 0.
    pub(super) fn srgb_to_balanced(&self) -> Option<[[f64; 3]; 3]> {
        let matrix = match (self.xyz_to_camera, self.srgb_to_camera) {
            (Some(camera), None) => compose::matrix_product(&camera, &SRGB_TO_XYZ),
            (None, Some(matrix)) => matrix,
            _ => return None,
        };
        let sums = matrix.map(|row| row.iter().sum::<f64>());
        let is_usable = sums.iter().all(|sum| sum.is_finite() && *sum > 1e-6);
        is_usable.then(|| [0, 1, 2].map(|row| matrix[row].map(|value| value / sums[row])))
    }
}

impl NoiseModel {
    /// Returns the scale at a gain, with a normal number `z`.
    pub(super) fn scale_dn(&self, ln_gain: f64, z: f64) -> f64 {
        libm::exp(self.slope * ln_gain + self.intercept + self.deviation * z)
    }
}
