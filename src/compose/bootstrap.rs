//! Intervals of paired differences, by resampling pictures with replacement (Efron, Annals of Statistics 7, 1979).

use super::score::number;
use glasshouse_line::hash::{mix64, splitmix64};
use serde::Serialize;

/// Number of resamples.
const RESAMPLES: u64 = 4000;

/// Seed of the drawn pictures: equal numbers of pictures are drawn alike, in all rows and on all machines.
const SEED: u64 = 0x7061_6972_6564;

/// Percentiles of the resampled means.
const LOW: f64 = 0.025;
const HIGH: f64 = 0.975;

/// Mean of paired differences, and the interval that contains 95 % of its resampled values. The interval describes the
/// choice of pictures alone, not of training seeds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Interval {
    #[serde(serialize_with = "number")]
    pub mean: f64,
    #[serde(serialize_with = "number")]
    pub low: f64,
    #[serde(serialize_with = "number")]
    pub high: f64,
}

impl Interval {
    /// Computes the mean of the differences, one per picture, and its percentile interval. `None` without differences.
    pub fn of(differences: &[f64]) -> Option<Self> {
        let count = differences.len() as u64;
        if count == 0 {
            return None;
        }
        let mean = |sum: f64| sum / count as f64;
        let resampled = |resample: u64| {
            let of_resample = mix64(SEED.wrapping_add(resample));
            let draw = |k: u64| {
                // The upper 32 bits choose a picture; the share that they favour is below 2^-32.
                let bits = splitmix64(of_resample.wrapping_add(k)) >> 32;
                differences[((bits * count) >> 32) as usize]
            };
            mean((0..count).map(draw).sum())
        };
        let mut means: Vec<f64> = (0..RESAMPLES).map(resampled).collect();
        means.sort_by(f64::total_cmp);
        Some(Self {
            mean: mean(differences.iter().sum()),
            low: percentile(&means, LOW),
            high: percentile(&means, HIGH),
        })
    }
}

/// Interpolates linearly between sorted values.
fn percentile(sorted: &[f64], share: f64) -> f64 {
    let place = share * (sorted.len() - 1) as f64;
    let (below, above) = (sorted[place.floor() as usize], sorted[place.ceil() as usize]);
    // Equal values may be infinite.
    if below == above { below } else { below + (above - below) * (place - place.floor()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_interval_is_that_of_the_mean() {
        // Differences with mean 0.3 and standard deviation 0.5: the mean of 400 has a standard error of 0.025.
        let differences: Vec<f64> =
            (0..400).map(|k| 0.3 + if k % 2 == 0 { 0.5 } else { -0.5 }).collect();
        let found = Interval::of(&differences).unwrap();
        assert!((found.mean - 0.3).abs() < 1e-12, "{found:?}");
        for (end, expected) in [(found.low, 0.3 - 1.96 * 0.025), (found.high, 0.3 + 1.96 * 0.025)] {
            assert!((end - expected).abs() < 0.004, "{found:?}");
        }
        assert_eq!(Interval::of(&differences), Some(found));
    }

    #[test]
    fn few_pictures_draw_each_other() {
        assert_eq!(Interval::of(&[]), None);
        assert_eq!(Interval::of(&[0.25]), Some(Interval { mean: 0.25, low: 0.25, high: 0.25 }));
        // Both draws of a resample choose the same one of two pictures in half of the cases.
        assert_eq!(Interval::of(&[0.0, 1.0]), Some(Interval { mean: 0.5, low: 0.0, high: 1.0 }));
        let infinite = Interval::of(&[f64::INFINITY, 1.0]).unwrap();
        assert_eq!((infinite.mean, infinite.low), (f64::INFINITY, 1.0));
        let json = serde_json::to_string(&infinite).unwrap();
        assert_eq!(json, r#"{"mean":"inf","low":1.0,"high":"inf"}"#);
    }

    #[test]
    fn percentiles_are_interpolated() {
        assert_eq!(percentile(&[0.0, 1.0, 2.0, 3.0], 0.5), 1.5);
        assert_eq!(percentile(&[0.0, 10.0], 0.975), 9.75);
        assert_eq!(percentile(&[4.0], 0.025), 4.0);
    }
}
