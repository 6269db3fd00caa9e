//! Facets as light sees them: Smith's shadowing of a Beckmann surface, and its distribution of visible normals.
//!
//! Seen along a direction at the angle theta from the normal of the face, with b = alpha tan(theta) and a = 1 / b, the facets hide
//! each other. The visible share is Smith's
//!
//! ```text
//! G1(b) = 1 / N(b)        N(b) = (1 + erf a) / 2 + b exp(-a^2) / (2 sqrt(pi))
//! ```
//!
//! and the slope x of a visible facet along the direction, in units of alpha and away from the light, has the density
//!
//! ```text
//! G1 (1 - b x) exp(-x^2) / sqrt(pi)        x < a
//! ```
//!
//! while the slope across is that of all facets (Heitz and d'Eon, "Importance Sampling Microfacet-Based BSDFs using the Distribution
//! of Visible Normals", EGSR 2014). A facet of all is made a visible one by a map of its slope x along the direction, x -> x + shift,
//! that keeps the order of slopes: both have the same quantile. The map is the identity for b = 0.

use super::super::lanes::{floor, max, min};
use std::sync::LazyLock;

/// Largest b at which the series replaces the table; its largest error there is 1e-6 for slopes up to 2, and 1e-5 for all.
const SERIES: f32 = 1.0 / 32.0;
/// b below which facets hide less than 2e-8 of each other.
const ALL_VISIBLE: f32 = 0.25;

/// Steps of the table of shifts by slope: 1/8 from -`MOST_SLOPE` on.
const SLOPES: usize = 72;
const STEPS_PER_SLOPE: f32 = 8.0;
/// Largest slope of a facet, in units of alpha: facets are drawn from squares of at most 1 - 2^-24 in the unit disc.
const MOST_SLOPE: f32 = 4.25;
/// Cells of the table of shifts by b / (1 + b).
const BENDS: usize = 64;
/// Cells of the table of G1 by b / (1 + b).
const SHARES: usize = 1024;

/// Tables over slope and b.
struct Tables {
    /// Values of -shift (1 + b) / b, for b / (1 + b) from -1 to `BENDS` + 1 cells: the ends are continued.
    shifts: Vec<[f32; SLOPES]>,
    shares: Vec<f32>,
}

static TABLES: LazyLock<Tables> = LazyLock::new(Tables::new);

/// Returns G1 at b = alpha tan(theta).
pub fn visible_share(b: f64) -> f64 {
    1.0 / visible_area(b)
}

/// Returns N(b), the area of the visible facets over that of the face, both seen along the direction.
fn visible_area(b: f64) -> f64 {
    // erfc(1 / b) is below the rounding of 1.
    if b < 0.16 {
        return 1.0;
    }
    let a = 1.0 / b;
    (1.0 - 0.5 * libm::erfc(a)) + 0.5 * b * libm::exp(-a * a) / std::f64::consts::PI.sqrt()
}

/// Returns the shift that makes a facet with the slope `x` of all a visible one, both in units of alpha, without a table.
pub fn visible_shift(x: f64, b: f64) -> f64 {
    let share_below = |x: f64| 0.5 * libm::erfc(-x);
    let scale = 0.5 * b / std::f64::consts::PI.sqrt();
    let target = share_below(x) * visible_area(b);
    // The visible share below a slope rises up to the slope 1 / b. Newton's steps that leave the interval become bisections.
    let (mut lo, mut hi) = (-8.0f64, (1.0 / b.max(1e-9)).min(8.0));
    let mut at = (x - 0.5 * b).clamp(lo, hi);
    for _ in 0..60 {
        let normal = libm::exp(-at * at);
        let off = share_below(at) + scale * normal - target;
        (lo, hi) = if off < 0.0 { (at, hi) } else { (lo, at) };
        let slope = (1.0 - b * at) * normal / std::f64::consts::PI.sqrt();
        let newton = at - off / slope;
        let next = if newton > lo && newton < hi { newton } else { 0.5 * (lo + hi) };
        if (next - at).abs() < 1e-13 {
            break;
        }
        at = next;
    }
    at - x
}

impl Tables {
    fn new() -> Self {
        let slope = |i: usize| f64::from(i as f32 / STEPS_PER_SLOPE - MOST_SLOPE) - 0.125;
        let row = |cell: usize| -> [f32; SLOPES] {
            // Near the ends, the value is that of the end: the limits of b to 0 and to infinity exist.
            let share = (cell as f64 / BENDS as f64).clamp(1e-4, 1.0 - 1e-4);
            let b = share / (1.0 - share);
            std::array::from_fn(|i| (-visible_shift(slope(i), b) / share) as f32)
        };
        let inner: Vec<_> = (0..=BENDS).map(row).collect();
        let beyond = |end: &[f32; SLOPES], next: &[f32; SLOPES]| -> [f32; SLOPES] {
            std::array::from_fn(|i| 2.0 * end[i] - next[i])
        };
        let mut shifts = vec![beyond(&inner[0], &inner[1])];
        shifts.extend_from_slice(&inner);
        shifts.push(beyond(&inner[BENDS], &inner[BENDS - 1]));
        let share = |cell: usize| {
            let s = cell as f64 / SHARES as f64;
            if cell == SHARES { 0.0 } else { visible_share(s / (1.0 - s)) as f32 }
        };
        Self { shifts, shares: (0..=SHARES).map(share).collect() }
    }
}

/// Returns -shift / b of a facet with the slope `x` (see [`visible_shift`]), where b^2 is `square`, and `product` is b x. It is
/// 1/2 + b x / 4 + b^2 (2 x^2 - 1) / 12 + ...
#[inline(always)]
pub(super) fn series(product: f32, square: f32) -> f32 {
    0.5 + product * (0.25 + product * (1.0 / 6.0)) - square * (1.0 / 12.0)
}

/// True if [`series`] holds for b with this square.
#[inline(always)]
pub(super) fn has_series(square: f32) -> bool {
    square <= SERIES * SERIES
}

/// Computes [`series`] where it holds, else [`exact`].
#[inline]
pub(super) fn shift_over_b(product: f32, square: f32) -> f32 {
    if has_series(square) { series(product, square) } else { exact(product, square) }
}

/// Computes [`series`] for every b above 0, from tables by cubic interpolation; the error of the shift is below 1e-4 for slopes
/// up to 3.
pub(super) fn exact(product: f32, square: f32) -> f32 {
    let b = square.sqrt();
    let (row, down) = floor(min(b / (1.0 + b), 1.0 - 1e-6) * BENDS as f32);
    let within_row = min(b / (1.0 + b), 1.0 - 1e-6) * BENDS as f32 - row;
    let at = (product / b + MOST_SLOPE + 0.125) * STEPS_PER_SLOPE;
    let at = min(max(at, 1.0), (SLOPES - 3) as f32);
    let (column, right) = floor(at);
    let across = weights(at - column);
    let tables = &*TABLES;
    let mut sum = 0.0;
    for (row, weight) in weights(within_row).into_iter().enumerate() {
        let of = &tables.shifts[down as usize + row][right as usize - 1..];
        let value = across[0] * of[0] + across[1] * of[1] + across[2] * of[2] + across[3] * of[3];
        sum += weight * value;
    }
    sum / (1.0 + b)
}

/// Returns the weights of the cubic through four equidistant points, between the middle ones.
#[inline(always)]
fn weights(t: f32) -> [f32; 4] {
    let (u, v) = (1.0 - t, t);
    let (before, behind) = (1.0 + t, 2.0 - t);
    [
        -u * v * behind * (1.0 / 6.0),
        before * u * behind * 0.5,
        before * v * behind * 0.5,
        -before * u * v * (1.0 / 6.0),
    ]
}

/// Returns G1 where b^2 is `square`, with an error below 1e-6.
#[inline(always)]
pub(super) fn share(square: f32) -> f32 {
    if square <= ALL_VISIBLE * ALL_VISIBLE { 1.0 } else { share_of_table(square) }
}

/// [`share`] by the table.
fn share_of_table(square: f32) -> f32 {
    let b = square.sqrt();
    let at = min(b / (1.0 + b), 1.0 - 1e-7) * SHARES as f32;
    let (whole, cell) = floor(at);
    let of = &TABLES.shares[cell as usize..];
    of[0] + (at - whole) * (of[1] - of[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The share of the facets below a slope is that of all facets below the slope before the map, over a fine integral.
    #[test]
    fn the_map_gives_the_visible_density() {
        for b in [0.01, 0.05, 0.07, 0.2, 0.7, 1.0, 3.0, 50.0] {
            let density =
                |x: f64| (1.0 - b * x).max(0.0) * (-x * x).exp() / std::f64::consts::PI.sqrt();
            let step = 1e-4;
            let (mut below, mut total) = (vec![], 0.0);
            for i in 0..120_000 {
                total += step * density(-6.0 + step * (f64::from(i) + 0.5));
                below.push(total);
            }
            assert!((total / visible_area(b) - 1.0).abs() < 1e-6, "{b}: {total}");
            for x in [-2.5, -1.0, 0.0, 0.4, 1.3, 2.2] {
                let to = x + visible_shift(x, b);
                let index = ((to + 6.0) / step) as usize;
                let expected = 0.5 * libm::erfc(-x);
                assert!((below[index] / total - expected).abs() < 2e-4, "{b} {x}");
            }
        }
    }

    #[test]
    fn series_and_table_are_the_map() {
        let mut worst = [0.0f64; 2];
        for i in 0..2000 {
            // b from 0.001 to 60. Beyond, the last cells of the table have up to twice the errors.
            let b = libm::exp(-6.9 + f64::from(i) * 5.5e-3) as f32;
            for j in 0..=66 {
                let x = (j - 33) as f32 * 0.0909;
                let (product, square) = (b * x, b * b);
                let found = -b * shift_over_b(product, square);
                let error = (f64::from(found) - visible_shift(f64::from(x), f64::from(b))).abs();
                let far = usize::from(x.abs() > 2.0);
                worst[far] = worst[far].max(error);
            }
            let error = f64::from(share(b * b)) - visible_share(f64::from(b));
            assert!(error.abs() < 1e-6 && share(b * b) <= 1.0, "{b}: {error:e}");
        }
        assert!(worst[0] < 4e-5 && worst[1] < 2e-4, "{worst:?}");
        assert_eq!((series(0.0, 0.0), share(0.0)), (0.5, 1.0));
    }
}
