//! Reduces pictures with Lanczos' filter, with the same codes as `Image.resize(size, LANCZOS)` of Pillow.
//!
//! Pillow's `Resample.c` filters rows, then columns, with 8-bit codes in between. Its weights are integers in units of
//! 2^-22. Published scores of reduced pictures are reproducible only with the same rounding.

use image::RgbImage;
use std::f64::consts::PI;

/// Binary digits of a weight's fraction: a sum of 8-bit codes times weights needs 8 more digits and 2 for its sign and
/// for overshoot.
const FRACTION_BITS: u32 = 32 - 8 - 2;

/// Half of the filter's width, in output pixels.
const SUPPORT: f64 = 3.0;

/// Returns the size to which [`shrink_to`] reduces a picture: the longest side becomes `longest_px`, and the other side
/// is rounded, half to even, and at least 1 px. Pictures without a longer side keep their size.
pub fn shrunk_size_px([width, height]: [u32; 2], longest_px: u32) -> [u32; 2] {
    let longest = width.max(height);
    if longest <= longest_px {
        return [width, height];
    }
    let scale = f64::from(longest_px) / f64::from(longest);
    [width, height].map(|side| ((f64::from(side) * scale).round_ties_even() as u32).max(1))
}

/// Reduces a picture so that no side is longer than `longest_px`. Never enlarges.
pub fn shrink_to(picture: RgbImage, longest_px: u32) -> RgbImage {
    let size = shrunk_size_px(picture.dimensions().into(), longest_px);
    resize(picture, size)
}

/// Resizes a picture of at least 1 x 1 px to `size`, px.
pub fn resize(picture: RgbImage, [width, height]: [u32; 2]) -> RgbImage {
    let picture = if picture.width() == width { picture } else { resize_rows(&picture, width) };
    if picture.height() == height { picture } else { resize_columns(&picture, height) }
}

/// The input samples of one output sample, and their weights.
struct Weights {
    first: usize,
    weights: Vec<i32>,
}

/// Computes the weights of each output sample along one axis.
fn weights(from: u32, to: u32) -> Vec<Weights> {
    let scale = f64::from(from) / f64::from(to);
    let filter_scale = scale.max(1.0);
    let support = SUPPORT * filter_scale;
    let of = |place: u32| {
        let centre = (f64::from(place) + 0.5) * scale;
        let first = (centre - support + 0.5).max(0.0) as usize;
        let end = ((centre + support + 0.5) as usize).min(from as usize);
        let at = |k: usize| lanczos((k as f64 - centre + 0.5) * (1.0 / filter_scale));
        let values: Vec<f64> = (first..end).map(at).collect();
        let sum: f64 = values.iter().sum();
        let fixed = |value: f64| {
            let value =
                if sum == 0.0 { value } else { value / sum } * f64::from(1 << FRACTION_BITS);
            (value + if value < 0.0 { -0.5 } else { 0.5 }) as i32
        };
        Weights { first, weights: values.into_iter().map(fixed).collect() }
    };
    (0..to).map(of).collect()
}

fn lanczos(x: f64) -> f64 {
    if (-SUPPORT..SUPPORT).contains(&x) { sinc(x) * sinc(x / SUPPORT) } else { 0.0 }
}

fn sinc(x: f64) -> f64 {
    if x == 0.0 { 1.0 } else { libm::sin(x * PI) / (x * PI) }
}

/// Rounds a weighted sum, half up, and clamps it to a code.
fn code(sum: i32) -> u8 {
    ((sum + (1 << (FRACTION_BITS - 1))) >> FRACTION_BITS).clamp(0, 255) as u8
}

fn resize_rows(picture: &RgbImage, width: u32) -> RgbImage {
    let mut resized = RgbImage::new(width, picture.height());
    let weights = weights(picture.width(), width);
    let rows = picture.as_raw().chunks_exact(3 * picture.width() as usize);
    for (row, made) in rows.zip(resized.chunks_exact_mut(3 * width as usize)) {
        for (pixel, of) in made.chunks_exact_mut(3).zip(&weights) {
            let mut sums = [0i32; 3];
            for (weight, pixel) in of.weights.iter().zip(row[3 * of.first..].chunks_exact(3)) {
                for (sum, code) in sums.iter_mut().zip(pixel) {
                    *sum += weight * i32::from(*code);
                }
            }
            pixel.copy_from_slice(&sums.map(code));
        }
    }
    resized
}

fn resize_columns(picture: &RgbImage, height: u32) -> RgbImage {
    let mut resized = RgbImage::new(picture.width(), height);
    let length = 3 * picture.width() as usize;
    let mut sums = vec![0i32; length];
    for (made, of) in resized.chunks_exact_mut(length).zip(&weights(picture.height(), height)) {
        sums.fill(0);
        let rows = picture.as_raw()[length * of.first..].chunks_exact(length);
        for (weight, row) in of.weights.iter().zip(rows) {
            for (sum, code) in sums.iter_mut().zip(row) {
                *sum += weight * i32::from(*code);
            }
        }
        for (made, sum) in made.iter_mut().zip(&sums) {
            *made = code(*sum);
        }
    }
    resized
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgb;

    /// Makes a picture with fine texture and saturated edges, as `tests/train/lanczos.py`.
    fn picture(width: u32, height: u32) -> RgbImage {
        RgbImage::from_fn(width, height, |x, y| {
            Rgb([0, 1, 2].map(|c: u32| {
                let texture = (x * x * 7 + y * y * 3 + x * y * (c + 2) + c * 85) % 256;
                if (x / 9 + y / 5) % 3 == c { 255 * (texture / 128) } else { texture }
                    .try_into()
                    .unwrap()
            }))
        })
    }

    /// Computes FNV-1a of the codes, 64 bits.
    fn digest(picture: &RgbImage) -> u64 {
        let step = |hash: u64, &code: &u8| (hash ^ u64::from(code)).wrapping_mul(0x0100_0000_01b3);
        picture.as_raw().iter().fold(0xcbf2_9ce4_8422_2325, step)
    }

    #[test]
    fn pillow_agrees() {
        // `tests/train/lanczos.py` makes the digests.
        for (from, to, expected) in DIGESTS {
            let made = resize(picture(from[0], from[1]), to);
            assert_eq!(
                (made.dimensions().into(), digest(&made)),
                (to, expected),
                "{from:?} {to:?}"
            );
        }
    }

    #[test]
    fn sizes_are_rounded_half_to_even() {
        // Python: round(3 * (5 / 10)) is 2, round(5 * (5 / 10)) is 2, and round(7 * (5 / 10)) is 4.
        for (height, expected) in [(3, 2), (5, 2), (7, 4), (1, 1), (10, 5)] {
            assert_eq!(shrunk_size_px([10, height], 5), [5, expected]);
        }
        assert_eq!(shrunk_size_px([1124, 739], 640), [640, 421]);
        assert_eq!(shrunk_size_px([500, 640], 640), [500, 640]);
        assert_eq!(shrunk_size_px([4000, 1], 640), [640, 1]);
        let small = picture(12, 9);
        assert_eq!(shrink_to(small.clone(), 12), small);
        assert_eq!(shrink_to(small, 6).dimensions(), (6, 4));
    }

    /// Sizes before and after, and the digest.
    const DIGESTS: [([u32; 2], [u32; 2], u64); 8] = [
        ([101, 67], [50, 33], 0x245f_dce9_68c6_daf6),
        ([101, 67], [64, 42], 0xea1c_009f_5cb0_dce4),
        ([97, 131], [96, 130], 0xe2c8_dae0_a53d_9bcb),
        ([64, 48], [64, 17], 0x1801_0ba0_cba9_8a14),
        ([64, 48], [9, 48], 0x26a4_c7af_a64f_ad63),
        ([300, 5], [7, 1], 0x1cba_919f_7d9f_4153),
        ([41, 29], [83, 60], 0x53b7_5ad5_2c0c_4895),
        ([1, 1], [5, 4], 0xf93d_a0fe_0e93_e869),
    ];
}
