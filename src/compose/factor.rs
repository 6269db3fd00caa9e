//! Factors of linear light: the simplest change of a picture, and the best factors of one picture and of several.
//!
//! A ground truth photographed through the glass is about a tenth darker than one without glass, and exposures differ.
//! A network may learn either brightness. The best factor separates the effect of brightness on a score from that of
//! reflection removal.

use super::EvaluateError;
use super::code_sums::{CodeSums, CodeTable};
use glasshouse_line::color::{SrgbEncoder, srgb_to_linear};
use image::{Rgb, RgbImage};
use serde::{Deserialize, Serialize};
use std::sync::LazyLock;

/// Factors of linear light that own factors and best factors of a group are chosen from, in hundredths.
const HUNDREDTHS: std::ops::RangeInclusive<u32> = 30..=200;

/// Range of fitted factors, in hundredths.
const FITTED_HUNDREDTHS: std::ops::RangeInclusive<u32> = 50..=200;

/// Precision of a fitted factor.
const NEAR: f64 = 1e-3;

/// The factors of [`HUNDREDTHS`] with their tables. 1 comes first, so that it wins ties.
static TABLES: LazyLock<Vec<(Factor, CodeTable)>> = LazyLock::new(|| {
    let encoder = SrgbEncoder::new();
    let hundredths = std::iter::once(100).chain(HUNDREDTHS.filter(|&k| k != 100));
    let factors = hundredths.map(|k| Factor(f64::from(k) / 100.0));
    factors.map(|factor| (factor, factor.table(&encoder))).collect()
});

/// A factor of the linear light of all pixels. Codes are rounded and clamped as in files.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Factor(pub f64);

impl Factor {
    /// Returns the name of the table's row: `input x 0.83`.
    pub fn row_name(self) -> String {
        format!("input x {}", decimals(self.0))
    }

    /// Multiplies the linear light of a picture and returns sRGB codes.
    pub fn apply(self, picture: &RgbImage) -> RgbImage {
        let table = self.table(&SrgbEncoder::new());
        let mut changed = picture.clone();
        for Rgb(pixel) in changed.pixels_mut() {
            *pixel = pixel.map(|code| table[usize::from(code)]);
        }
        changed
    }

    fn table(self, encoder: &SrgbEncoder) -> CodeTable {
        std::array::from_fn(|code| {
            encoder.encode((f64::from(srgb_to_linear(code as u8)) * self.0) as f32)
        })
    }
}

/// Formats a number with two decimals if these are exact, otherwise with three.
pub(super) fn decimals(number: f64) -> String {
    let two = format!("{number:.2}");
    if two.parse() == Ok(number) { two } else { format!("{number:.3}") }
}

/// Finds a picture's own best factor, 0.30 to 2.00 in steps of 0.01, and the PSNR after it, dB.
pub(super) fn own_factor(sums: &CodeSums) -> (Factor, f64) {
    best(|table| sums.psnr_db([table; 3]))
}

/// Finds the factor, 0.30 to 2.00 in steps of 0.01, with the best mean PSNR of several pictures.
pub(super) fn best_factor_of_group(group: &[&CodeSums]) -> Factor {
    best(|table| group.iter().map(|sums| sums.finite_psnr_db([table; 3])).sum()).0
}

fn best(score_db: impl Fn(&CodeTable) -> f64) -> (Factor, f64) {
    let mut best = (Factor(1.0), f64::NEG_INFINITY);
    for (factor, table) in TABLES.iter() {
        let score_db = score_db(table);
        if score_db > best.1 {
            best = (*factor, score_db);
        }
    }
    best
}

/// Finds a picture's own best factor, 0.30 to 2.00 in steps of 0.01, and the PSNR after it, dB; infinite if the picture
/// then equals the truth.
pub fn own_best_factor(
    picture: &RgbImage,
    truth: &RgbImage,
) -> Result<(Factor, f64), EvaluateError> {
    Ok(own_factor(&CodeSums::of(picture, truth)?))
}

/// Finds the factor, 0.5 to 2, that maximises the mean colour PSNR of the pictures, to 0.001. Returns 1 without pictures.
pub(super) fn fit_factor(pictures: &[&CodeSums]) -> Factor {
    if pictures.is_empty() {
        return Factor(1.0);
    }
    let encoder = SrgbEncoder::new();
    let mut best = (f64::NEG_INFINITY, 1.0);
    let mut mean_psnr_db = |factor: f64| {
        let table = Factor(factor).table(&encoder);
        let psnrs_db = pictures.iter().map(|sums| sums.finite_psnr_db([&table; 3]));
        let mean = psnrs_db.sum::<f64>() / pictures.len() as f64;
        if mean > best.0 {
            best = (mean, factor);
        }
        mean
    };
    // 1 comes first, so that it wins ties.
    mean_psnr_db(1.0);
    let (mut low, mut high) = (0.0, 0.0);
    let mut top = f64::NEG_INFINITY;
    for hundredth in FITTED_HUNDREDTHS {
        let factor = f64::from(hundredth) / 100.0;
        let mean = mean_psnr_db(factor);
        if mean > top {
            (top, low, high) = (mean, factor - 0.01, factor + 0.01);
        }
    }
    // Golden-section search. Rounded codes make the curve stepped, so the result is the best of all tried factors.
    let section = (5f64.sqrt() - 1.0) / 2.0;
    let (mut left, mut right) = (high - section * (high - low), low + section * (high - low));
    let (mut at_left, mut at_right) = (mean_psnr_db(left), mean_psnr_db(right));
    while high - low > NEAR {
        if at_left > at_right {
            (high, right, at_right) = (right, left, at_left);
            left = high - section * (high - low);
            at_left = mean_psnr_db(left);
        } else {
            (low, left, at_left) = (left, right, at_right);
            right = low + section * (high - low);
            at_right = mean_psnr_db(right);
        }
    }
    Factor(best.1.clamp(0.5, 2.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::psnr_colour_db;

    fn picture(salt: u32) -> RgbImage {
        RgbImage::from_fn(64, 48, |x, y| {
            Rgb([0, 1, 2].map(|c| ((x * 3 + y * y * (c + 1) + x * y * salt + 17 * c) % 200) as u8))
        })
    }

    fn sums(picture: &RgbImage, truth: &RgbImage) -> CodeSums {
        CodeSums::of(picture, truth).unwrap()
    }

    #[test]
    fn a_known_factor_is_fitted() {
        let truths = [picture(1), picture(4)];
        let outputs = truths.each_ref().map(|truth| Factor(0.9).apply(truth));
        let of = [sums(&outputs[0], &truths[0]), sums(&outputs[1], &truths[1])];
        let Factor(factor) = fit_factor(&of.each_ref());
        assert!((factor - 1.0 / 0.9).abs() < 0.005, "{factor}");
        // Other factors give lower scores.
        let psnr_db = |factor: f64| {
            let of =
                |(output, truth)| psnr_colour_db(&Factor(factor).apply(output), truth).unwrap();
            outputs.iter().zip(&truths).map(of).sum::<f64>()
        };
        for other in [0.9, 0.99, 1.01, 1.1] {
            assert!(psnr_db(factor) > psnr_db(factor * other));
        }
        assert_eq!(best_factor_of_group(&of.each_ref()), Factor(1.11));
    }

    #[test]
    fn sums_by_code_give_the_score() {
        let (output, truth) = (picture(1), picture(2));
        let table = Factor(1.3).table(&SrgbEncoder::new());
        let found = sums(&output, &truth).psnr_db([&table; 3]);
        let expected = psnr_colour_db(&Factor(1.3).apply(&output), &truth).unwrap();
        assert!((found - expected).abs() < 1e-9, "{found} {expected}");
    }

    #[test]
    fn the_own_factor_is_the_best_of_all_hundredths() {
        let truth = picture(2);
        let output = Factor(0.47).apply(&picture(2));
        let (factor, psnr_db) = own_best_factor(&output, &truth).unwrap();
        let psnrs_db = HUNDREDTHS
            .map(|k| psnr_colour_db(&Factor(f64::from(k) / 100.0).apply(&output), &truth).unwrap());
        let best = psnrs_db.fold(f64::NEG_INFINITY, f64::max);
        assert!((psnr_db - best).abs() < 1e-9, "{psnr_db} {best}");
        assert_eq!(factor, Factor(2.0));
        // The factor of a group is a compromise.
        let bright = sums(&Factor(1.25).apply(&truth), &truth);
        let Factor(both) = best_factor_of_group(&[&bright, &sums(&output, &truth)]);
        assert!((0.8..2.0).contains(&both), "{both}");
        assert_eq!(own_factor(&bright).0, Factor(0.8));
    }

    #[test]
    fn equal_pictures_have_factor_1() {
        let image = picture(3);
        assert_eq!(Factor(1.0).apply(&image), image);
        assert_eq!(own_best_factor(&image, &image).unwrap(), (Factor(1.0), f64::INFINITY));
        assert_eq!(fit_factor(&[&sums(&image, &image)]), Factor(1.0));
        assert_eq!(fit_factor(&[]), Factor(1.0));
        let black = RgbImage::new(4, 4);
        assert!(own_best_factor(&black, &image).is_err());
        assert_eq!(fit_factor(&[&sums(&black, &black)]), Factor(1.0));
    }

    #[test]
    fn rows_have_two_decimals_if_these_are_exact() {
        assert_eq!(Factor(0.83).row_name(), "input x 0.83");
        assert_eq!(Factor(0.8341).row_name(), "input x 0.834");
    }
}
