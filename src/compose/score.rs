//! Peak signal-to-noise ratio and structural similarity of 8-bit pictures, by the two protocols of published scores.
//!
//! | protocol | PSNR | SSIM |
//! |---|---|---|
//! | paper: Kim, Huo and Yoon, CVPR 2020 | one mean square over all channels | of the grey pictures |
//! | errnet: Wei et al., CVPR 2019, and later work | of each channel, then the mean of three | of each channel, then the mean of three |
//!
//! Both protocols use a range of 255 and the SSIM of [`ssim_grey`] (scikit-image's defaults).

use super::EvaluateError;
use super::factor::own_best_factor;
use crate::ssim_grey;
use image::{Rgb, RgbImage};
use serde::{Serialize, Serializer};

/// Scores of a picture against its ground truth. As in scikit-image and numpy, the PSNR of equal pictures and every
/// mean that includes it are infinite (`inf` in files); the mean of no pictures is NaN (null in JSON).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Scores {
    /// Paper protocol: PSNR of all samples of all channels together, dB.
    #[serde(serialize_with = "number")]
    pub psnr_colour_db: f64,
    /// The same after the picture's own best factor of linear light, 0.30 to 2.00 in steps of 0.01.
    #[serde(serialize_with = "number")]
    pub psnr_own_factor_db: f64,
    /// Paper protocol: SSIM of the pictures in 8-bit grey.
    #[serde(serialize_with = "number")]
    pub ssim_grey: f64,
    /// ERRNet protocol: mean of the PSNRs of R, G and B, dB.
    #[serde(serialize_with = "number")]
    pub psnr_channels_db: f64,
    /// ERRNet protocol: mean of the SSIMs of R, G and B.
    #[serde(serialize_with = "number")]
    pub ssim_channels: f64,
}

/// Writes infinity as `inf` or `-inf`, because JSON has no infinite numbers.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde requires a reference")]
pub(super) fn number<S: Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    if value.is_infinite() {
        serializer.serialize_str(if *value > 0.0 { "inf" } else { "-inf" })
    } else {
        serializer.serialize_f64(*value)
    }
}

impl Scores {
    /// Computes the mean of each score.
    pub fn mean(scores: &[Self]) -> Self {
        let mean = |of: fn(&Self) -> f64| scores.iter().map(of).sum::<f64>() / scores.len() as f64;
        Self {
            psnr_colour_db: mean(|s| s.psnr_colour_db),
            psnr_own_factor_db: mean(|s| s.psnr_own_factor_db),
            ssim_grey: mean(|s| s.ssim_grey),
            psnr_channels_db: mean(|s| s.psnr_channels_db),
            ssim_channels: mean(|s| s.ssim_channels),
        }
    }
}

/// Scores a picture against its ground truth.
pub fn score(output: &RgbImage, truth: &RgbImage) -> Result<Scores, EvaluateError> {
    check_same_size(output, truth)?;
    let (width, height) = (output.width() as usize, output.height() as usize);
    let ssim = |plane: &dyn Fn(&RgbImage) -> Vec<u8>| {
        ssim_grey(&plane(output), &plane(truth), width, height)
    };
    let squares = square_sums(output, truth);
    let count = (width * height) as f64;
    let channel_psnrs_db = squares.map(|sum| psnr_db(sum as f64 / count));
    let channel_ssims = [0, 1, 2].map(|c| ssim(&|image| channel(image, c)));
    Ok(Scores {
        psnr_colour_db: psnr_colour_db(output, truth)?,
        psnr_own_factor_db: own_best_factor(output, truth)?.1,
        ssim_grey: ssim(&grey),
        psnr_channels_db: channel_psnrs_db.iter().sum::<f64>() / 3.0,
        ssim_channels: channel_ssims.iter().sum::<f64>() / 3.0,
    })
}

/// Computes the PSNR of all channels together, dB; infinite for equal pictures.
pub fn psnr_colour_db(output: &RgbImage, truth: &RgbImage) -> Result<f64, EvaluateError> {
    check_same_size(output, truth)?;
    let sum: u64 = square_sums(output, truth).iter().sum();
    Ok(psnr_db(sum as f64 / truth.as_raw().len() as f64))
}

/// Checks that two pictures have the same size and at least one pixel.
pub(super) fn check_same_size(a: &RgbImage, b: &RgbImage) -> Result<(), EvaluateError> {
    if a.dimensions() != b.dimensions() {
        return Err(EvaluateError::SizesDiffer {
            a: a.dimensions().into(),
            b: b.dimensions().into(),
        });
    }
    if a.is_empty() {
        return Err(EvaluateError::Empty);
    }
    Ok(())
}

/// Converts a mean square of code differences to a PSNR, dB.
pub(super) fn psnr_db(mean_square: f64) -> f64 {
    10.0 * libm::log10(255.0 * 255.0 / mean_square)
}

/// Sums the squared differences of all pixels, by channel.
fn square_sums(a: &RgbImage, b: &RgbImage) -> [u64; 3] {
    let mut sums = [0; 3];
    for (Rgb(p), Rgb(q)) in a.pixels().zip(b.pixels()) {
        for c in 0..3 {
            sums[c] += u64::from(p[c].abs_diff(q[c])).pow(2);
        }
    }
    sums
}

/// Converts 8-bit colours to grey like OpenCV: weights 0.299, 0.587, 0.114 in units of 2^-15, rounded. Rounding the
/// exact sum instead would differ by one code for about 1 colour in 800.
pub(super) fn grey(image: &RgbImage) -> Vec<u8> {
    let of = |&Rgb([r, g, b]): &Rgb<u8>| {
        (u32::from(r) * 9798 + u32::from(g) * 19235 + u32::from(b) * 3735 + (1 << 14)) >> 15
    };
    image.pixels().map(|pixel| of(pixel) as u8).collect()
}

fn channel(image: &RgbImage, c: usize) -> Vec<u8> {
    image.pixels().map(|pixel| pixel[c]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Makes the pictures of `tests/train/scores.py`.
    fn pictures() -> (RgbImage, RgbImage) {
        let at = |x: u32, y: u32, c: u32| (x * x * 3 + y * 7 + x * y * (c + 2) + c * 41) % 251;
        let truth =
            RgbImage::from_fn(45, 31, |x, y| Rgb([0, 1, 2].map(|c| at(x, y, c as u32) as u8)));
        let output = RgbImage::from_fn(45, 31, |x, y| {
            Rgb([0, 1, 2].map(|c: u32| ((at(x, y, c) * 5 + at(x + 2, y + c, c)) / 6) as u8))
        });
        (output, truth)
    }

    #[test]
    fn scikit_image_agrees() {
        // tests/train/scores.py makes the numbers.
        let expected = Scores {
            psnr_colour_db: 23.572_454_967_125_847,
            psnr_own_factor_db: 23.834_986_278_751_863,
            ssim_grey: 0.968_866_613_728_260_6,
            psnr_channels_db: 23.573_709_776_179_1,
            ssim_channels: 0.967_506_967_104_718_2,
        };
        let (output, truth) = pictures();
        let found = score(&output, &truth).unwrap();
        let off = [
            found.psnr_colour_db - expected.psnr_colour_db,
            found.psnr_own_factor_db - expected.psnr_own_factor_db,
            found.ssim_grey - expected.ssim_grey,
            found.psnr_channels_db - expected.psnr_channels_db,
            found.ssim_channels - expected.ssim_channels,
        ];
        assert!(off.iter().all(|d| d.abs() < 1e-9), "{found:?}");
    }

    #[test]
    fn psnr_of_equal_pictures_is_infinite() {
        let (picture, other) = pictures();
        let scores = score(&picture, &picture).unwrap();
        assert_eq!(scores.psnr_colour_db, f64::INFINITY);
        assert_eq!(scores.psnr_own_factor_db, f64::INFINITY);
        assert_eq!(scores.psnr_channels_db, f64::INFINITY);
        assert!((scores.ssim_grey - 1.0).abs() < 1e-12);
        assert!((scores.ssim_channels - 1.0).abs() < 1e-12);
        let mean = Scores::mean(&[scores, score(&picture, &other).unwrap()]);
        assert_eq!(mean.psnr_colour_db, f64::INFINITY);
        assert!(mean.ssim_grey < 1.0);
    }

    #[test]
    fn pictures_of_different_sizes_are_refused() {
        let error = score(&RgbImage::new(3, 2), &RgbImage::new(2, 3)).unwrap_err();
        assert!(error.to_string().contains("3 x 2 px"), "{error}");
        let error = score(&RgbImage::new(0, 0), &RgbImage::new(0, 0)).unwrap_err();
        assert!(matches!(error, EvaluateError::Empty));
        assert!(score(&RgbImage::new(1, 1), &RgbImage::new(1, 1)).is_ok());
    }
}
