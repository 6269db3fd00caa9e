//! Mixtures of Zhang, Ng and Chen, "Single Image Reflection Separation with Perceptual Losses", CVPR 2018.
//!
//! Follows `syn_data` and the training loop in `main.py` of ceciliavision/perceptual-reflection-removal: the reflection
//! is blurred and darkened in linear light (a gamma of 2.2), and a vignette fades it out away from a random point.

use super::blur::{Border, blur, gaussian};
use super::{Mixture, MixtureError, Picture, check, doubles, planes};
use compose::Stream;

const GAMMA: f64 = 2.2;

/// Side of the vignette that masks are cropped from, px, and its unused margin.
const VIGNETTE_PX: usize = 560;
const VIGNETTE_SPARE_PX: usize = 10;

/// Half the vignette's side in standard deviations of a Gaussian; the vignette is the root of this Gaussian.
const VIGNETTE_SIGMAS: f64 = 3.0;

/// Number of possible standard deviations of the blur, evenly spaced from 1 to 5 px.
const SIGMA_COUNT: usize = 80;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ZhangDraw {
    /// Standard deviation of the blur, px: one of 80 values from 1 to 5.
    pub sigma_px: f64,
    /// Factor, 1.08 to 1.18, of the sums' mean excess over 1; the product is subtracted from the reflection.
    pub attenuation: f64,
    /// The vignette's column at the picture's left border.
    pub mask_column: usize,
    /// The vignette's row at the picture's upper border.
    pub mask_row: usize,
    /// Share of the front picture's light in the input: 0.8 to 1.
    pub transmitted: f64,
}

impl ZhangDraw {
    /// Draws the parameters for pictures of less than 550 px a side; takes five numbers from the stream.
    pub fn draw(rows: usize, columns: usize, stream: &mut Stream) -> Result<Self, MixtureError> {
        let side = VIGNETTE_PX - VIGNETTE_SPARE_PX;
        if rows >= side || columns >= side {
            return Err(MixtureError::TooLarge { columns, rows });
        }
        Ok(Self {
            sigma_px: 1.0 + 4.0 * stream.below(SIGMA_COUNT) as f64 / (SIGMA_COUNT - 1) as f64,
            attenuation: 1.08 + stream.unit() / 10.0,
            mask_column: stream.below(side - columns),
            mask_row: stream.below(side - rows),
            transmitted: 1.0 - stream.unit() / 5.0,
        })
    }
}

/// Mixes two pictures. As in the original, returns `None` if the mean code of the back picture is less than half that
/// of the front picture, or if a picture of the mixture is too dark.
pub fn zhang(
    front: &Picture,
    back: &Picture,
    draw: &ZhangDraw,
) -> Result<Option<Mixture>, MixtureError> {
    check(front, back)?;
    let (rows, columns) = (front.rows, front.columns);
    let fits = |start: usize, count: usize| start + count <= VIGNETTE_PX;
    if !fits(draw.mask_row, rows) || !fits(draw.mask_column, columns) {
        return Err(MixtureError::TooLarge { columns, rows });
    }
    let sum = |picture: &Picture| doubles(picture).sum::<f64>();
    if 0.5 * sum(front) > sum(back) {
        return Ok(None);
    }

    let decoded = |picture: &Picture| -> Vec<f64> {
        doubles(picture).map(|v| libm::pow(v.max(0.0), GAMMA)).collect()
    };
    let transmitted = decoded(front);
    let radius = (2.0 * draw.sigma_px).ceil() as usize;
    let kernel = gaussian(2 * radius + 1, draw.sigma_px);
    let mut reflected = blur(&decoded(back), rows, columns, &kernel, Border::Mirrored);
    let size = rows * columns;
    for (r, t) in reflected.chunks_mut(size).zip(transmitted.chunks(size)) {
        darken(r, t, draw.attenuation);
    }
    let (down, across) = (vignette(draw.mask_row, rows), vignette(draw.mask_column, columns));
    for (k, r) in reflected.iter_mut().enumerate() {
        *r *= down[k % size / columns] * across[k % columns];
    }

    let coded = |v: f64| libm::pow(v, 1.0 / GAMMA);
    let input = reflected.iter().zip(&transmitted).map(|(r, t)| coded(r + t * draw.transmitted));
    let mixture = Mixture {
        input: planes(front, input),
        transmission: planes(front, doubles(front)),
        reflection: planes(front, reflected.iter().map(|r| coded(*r))),
        clean_reflection: planes(front, doubles(back)),
    };
    let brightest = |picture: &Picture| picture.planes.iter().copied().fold(0.0, f32::max);
    let is_dark = brightest(&mixture.reflection) < 0.15
        || brightest(&mixture.transmission) < 0.15
        || brightest(&mixture.input) < 0.1;
    Ok((!is_dark).then_some(mixture))
}

/// Subtracts `attenuation` times the mean excess of the sums above 1 from a channel of the reflection, and clamps the
/// channel to [0, 1].
fn darken(reflected: &mut [f64], transmitted: &[f64], attenuation: f64) {
    let sums = reflected.iter().zip(transmitted).map(|(r, t)| r + t);
    let (mut total, mut count) = (0.0, 0u64);
    for sum in sums.filter(|sum| *sum > 1.0) {
        total += sum;
        count += 1;
    }
    // The original adds 1e-6 to avoid a division by 0.
    let mean = (total / (count as f64 + 1e-6)).max(1.0);
    for r in reflected {
        *r = (*r - (mean - 1.0) * attenuation).clamp(0.0, 1.0);
    }
}

/// Returns `count` values, from index `start`, of the vignette along one axis; the vignette is the product over both
/// axes. Values are square roots of a Gaussian's shares in equal cells, with a maximum of 1.
fn vignette(start: usize, count: usize) -> Vec<f64> {
    let width = (2.0 * VIGNETTE_SIGMAS + 1.0) / VIGNETTE_PX as f64;
    let (first, last) = (-VIGNETTE_SIGMAS - width / 2.0, VIGNETTE_SIGMAS + width / 2.0);
    let edge = |k: usize| first + (last - first) * k as f64 / VIGNETTE_PX as f64;
    let below = |k: usize| 0.5 * (1.0 + libm::erf(edge(k) / std::f64::consts::SQRT_2));
    let share = |k: usize| below(k + 1) - below(k);
    let largest = share(VIGNETTE_PX / 2);
    (start..start + count).map(|k| (share(k) / largest).sqrt()).collect()
}
