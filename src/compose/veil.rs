//! The veil rule: a reflection as a uniform veil of light, and a factor.
//!
//! T = g (I - k b) in linear light, at least 0, where b of each channel is the 0.5 % percentile of the channel's codes:
//! nearly the darkest light of the picture, which a reflection brightens. A network that only subtracts a veil gains no
//! more than this rule with two numbers.

use super::code_sums::{CodeSums, CodeTable};
use super::factor::decimals;
use glasshouse_line::color::{SrgbEncoder, srgb_to_linear};
use image::{Rgb, RgbImage};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Share of a channel's samples that are darker than its veil.
const DARKEST: f64 = 0.5 / 100.0;

/// Steps of `k`, tenths, and of `g`, hundredths, of a fit.
const TENTHS_OF_K: std::ops::RangeInclusive<u32> = 0..=10;
const HUNDREDTHS_OF_G: std::ops::RangeInclusive<u32> = 50..=200;

/// Two numbers of the rule T = g (I - k b).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VeilRule {
    /// Factor of linear light.
    pub g: f64,
    /// Share of the veil that is subtracted.
    pub k: f64,
}

impl VeilRule {
    /// Returns the name of the table's row: `veil rule 0.88, 0.80`.
    pub fn row_name(self) -> String {
        format!("veil rule {}, {}", decimals(self.g), decimals(self.k))
    }

    /// Applies the rule to a picture and returns sRGB codes.
    pub fn apply(self, picture: &RgbImage) -> RgbImage {
        let codes = Codes::default();
        let tables = veil_codes(picture).map(|veil| self.table(&codes, veil));
        let mut changed = picture.clone();
        for Rgb(pixel) in changed.pixels_mut() {
            for (code, table) in pixel.iter_mut().zip(&tables) {
                *code = table[usize::from(*code)];
            }
        }
        changed
    }

    fn table(self, codes: &Codes, veil: u8) -> CodeTable {
        let taken = self.k * codes.light[usize::from(veil)];
        codes.light.map(|light| codes.encoder.encode((self.g * (light - taken)).max(0.0) as f32))
    }
}

/// Conversions between codes and light. A fit makes a hundred million of them.
struct Codes {
    encoder: SrgbEncoder,
    /// Linear light of each code.
    light: [f64; 256],
}

impl Default for Codes {
    fn default() -> Self {
        let light = std::array::from_fn(|code| f64::from(srgb_to_linear(code as u8)));
        Self { encoder: SrgbEncoder::new(), light }
    }
}

/// Returns the 0.5 % percentile of each channel's codes, rounded down. Interpolates like `numpy.percentile`.
pub(super) fn veil_codes(picture: &RgbImage) -> [u8; 3] {
    let mut counts = [[0u64; 256]; 3];
    for Rgb(pixel) in picture.pixels() {
        for (counts, code) in counts.iter_mut().zip(pixel) {
            counts[usize::from(*code)] += 1;
        }
    }
    let pixels = u64::from(picture.width()) * u64::from(picture.height());
    let last = pixels.saturating_sub(1);
    let place = last as f64 * DARKEST;
    let (below, share) = (place.floor() as u64, place - place.floor());
    counts.map(|counts| {
        let at = |place: u64| {
            let mut before = 0;
            let code = counts.iter().position(|count| {
                before += count;
                before > place
            });
            code.unwrap_or(255) as f64
        };
        let (low, high) = (at(below), at((below + 1).min(last)));
        // numpy rounds the interpolation symmetrically.
        let between = if share < 0.5 {
            low + (high - low) * share
        } else {
            high - (high - low) * (1.0 - share)
        };
        between as u8
    })
}

/// A picture of a fit: its sums and the codes of its veil.
pub(super) type OfFit = (CodeSums, [u8; 3]);

/// Finds the rule with the best mean PSNR of the pictures: k in steps of 0.1, g in steps of 0.01. Among equal ones, the
/// weakest k and then the lowest g wins. Without pictures, the rule changes nothing.
pub(super) fn fit_veil(pictures: &[OfFit]) -> VeilRule {
    if pictures.is_empty() {
        return VeilRule { g: 1.0, k: 0.0 };
    }
    let codes = Codes::default();
    let rules: Vec<VeilRule> = TENTHS_OF_K
        .flat_map(|k| HUNDREDTHS_OF_G.map(move |g| (g, k)))
        .map(|(g, k)| VeilRule { g: f64::from(g) / 100.0, k: f64::from(k) / 10.0 })
        .collect();
    let sum_db = |rule: &VeilRule| {
        let psnrs_db = pictures.iter().map(|(sums, veil)| {
            let [r, g, b] = veil.map(|veil| rule.table(&codes, veil));
            sums.finite_psnr_db([&r, &g, &b])
        });
        psnrs_db.sum::<f64>()
    };
    let sums_db: Vec<f64> = rules.par_iter().map(sum_db).collect();
    let mut best = 0;
    for (place, sum_db) in sums_db.iter().enumerate() {
        if *sum_db > sums_db[best] {
            best = place;
        }
    }
    rules[best]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::psnr_colour_db;

    /// Makes a picture as `tests/train/veil.py`.
    fn picture(width: u32, height: u32) -> RgbImage {
        RgbImage::from_fn(width, height, |x, y| {
            let at =
                |c: u32| 9 + 17 * c + (x * x * 3 + y * 7 + x * y * (c + 2) + c * 41) % (200 + c);
            Rgb([0, 1, 2].map(|c| at(c) as u8))
        })
    }

    #[test]
    fn numpy_agrees() {
        // `tests/train/veil.py` makes the numbers: the codes of the veil, and sum and sum of squares of the output.
        for (size, veil, sums) in NUMPY {
            let picture = picture(size[0], size[1]);
            assert_eq!(veil_codes(&picture), veil, "{size:?}");
            let made = VeilRule { g: 0.88, k: 0.8 }.apply(&picture);
            let sum: u64 = made.as_raw().iter().map(|&code| u64::from(code)).sum();
            let squares: u64 = made.as_raw().iter().map(|&code| u64::from(code).pow(2)).sum();
            assert_eq!([sum, squares], sums, "{size:?}");
        }
    }

    #[test]
    fn a_known_veil_is_found() {
        let truth = picture(90, 60);
        // The picture is brighter by a constant light: the rule subtracts the veil.
        let veiled = VeilRule { g: 1.0 / 0.9, k: -2.0 }.apply(&truth);
        let of_fit = (CodeSums::of(&veiled, &truth).unwrap(), veil_codes(&veiled));
        let rule = fit_veil(std::slice::from_ref(&of_fit));
        assert!((rule.g - 0.9).abs() < 0.03 && (rule.k - 0.7).abs() < 0.11, "{rule:?}");
        let psnr_db = |rule: VeilRule| psnr_colour_db(&rule.apply(&veiled), &truth).unwrap();
        assert!(psnr_db(rule) > psnr_db(VeilRule { k: 0.0, ..rule }) + 3.0);
        assert!(psnr_db(rule) > psnr_db(VeilRule { g: 1.0, ..rule }));
        // The sums give the PSNR of the rule's pictures.
        let [r, g, b] = of_fit.1.map(|veil| rule.table(&Codes::default(), veil));
        assert!((of_fit.0.psnr_db([&r, &g, &b]) - psnr_db(rule)).abs() < 1e-9);
        assert_eq!(fit_veil(&[]).apply(&veiled), veiled);
    }

    #[test]
    fn rules_are_kept_in_json() {
        let rule = VeilRule { g: 0.88, k: 0.8 };
        let text = serde_json::to_string(&rule).unwrap();
        assert_eq!(text, r#"{"g":0.88,"k":0.8}"#);
        assert_eq!(serde_json::from_str::<VeilRule>(&text).unwrap(), rule);
        assert_eq!(rule.row_name(), "veil rule 0.88, 0.80");
        assert_eq!(VeilRule { g: 0.875, ..rule }.row_name(), "veil rule 0.875, 0.80");
    }

    /// Size, codes of the veil, and sums of the output.
    const NUMPY: [([u32; 2], [u8; 3], [u64; 2]); 6] = [
        ([45, 31], [9, 26, 43], [481_167, 69_851_373]),
        ([90, 60], [10, 26, 43], [1_861_446, 269_834_010]),
        ([7, 3], [9, 67, 53], [6_079, 805_257]),
        ([1, 1], [9, 67, 125], [80, 3_438]),
        ([201, 1], [9, 28, 50], [64_808, 9_010_772]),
        ([640, 421], [10, 27, 44], [92_789_583, 13_459_723_053]),
    ];
}
