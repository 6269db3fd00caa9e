//! `sensor` of a scene line: the camera that photographs the scene's layers.

use super::error::{LineError, check_section};
use super::keys::words;
use glasshouse_keys::keys;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Version of the camera: photographs of equal layers, sensors and versions have equal bits.
pub const SENSOR_VERSION: u32 = 1;

/// A sensor and the development of its raw values. Without it, a scene has no photographs.
///
/// A raw value is 0 at the black level, and 1 where the converter or the photosites are full. Neutral light of 1, after the
/// exposure, gives a raw value of 1 in green.
#[keys]
pub struct Sensor {
    /// Name of the calibration from which a recipe drew the numbers; not used.
    pub name: Option<String>,
    /// Factor of the light, from a meter that sees the input.
    pub exposure: SensorExposure,
    /// Standard deviation of the blur of the optics.
    #[key("[0, 20] px", default = 0.0)]
    pub blur_px: f64,
    /// Numbers of the converter (DN) per electron.
    #[key("[1e-4, 1e4] DN per electron")]
    pub gain_dn_per_e: f64,
    /// Electrons that a photosite holds; unlimited if missing.
    #[key("[1, 1e9] electrons")]
    pub full_well_e: Option<f64>,
    /// Bits of the converter.
    #[key("[8, 16] whole")]
    pub bits: u32,
    /// Number of the converter without light.
    #[key("[0, 65534] DN whole", default = 0)]
    pub black_level_dn: u32,
    /// Standard deviation of the read noise.
    #[key("[0, 1e4] DN", default = 0.0)]
    pub read_noise_dn: f64,
    /// Shape of the read noise's Tukey lambda distribution; normal if missing.
    // The variance is infinite from -0.5 downwards, and the distribution is bounded above 0.5.
    #[key("[-0.4, 0.5]")]
    pub read_noise_lambda: Option<f64>,
    /// Standard deviation of the noise that all photosites of a row share.
    #[key("[0, 1e4] DN", default = 0.0)]
    pub row_noise_dn: f64,
    /// Colours of the photosites: `rggb`, `bggr`, `grbg` or `gbrg`.
    #[key(default = Mosaic::Rggb, written)]
    pub mosaic: Mosaic,
    /// Factors that make raw values of neutral light equal.
    #[key("[0.1, 10]", default = [1.0; 3])]
    pub white_balance: [f64; 3],
    /// Further factors of the development: an error of the white balance.
    #[key("[0.1, 10]", default = [1.0; 3])]
    pub white_balance_error: [f64; 3],
    /// Matrix from balanced raw values to linear sRGB, row by row; each row has the sum 1.
    #[key("[-10, 10]", default = IDENTITY, shown = "no change")]
    pub colour_matrix: [[f64; 3]; 3],
    /// Curve from linear values to codes.
    #[key(default = Tone::Srgb)]
    pub tone: Tone,
    /// Width and height of the photograph over those of the film.
    #[key("[0.05, 1]", default = 1.0)]
    pub scale: f64,
    /// Weight of the difference from a blurred photograph.
    #[key("[0, 5]", default = 0.0)]
    pub sharpen: f64,
    /// Standard deviation of that blur, px of the photograph.
    #[key("[0.1, 20] px", default = 1.0)]
    pub sharpen_px: f64,
    /// Quality of the JPEG.
    #[key("[1, 100] whole")]
    pub jpeg_quality: u8,
    /// Resolution of the JPEG's colours: `4:4:4`, `4:2:2` or `4:2:0`.
    #[key(default = Subsampling::Full, shown = "4:4:4")]
    pub jpeg_subsampling: Subsampling,
    /// True for `raw.dng`, too.
    #[key(default = false)]
    pub raw: bool,
}

words!(Mosaic, Subsampling);

/// Exposure of the sensor.
#[keys]
#[derive(Copy)]
#[serde(untagged, expecting = r#"exposure must be {"factor": f} or {"percentile": p, "level": v}"#)]
pub enum SensorExposure {
    /// A factor of the light.
    Factor {
        /// Factor of the light.
        #[key("[1e-6, 1e6]")]
        factor: f64,
    },
    /// The factor that gives a percentile of the input's brightest channels a level; 1 is the largest code.
    Metered {
        /// Percentile of the input's brightest channels.
        #[key("(0, 100]")]
        percentile: f64,
        /// Level of this percentile in the photograph; 1 is the largest code.
        #[key("[1e-6, 1e6]")]
        level: f64,
    },
}

/// Colours of the four photosites at the upper left corner, row by row.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Mosaic {
    #[default]
    Rggb,
    Bggr,
    Grbg,
    Gbrg,
}

impl Mosaic {
    /// Returns the channel (0 red, 1 green, 2 blue) of the photosite at a row and a column.
    pub fn channel(self, row: usize, column: usize) -> usize {
        let channels = match self {
            Self::Rggb => [[0, 1], [1, 2]],
            Self::Bggr => [[2, 1], [1, 0]],
            Self::Grbg => [[1, 0], [2, 1]],
            Self::Gbrg => [[1, 2], [0, 1]],
        };
        channels[row % 2][column % 2]
    }
}

/// Curve from linear values to codes. All curves rise and keep 0 and 1.
#[keys]
#[derive(Copy, Default)]
#[serde(rename_all = "snake_case")]
pub enum Tone {
    /// IEC 61966-2-1.
    #[default]
    Srgb,
    /// c + s (3 c^2 - 2 c^3 - c) with c = sRGB(v)^gamma.
    Parametric {
        /// Exponent of the parametric curve.
        #[key("[0.2, 5]")]
        gamma: f64,
        /// Weight s of its S-curve.
        #[key("[-0.9, 0.9]")]
        s_curve: f64,
    },
    /// sRGB(h(e v) / h(e)) with Hable's curve h, which compresses highlights the more, the larger e is.
    Filmic {
        /// Exposure e of the filmic curve.
        #[key("[0.01, 100]")]
        exposure: f64,
    },
}

/// Resolution of a JPEG's colours against its brightness.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Subsampling {
    /// Full.
    #[default]
    #[serde(rename = "4:4:4")]
    Full,
    /// Half in each row.
    #[serde(rename = "4:2:2")]
    HalfColumns,
    /// Half in rows and columns.
    #[serde(rename = "4:2:0")]
    Half,
}

impl fmt::Display for Subsampling {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Full => "4:4:4",
            Self::HalfColumns => "4:2:2",
            Self::Half => "4:2:0",
        })
    }
}

const IDENTITY: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// Largest difference of a row's sum from 1: neutral light stays neutral to a thousandth.
const ROW_SUM_TOLERANCE: f64 = 1e-3;
/// Least determinant of the matrix, so that its inverse has a few digits.
const LEAST_DETERMINANT: f64 = 1e-3;

impl Sensor {
    /// Returns the largest number of the converter, DN.
    pub fn white_level_dn(&self) -> u32 {
        (1 << self.bits) - 1
    }

    /// Returns the electrons at a raw value of 1: the converter or the photosite is full.
    pub fn white_e(&self) -> f64 {
        let of_converter =
            f64::from(self.white_level_dn() - self.black_level_dn) / self.gain_dn_per_e;
        self.full_well_e.map_or(of_converter, |full_well_e| of_converter.min(full_well_e))
    }

    /// Checks each number, and what ranges of single numbers do not say.
    pub fn check(&self) -> Result<(), LineError> {
        check_section(self, "sensor")?;
        if self.black_level_dn >= self.white_level_dn() {
            let (black_level_dn, bits) = (self.black_level_dn, self.bits);
            return Err(LineError::BlackLevel { black_level_dn, bits });
        }
        let rows = self.colour_matrix;
        let is_neutral = |row: &[f64; 3]| (row.iter().sum::<f64>() - 1.0).abs() < ROW_SUM_TOLERANCE;
        if !rows.iter().all(is_neutral) || determinant(&rows).abs() < LEAST_DETERMINANT {
            return Err(LineError::ColourMatrix);
        }
        Ok(())
    }
}

/// Returns the determinant of a matrix.
fn determinant([a, b, c]: &[[f64; 3]; 3]) -> f64 {
    let cofactor = |i: usize, j: usize| b[i] * c[j] - b[j] * c[i];
    a[0] * cofactor(1, 2) - a[1] * cofactor(0, 2) + a[2] * cofactor(0, 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    const LINE: &str = r#"{"exposure":{"percentile":99,"level":0.9},"gain_dn_per_e":0.5,"bits":14,"jpeg_quality":90}"#;

    fn sensor() -> Sensor {
        serde_json::from_str(LINE).unwrap()
    }

    #[test]
    fn lines_have_the_numbers_that_differ_from_their_defaults() {
        let plain = sensor();
        plain.check().unwrap();
        let text = serde_json::to_string(&plain).unwrap();
        assert_eq!(
            text,
            r#"{"exposure":{"percentile":99.0,"level":0.9},"gain_dn_per_e":0.5,"bits":14,"mosaic":"rggb","jpeg_quality":90}"#
        );
        let all = r#"{"name":"a","exposure":{"factor":2.0},"blur_px":0.4,"gain_dn_per_e":0.5,"full_well_e":9000.0,"bits":12,"black_level_dn":64,"read_noise_dn":2.0,"read_noise_lambda":-0.1,"row_noise_dn":0.5,"mosaic":"gbrg","white_balance":[2.0,1.0,1.5],"white_balance_error":[1.1,1.0,0.9],"colour_matrix":[[1.5,-0.4,-0.1],[-0.2,1.5,-0.3],[0.0,-0.6,1.6]],"tone":{"filmic":{"exposure":3.0}},"scale":0.5,"sharpen":0.3,"sharpen_px":0.7,"jpeg_quality":80,"jpeg_subsampling":"4:2:0","raw":true}"#;
        let sensor: Sensor = serde_json::from_str(all).unwrap();
        sensor.check().unwrap();
        assert_eq!(serde_json::to_string(&sensor).unwrap(), all);
        assert_eq!((sensor.white_level_dn(), sensor.white_e()), (4095, 8062.0));
        let error = serde_json::from_str::<Sensor>(&LINE.replace("bits", "bit")).unwrap_err();
        assert!(error.to_string().contains("unknown field `bit`"), "{error}");
        let half = LINE.replace(r#","level":0.9"#, "");
        let error = serde_json::from_str::<Sensor>(&half).unwrap_err().to_string();
        assert!(error.contains(r#"exposure must be {"factor": f} or"#), "{error}");
    }

    #[test]
    fn rules_between_numbers_are_checked() {
        for (change, message) in [
            (
                (|s| s.black_level_dn = 16_383) as fn(&mut Sensor),
                "sensor.black_level_dn is 16383, but must be below",
            ),
            (|s| s.colour_matrix[0][0] = 1.1, "rows of sensor.colour_matrix must have the sum 1"),
            (|s| s.colour_matrix = [[1.0, 0.0, 0.0]; 3], "determinant"),
        ] {
            let mut changed = sensor();
            change(&mut changed);
            let error = changed.check().unwrap_err().to_string();
            assert!(error.contains(message), "{error}");
        }
    }

    #[test]
    fn mosaics_begin_with_their_name() {
        for mosaic in [Mosaic::Rggb, Mosaic::Bggr, Mosaic::Grbg, Mosaic::Gbrg] {
            let places = [[0, 0], [0, 1], [1, 0], [1, 1]];
            let name: String =
                places.iter().map(|[y, x]| ["r", "g", "b"][mosaic.channel(*y, *x)]).collect();
            assert_eq!(serde_json::to_string(&mosaic).unwrap(), format!("{name:?}"));
            assert_eq!(mosaic.channel(4, 7), mosaic.channel(0, 1));
        }
    }
}
