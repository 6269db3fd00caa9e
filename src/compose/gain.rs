//! Finds the best factor of linear light for all pictures of a method.
//!
//! A ground truth photographed through the glass is about a tenth darker than one without glass. A method may learn
//! either brightness. The best factor separates the effect of brightness on a score from that of reflection removal.

use super::EvaluateError;
use super::score::{check_same_size, psnr_db};
use image::{Rgb, RgbImage};
use render::color::{SrgbEncoder, srgb_to_linear};

/// Range of the factor, in hundredths.
const HUNDREDTHS: std::ops::RangeInclusive<u32> = 50..=200;

/// Precision of the best factor.
const NEAR: f64 = 1e-3;

/// Least mean square error of a pair. It makes the PSNR of equal pictures finite, so that other pairs still count.
const LEAST_MEAN_SQUARE: f64 = 1e-4;

/// Finds the factor of the outputs' linear light, 0.5 to 2, that maximises the mean colour PSNR of the pairs (output,
/// truth), to 0.001. Rounds and clamps codes as in files. Returns 1 without pairs.
pub fn best_gain<'a>(
    pairs: impl IntoIterator<Item = (&'a RgbImage, &'a RgbImage)>,
) -> Result<f64, EvaluateError> {
    let sums: Vec<CodeSums> = pairs
        .into_iter()
        .map(|(output, truth)| CodeSums::of(output, truth))
        .collect::<Result<_, _>>()?;
    if sums.is_empty() {
        return Ok(1.0);
    }
    let encoder = SrgbEncoder::new();
    let mut best = (f64::NEG_INFINITY, 1.0);
    let mut mean_psnr_db = |gain: f64| {
        let table = codes(&encoder, gain);
        let psnrs_db = sums.iter().map(|sums| sums.psnr_db(&table));
        let mean = psnrs_db.sum::<f64>() / sums.len() as f64;
        if mean > best.0 {
            best = (mean, gain);
        }
        mean
    };
    // 1 comes first, so that it wins ties.
    mean_psnr_db(1.0);
    let (mut low, mut high) = (0.0, 0.0);
    let mut top = f64::NEG_INFINITY;
    for hundredth in HUNDREDTHS {
        let gain = f64::from(hundredth) / 100.0;
        let mean = mean_psnr_db(gain);
        if mean > top {
            (top, low, high) = (mean, gain - 0.01, gain + 0.01);
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
    Ok(best.1.clamp(0.5, 2.0))
}

/// Multiplies the linear light of a picture by `gain` and returns sRGB codes.
pub fn apply_gain(image: &RgbImage, gain: f64) -> RgbImage {
    let table = codes(&SrgbEncoder::new(), gain);
    let mut brighter = image.clone();
    for Rgb(pixel) in brighter.pixels_mut() {
        *pixel = pixel.map(|code| table[usize::from(code)]);
    }
    brighter
}

/// Returns the new code for each old code.
fn codes(encoder: &SrgbEncoder, gain: f64) -> [u8; 256] {
    std::array::from_fn(|code| {
        encoder.encode((f64::from(srgb_to_linear(code as u8)) * gain) as f32)
    })
}

/// Count, sum and sum of squares of the truth's samples by code of the output, which give the PSNR of any factor.
struct CodeSums([[u64; 3]; 256]);

impl CodeSums {
    fn of(output: &RgbImage, truth: &RgbImage) -> Result<Self, EvaluateError> {
        check_same_size(output, truth)?;
        let mut sums = [[0; 3]; 256];
        for (code, truth) in output.as_raw().iter().zip(truth.as_raw()) {
            let (sum, truth) = (&mut sums[usize::from(*code)], u64::from(*truth));
            sum[0] += 1;
            sum[1] += truth;
            sum[2] += truth * truth;
        }
        Ok(Self(sums))
    }

    fn psnr_db(&self, table: &[u8; 256]) -> f64 {
        let (mut squares, mut count) = (0, 0);
        for ([n, sum, sum_of_squares], code) in self.0.iter().zip(table) {
            let code = u64::from(*code);
            squares += n * code * code + sum_of_squares - 2 * code * sum;
            count += n;
        }
        psnr_db((squares as f64 / count as f64).max(LEAST_MEAN_SQUARE))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::score;

    fn picture(salt: u32) -> RgbImage {
        RgbImage::from_fn(64, 48, |x, y| {
            Rgb([0, 1, 2].map(|c| ((x * 3 + y * y * (c + 1) + x * y * salt + 17 * c) % 200) as u8))
        })
    }

    #[test]
    fn a_known_gain_is_found() {
        let truths = [picture(1), picture(4)];
        let outputs = truths.each_ref().map(|truth| apply_gain(truth, 0.9));
        let gain = best_gain(outputs.iter().zip(&truths)).unwrap();
        assert!((gain - 1.0 / 0.9).abs() < 0.005, "{gain}");
        // Other factors give lower scores.
        let psnr_db = |gain: f64| {
            let of =
                |(output, truth)| score(&apply_gain(output, gain), truth).unwrap().psnr_colour_db;
            outputs.iter().zip(&truths).map(of).sum::<f64>()
        };
        for other in [0.9, 0.99, 1.01, 1.1] {
            assert!(psnr_db(gain) > psnr_db(gain * other));
        }
    }

    #[test]
    fn sums_by_code_give_the_score() {
        let (output, truth) = (picture(1), picture(2));
        let table = codes(&SrgbEncoder::new(), 1.3);
        let found = CodeSums::of(&output, &truth).unwrap().psnr_db(&table);
        let expected = score(&apply_gain(&output, 1.3), &truth).unwrap().psnr_colour_db;
        assert!((found - expected).abs() < 1e-9, "{found} {expected}");
    }

    #[test]
    fn equal_pictures_have_gain_1() {
        let image = picture(3);
        assert_eq!(apply_gain(&image, 1.0), image);
        let gain = best_gain([(&image, &image)]).unwrap();
        assert!((gain - 1.0).abs() < 1e-9, "{gain}");
        assert_eq!(best_gain([]).unwrap(), 1.0);
        let black = RgbImage::new(4, 4);
        let gain = best_gain([(&black, &image)]);
        assert!(gain.is_err());
        assert_eq!(best_gain([(&black, &black)]).unwrap(), 1.0);
    }
}
