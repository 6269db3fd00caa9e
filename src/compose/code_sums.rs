//! Sums over a pair of pictures by code, which give the PSNR after any table of codes without another pass.

use super::EvaluateError;
use super::score::{check_same_size, psnr_db};
use image::{Rgb, RgbImage};

/// New code for each old code.
pub(super) type CodeTable = [u8; 256];

/// Least mean square error of a pair in a mean over pairs. It makes the PSNR of equal pictures finite, so that other
/// pairs still count.
const LEAST_MEAN_SQUARE: f64 = 1e-4;

/// Count, sum and sum of squares of the truth's samples, by channel and by code of the picture.
#[derive(Clone)]
pub(super) struct CodeSums(Vec<[[u64; 3]; 256]>);

impl CodeSums {
    pub(super) fn of(picture: &RgbImage, truth: &RgbImage) -> Result<Self, EvaluateError> {
        check_same_size(picture, truth)?;
        let mut sums = vec![[[0; 3]; 256]; 3];
        for (Rgb(codes), Rgb(truths)) in picture.pixels().zip(truth.pixels()) {
            for c in 0..3 {
                let (sum, truth) = (&mut sums[c][usize::from(codes[c])], u64::from(truths[c]));
                sum[0] += 1;
                sum[1] += truth;
                sum[2] += truth * truth;
            }
        }
        Ok(Self(sums))
    }

    /// Returns the mean square error over all channels after the tables of R, G and B.
    fn mean_square(&self, tables: [&CodeTable; 3]) -> f64 {
        let (mut squares, mut count) = (0, 0);
        for (sums, table) in self.0.iter().zip(tables) {
            for ([n, sum, sum_of_squares], code) in sums.iter().zip(table) {
                let code = u64::from(*code);
                squares += n * code * code + sum_of_squares - 2 * code * sum;
                count += n;
            }
        }
        squares as f64 / count as f64
    }

    /// Returns the PSNR after the tables, dB; infinite if the picture then equals the truth.
    pub(super) fn psnr_db(&self, tables: [&CodeTable; 3]) -> f64 {
        psnr_db(self.mean_square(tables))
    }

    /// Returns the PSNR after the tables, dB, limited to 88 dB.
    pub(super) fn finite_psnr_db(&self, tables: [&CodeTable; 3]) -> f64 {
        psnr_db(self.mean_square(tables).max(LEAST_MEAN_SQUARE))
    }
}
