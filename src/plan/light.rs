//! `[light]` and `[reject]` of a recipe: luminance scale, white balance, exposure, and the bounds of accepted scenes.

use super::draw::nine_digits;
use glasshouse_line::param::Param;
use schemars::JsonSchema;
use serde::Deserialize;

/// `[light]`: luminance scale, white balance and exposure.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct LightRecipe {
    /// Luminance scale of both sides at exposure 1. Default `stored`.
    pub scale: LuminanceScale,
    /// Reference white of the camera. Default `none`.
    pub white_balance: WhiteBalance,
    /// Exposure from a percentile of I. Default none: the camera's exposure is 1.
    pub auto_exposure: Option<AutoExposure>,
}

/// The luminance scale of a side at exposure 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LuminanceScale {
    /// The values of the file.
    #[default]
    Stored,
    /// The values of the file, scaled to a geometric mean luminance of 0.18. Photographs have individual exposures, so
    /// the recipe's exposures determine the ratio of front and back only on a common scale.
    Metered,
}

/// Reference white of the camera.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum WhiteBalance {
    /// Equal red, green and blue.
    #[default]
    None,
    /// The front's illuminant.
    Front,
    /// The back's illuminant.
    Back,
    /// The mean colour of I.
    GreyWorld,
}

/// Exposure from a percentile of I.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AutoExposure {
    /// Percentile of the largest channel of each pixel: above 0, at most 100.
    pub percentile: f64,
    /// Linear value that the exposure assigns to this percentile: above 0. 8-bit pictures clip at 1.
    pub level: f64,
}

/// `[reject]`: bounds of accepted scenes, measured on a preview. A missing bound is not checked.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RejectRecipe {
    /// Mean luminance of R~ divided by that of I: `[least, most]`.
    pub reflected_share: Option<[f64; 2]>,
    /// Standard deviation of R~'s luminance divided by the mean luminance of I: `[least, most]`.
    /// It is low for a reflection without structure.
    pub contrast: Option<[f64; 2]>,
    /// Largest allowed share of pixels of I with a channel of 1 or more.
    pub clipped_share: Option<f64>,
    /// Structural similarity of I and T (sRGB-coded grey, 7 x 7 px): `[least, most]`.
    pub ssim: Option<[f64; 2]>,
}

impl RejectRecipe {
    /// Returns the keys with their bounds `[least, most]`.
    pub(super) fn bounds(&self) -> [(&'static str, Option<[f64; 2]>); 4] {
        [
            ("reflected_share", self.reflected_share),
            ("contrast", self.contrast),
            ("clipped_share", self.clipped_share.map(|most| [0.0, most])),
            ("ssim", self.ssim),
        ]
    }
}

/// A drawn light: factors on the light of the files.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct DrawnLight {
    pub(super) exposure: f64,
    pub(super) illuminant: [f64; 3],
}

impl DrawnLight {
    /// Returns the light with `factor` times the exposure.
    pub(super) fn times(self, factor: f64) -> Self {
        Self { exposure: self.exposure * factor, ..self }
    }
}

/// Exposure of one side's light, from `[front]` or `[back]`.
#[derive(Clone, Copy, Debug)]
pub(super) struct SideLight<'a> {
    pub(super) exposure: &'a Param,
    pub(super) exposure_ev: Option<&'a Param>,
}

/// Computes the linear Rec.709 colour of a black body's light, with luminance 1.
///
/// Uses Kim et al.'s cubic splines of the Planckian locus (US patent 7,024,034, 2006; 1,667 to 25,000 K, within 0.001
/// of x and y). Below about 1,900 K, blue is negative. Photographs are assumed to be balanced for D65, so light of
/// 6,504 K leaves them nearly unchanged.
pub(crate) fn illuminant(kelvin: f64) -> [f64; 3] {
    let t = 1e3 / kelvin;
    let x = if kelvin <= 4000.0 {
        -0.266_123_9 * t * t * t - 0.234_358_9 * t * t + 0.877_695_6 * t + 0.179_910
    } else {
        -3.025_846_9 * t * t * t + 2.107_037_9 * t * t + 0.222_634_7 * t + 0.240_390
    };
    let y = if kelvin <= 2222.0 {
        -1.106_381_4 * x * x * x - 1.348_110_2 * x * x + 2.185_558_32 * x - 0.202_196_83
    } else if kelvin <= 4000.0 {
        -0.954_947_6 * x * x * x - 1.374_185_93 * x * x + 2.091_370_15 * x - 0.167_488_67
    } else {
        3.081_758 * x * x * x - 5.873_386_7 * x * x + 3.751_129_97 * x - 0.370_014_83
    };
    let [big_x, big_z] = [x / y, (1.0 - x - y) / y];
    // XYZ to linear Rec.709 (IEC 61966-2-1), for Y = 1.
    [
        3.240_970 * big_x - 1.537_383 - 0.498_611 * big_z,
        -0.969_244 * big_x + 1.875_968 + 0.041_555 * big_z,
        0.055_630 * big_x - 0.203_977 + 1.056_972 * big_z,
    ]
}

/// Computes the gains that make `color` grey without changing green, as in cameras. All channels must be above 0.
pub(crate) fn gains_against(color: [f64; 3]) -> [f64; 3] {
    color.map(|channel| nine_digits(color[1] / channel))
}

/// Computes the luminance of a linear Rec.709 colour.
pub(crate) fn luminance([red, green, blue]: [f64; 3]) -> f64 {
    0.2126 * red + 0.7152 * green + 0.0722 * blue
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn black_bodies_have_their_published_colours() {
        // Chromaticities of the Planckian locus from CIE 15: 2856 K (illuminant A) and three other temperatures.
        for (kelvin, [x, y]) in [
            (2856.0, [0.4476, 0.4074]),
            (4000.0, [0.3805, 0.3768]),
            (6500.0, [0.3135, 0.3237]),
            (10000.0, [0.2807, 0.2884]),
        ] {
            let [r, g, b] = illuminant(kelvin);
            let xyz = [
                0.412_391 * r + 0.357_584 * g + 0.180_481 * b,
                0.212_639 * r + 0.715_169 * g + 0.072_192 * b,
                0.019_331 * r + 0.119_195 * g + 0.950_532 * b,
            ];
            let sum: f64 = xyz.iter().sum();
            assert!((xyz[0] / sum - x).abs() < 1.2e-3, "{kelvin}: {}", xyz[0] / sum);
            assert!((xyz[1] / sum - y).abs() < 1.2e-3, "{kelvin}: {}", xyz[1] / sum);
            assert!((luminance([r, g, b]) - 1.0).abs() < 1e-3);
        }
    }

    #[test]
    fn the_spline_is_continuous_and_no_channel_is_negative_from_2000_k() {
        for seam in [2222.0, 4000.0] {
            let (below, above) = (illuminant(seam), illuminant(seam + 1e-6));
            for c in 0..3 {
                assert!((below[c] - above[c]).abs() < 0.02, "{seam}: {below:?} {above:?}");
            }
        }
        for step in 0..=230 {
            let color = illuminant(2000.0 + 100.0 * f64::from(step));
            assert!(color.iter().all(|c| *c > 0.0), "{step}: {color:?}");
        }
    }
}
