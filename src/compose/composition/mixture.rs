//! The ways in which published recipes add a reflection to a photograph, for fronts and reflections of any brightness.
//!
//! The recipes know pictures from 0 to 1. Here, the white of a mixture stands for 1: the 97th percentile of the brightest
//! channels of the sum. What exceeds it is subtracted from the reflection, so a mixture does not depend on its exposure.
//! Both functions keep a black reflection black.

use super::exposure::percentile_of;
use super::power::{CODE, LIGHT};

const WHITE_PERCENTILE: f64 = 97.0;

/// CEILNet's factor of the mean excess.
const CEILNET_ATTENUATION: f32 = 1.3;

/// Side of Zhang's vignette over that of a picture, 560 / 256 px, the part of it in which pictures lie, and half of it
/// in standard deviations of the Gaussian whose root the vignette is.
const VIGNETTE_SIDES: f64 = 560.0 / 256.0;
const VIGNETTE_USED: f64 = 550.0 / 560.0;
const VIGNETTE_SIGMAS: f64 = 3.0;

/// The numbers of a mixture by Zhang, Ng and Chen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DrawnZhang {
    /// Factor, 1.08 to 1.18, of the sums' mean excess over white; the product is subtracted from the reflection.
    pub attenuation: f64,
    /// Row and column of the picture in the vignette; 0 and 1 are the ends of their range.
    pub vignette: [f64; 2],
}

impl DrawnZhang {
    /// Darkens a reflection, linear and with a side of `side_px`, as Zhang et al. (CVPR 2018) do: subtracts a number from
    /// each channel, and multiplies by a vignette.
    pub(super) fn darken(&self, ahead: &[f32], reflection: &mut [f32], side_px: usize) {
        let sums = sums(ahead, reflection);
        let white = percentile_of(&sums, WHITE_PERCENTILE);
        let plane = side_px * side_px;
        let [down, across] = self.vignette.map(|place| vignette(place, side_px));
        for (reflection, sums) in reflection.chunks_exact_mut(plane).zip(sums.chunks_exact(plane)) {
            let taken = mean_excess(sums, white) * self.attenuation as f32;
            for (row, down) in reflection.chunks_exact_mut(side_px).zip(&down) {
                for (value, across) in row.iter_mut().zip(&across) {
                    *value = (*value - taken).clamp(0.0, white) * down * across;
                }
            }
        }
    }
}

/// Adds codes as CEILNet (Fan et al., ICCV 2017) does, after the subtraction of a number from those of the reflection.
/// `reflection` becomes the difference of light between the sum and the front.
pub(super) fn add_codes(ahead: &[f32], reflection: &mut [f32]) {
    let [front, mut back] = [ahead, &*reflection].map(coded);
    let sums = sums(&front, &back);
    let white = percentile_of(&sums, WHITE_PERCENTILE);
    let taken = mean_excess(&sums, white) * CEILNET_ATTENUATION;
    for value in &mut back {
        *value = (*value - taken).clamp(0.0, white);
    }
    for (at, value) in reflection.iter_mut().enumerate() {
        let sum = if back[at] > 0.0 { LIGHT.of(front[at] + back[at]) } else { ahead[at] };
        *value = (sum - ahead[at]).max(0.0);
    }
}

/// Replaces linear light by codes, blurs these, and returns to linear light.
pub(super) fn blur_codes(planes: &mut Vec<f32>, blur: impl FnOnce(&mut [f32])) {
    *planes = coded(planes);
    blur(planes);
    for value in planes {
        *value = LIGHT.of(*value);
    }
}

fn coded(linear: &[f32]) -> Vec<f32> {
    linear.iter().map(|value| CODE.of(*value)).collect()
}

fn sums(a: &[f32], b: &[f32]) -> Vec<f32> {
    a.iter().zip(b).map(|(a, b)| a + b).collect()
}

/// Returns the mean excess of the values above white; 0 without any.
fn mean_excess(values: &[f32], white: f32) -> f32 {
    let (mut total, mut count) = (0.0, 0u32);
    for value in values.iter().filter(|value| **value > white) {
        total += f64::from(value - white);
        count += 1;
    }
    (total / f64::from(count.max(1))) as f32
}

/// Returns the factors of one side of a picture: the root of a Gaussian, with a maximum of 1.
fn vignette(place: f64, side_px: usize) -> Vec<f32> {
    let first = place * (VIGNETTE_SIDES * VIGNETTE_USED - 1.0);
    let factor = |k: usize| {
        let at = first + (k as f64 + 0.5) / side_px as f64;
        let sigmas = VIGNETTE_SIGMAS * (2.0 * at / VIGNETTE_SIDES - 1.0);
        libm::exp(-0.25 * sigmas * sigmas) as f32
    };
    (0..side_px).map(factor).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three planes of 10 x 10 px: one value, and another at two pixels.
    fn planes(value: f32, at_two: f32) -> Vec<f32> {
        let mut planes = vec![value; 300];
        for plane in planes.chunks_exact_mut(100) {
            plane[33..35].fill(at_two);
        }
        planes
    }

    fn near(found: f32, expected: f32) {
        assert!((found - expected).abs() < 2e-6, "{found} {expected}");
    }

    #[test]
    fn zhang_subtracts_the_excess_of_each_channel_and_fades() {
        let zhang = DrawnZhang { attenuation: 1.1, vignette: [0.5, 0.2] };
        // White is 1, and two sums are 1.5.
        let (ahead, mut reflection) = (planes(0.5, 0.5), planes(0.5, 1.0));
        reflection[200..].fill(0.5);
        zhang.darken(&ahead, &mut reflection, 10);
        let [down, across] = zhang.vignette.map(|place| vignette(place, 10));
        assert_eq!(reflection[0], 0.0);
        near(reflection[33], 0.45 * down[3] * across[3]);
        near(reflection[134], 0.45 * down[3] * across[4]);
        // No sum of blue exceeds white.
        near(reflection[200], 0.5 * down[0] * across[0]);
    }

    #[test]
    fn vignettes_are_those_of_the_published_recipe() {
        // The published vignette of 560 px is that of pictures of 256 px, which ends at 3 standard deviations and half a cell.
        let below = |x: f64| 0.5 * libm::erfc(-x * std::f64::consts::FRAC_1_SQRT_2);
        let share = |k: usize| {
            let edge = |k: usize| 3.00625 * (k as f64 / 280.0 - 1.0);
            below(edge(k + 1)) - below(edge(k))
        };
        for start in [0, 100, 294] {
            let factors = vignette(start as f64 / 294.0, 256);
            for k in [0, 20, 128, 255] {
                let expected = (share(start + k) / share(280)).sqrt() as f32;
                assert!(
                    (factors[k] - expected).abs() < 0.005,
                    "{start} {k}: {} {expected}",
                    factors[k]
                );
            }
        }
    }

    #[test]
    fn ceilnet_adds_codes_less_their_excess() {
        let light = |code: f64| libm::pow(code, 2.2) as f32;
        let ahead = planes(light(0.5), light(0.5));
        // White is 1, and two sums of codes are 1.4, so 1.3 * 0.4 is subtracted.
        let mut reflection = planes(light(0.5), light(0.9));
        add_codes(&ahead, &mut reflection);
        assert_eq!(reflection[0], 0.0);
        near(reflection[33], light(0.88) - light(0.5));
        // Nothing exceeds white, so codes add.
        let mut reflection = planes(light(0.3), light(0.3));
        add_codes(&ahead, &mut reflection);
        near(reflection[0], light(0.8) - light(0.5));
    }

    #[test]
    fn exposure_does_not_change_a_mixture() {
        let zhang = DrawnZhang { attenuation: 1.1, vignette: [0.1, 0.9] };
        let made = |exposure: f32| {
            let ahead = planes(0.3 * exposure, 0.5 * exposure);
            let mut both = [(); 2].map(|()| planes(0.2 * exposure, 0.6 * exposure));
            zhang.darken(&ahead, &mut both[0], 10);
            add_codes(&ahead, &mut both[1]);
            both
        };
        for (a, b) in made(1.0).iter().flatten().zip(made(7.0).iter().flatten()) {
            assert!((7.0 * a - b).abs() < 2e-5, "{a} {b}");
        }
    }
}
