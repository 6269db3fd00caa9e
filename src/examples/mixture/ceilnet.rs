//! Mixtures of Fan, Yang, Hua, Chen and Wipf, "A Generic Deep Architecture for Single Image Reflection Removal and
//! Image Smoothing", ICCV 2017.
//!
//! Follows `generate_data_reflection.lua` of fqnchina/CEILNet, like ERRNet's `ReflectionSythesis_1`: adds the codes
//! without decoding, and subtracts one number from all channels of the reflection if the sum overflows.

use super::blur::{Border, blur, gaussian};
use super::{Mixture, MixtureError, Picture, check, doubles, planes};
use compose::Stream;

/// Width of the blur's window, px.
const WINDOW_PX: usize = 11;

/// Factor of the sums' mean excess over 1; the product is subtracted from the reflection.
const OVERFLOW_FACTOR: f64 = 1.3;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CeilnetDraw {
    /// Standard deviation of the blur, px: 2 to 5.
    pub sigma_px: f64,
}

impl CeilnetDraw {
    /// Draws the parameters; takes one number from the stream.
    pub fn draw(stream: &mut Stream) -> Self {
        Self { sigma_px: 2.0 + 3.0 * stream.unit() }
    }
}

/// Mixes two pictures; the back picture is black beyond its border. The reflection is the input minus the front
/// picture, as in CEILNet's files (`label2`); where the sum is clipped, the reflection is smaller than in ERRNet.
pub fn ceilnet(
    front: &Picture,
    back: &Picture,
    draw: &CeilnetDraw,
) -> Result<Mixture, MixtureError> {
    check(front, back)?;
    let sharp: Vec<f64> = doubles(back).collect();
    let kernel = gaussian(WINDOW_PX, draw.sigma_px);
    let blurred = blur(&sharp, front.rows, front.columns, &kernel, Border::Black);
    let (mut excess, mut count) = (0.0, 0u64);
    for (t, r) in doubles(front).zip(&blurred).filter(|(t, r)| t + *r > 1.0) {
        excess += t + r - 1.0;
        count += 1;
    }
    let taken = if count > 0 { excess / count as f64 * OVERFLOW_FACTOR } else { 0.0 };
    let input: Vec<f64> = doubles(front)
        .zip(&blurred)
        .map(|(t, r)| (t + (r - taken).clamp(0.0, 1.0)).min(1.0))
        .collect();
    let reflection = input.iter().zip(doubles(front)).map(|(i, t)| i - t);
    Ok(Mixture {
        reflection: planes(front, reflection),
        input: planes(front, input.iter().copied()),
        transmission: planes(front, doubles(front)),
        clean_reflection: planes(front, sharp),
    })
}
