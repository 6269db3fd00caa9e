//! Relative depth, which networks estimate from one photograph up to scale and shift. The depth range of the line gives
//! metres.
//!
//! Two percentiles of the valid values become the ends of the range; values beyond them are clamped. In between,
//! 1/z is linear in a relative *inverse* depth (MiDaS, Ranftl et al., TPAMI 2022; Depth Anything), and z in a relative
//! depth (Marigold). If only a mean is given, the ends are scaled to match it.

use super::depth::Depth;
use crate::formats::error::SceneError;
use glasshouse_line::{DepthKind, DepthRange};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The ends of a relative depth image, and the share of clamped pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RelativeEnds {
    pub near_m: f64,
    pub far_m: f64,
    /// Share of the valid pixels that were beyond the ends and are clamped.
    pub clamped_share: f64,
}

/// Converts relative values to metres. Values may be negative or zero; pixels with values that are not finite become
/// invalid. A flat image gets a single distance: the mean, or the middle of the ends (in 1/z for an inverse depth).
pub(super) fn scale(
    depth: &mut Depth,
    valid: &mut [bool],
    kind: DepthKind,
    range: &DepthRange,
    path: &Path,
) -> Result<RelativeEnds, SceneError> {
    for (value, valid) in depth.z_m.iter().zip(valid.iter_mut()) {
        *valid &= value.is_finite();
    }
    let pixels = || depth.z_m.iter().zip(valid.iter()).filter(|(_, v)| **v);
    let mut values: Vec<f64> = pixels().map(|(value, _)| *value).collect();
    if values.is_empty() {
        return Err(SceneError::NoDepth { path: path.to_owned() });
    }
    let [low, high] = range.percentiles().map(|percent| percentile(&mut values, percent));
    let is_beyond = |value: f64| value < low || value > high;
    let beyond = values.iter().filter(|&&value| is_beyond(value)).count();
    let clamped_share = beyond as f64 / values.len() as f64;
    drop(values);
    // Position between the ends: 0 for `low`, 1 for `high`.
    let place = |value: f64| {
        if high > low { ((value - low) / (high - low)).clamp(0.0, 1.0) } else { 0.5 }
    };
    // z at a position, for a near end of 1.
    let shape = |place: f64, ratio: f64| match kind {
        DepthKind::RelativeInverse => 1.0 / (1.0 / ratio + place * (1.0 - 1.0 / ratio)),
        _ => 1.0 + place * (ratio - 1.0),
    };
    let (near_m, ratio) = match *range {
        DepthRange::Ends { near_m, far_m, .. } => (near_m, far_m / near_m),
        DepthRange::Mean { mean_m, far_over_near, .. } => {
            let (mut sum, mut count) = (0.0, 0u64);
            for (value, _) in pixels() {
                sum += shape(place(*value), far_over_near);
                count += 1;
            }
            (mean_m * count as f64 / sum, far_over_near)
        }
    };
    for (value, valid) in depth.z_m.iter_mut().zip(valid.iter()) {
        *value = if *valid { near_m * shape(place(*value), ratio) } else { f64::NAN };
    }
    Ok(RelativeEnds { near_m, far_m: near_m * ratio, clamped_share })
}

/// Returns a percentile by nearest rank. Reorders the values.
fn percentile(values: &mut [f64], percent: f64) -> f64 {
    let last = values.len() - 1;
    let rank = (percent / 100.0 * last as f64).round() as usize;
    let (_, value, _) = values.select_nth_unstable_by(rank.min(last), f64::total_cmp);
    *value
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::PictureSize;
    use proptest::prelude::*;

    fn image(values: &[f64]) -> (Depth, Vec<bool>) {
        let (width, height) = (values.len(), 1);
        let size = PictureSize::plain([width, height]);
        let depth = Depth { width, height, size, z_m: values.to_vec() };
        (depth, vec![true; values.len()])
    }

    fn scaled(values: &[f64], kind: DepthKind, range: &DepthRange) -> (Vec<f64>, RelativeEnds) {
        let (mut depth, mut valid) = image(values);
        let ends = scale(&mut depth, &mut valid, kind, range, Path::new("d")).unwrap();
        (depth.z_m, ends)
    }

    const ALL: [f64; 2] = [0.0, 100.0];

    fn ends(near_m: f64, far_m: f64) -> DepthRange {
        DepthRange::Ends { near_m, far_m, percentiles: ALL }
    }

    fn mean(mean_m: f64, far_over_near: f64) -> DepthRange {
        DepthRange::Mean { mean_m, far_over_near, percentiles: ALL }
    }

    /// Relative values; networks also write negative values.
    const VALUES: [f64; 5] = [-0.5, 0.0, 0.25, 0.5, 1.5];

    #[test]
    fn larger_is_nearer_in_inverse_depth_and_farther_in_depth() {
        let (z, found) = scaled(&VALUES, DepthKind::RelativeInverse, &ends(2.0, 8.0));
        assert_eq!((z[0], z[4]), (8.0, 2.0));
        // A quarter of the way: 1/z = 1/8 + (1/2 - 1/8) / 4.
        assert!((1.0 / z[1] - 0.21875).abs() < 1e-15, "{z:?}");
        assert_eq!((found.near_m, found.far_m, found.clamped_share), (2.0, 8.0, 0.0));
        let (z, _) = scaled(&VALUES, DepthKind::Relative, &ends(2.0, 8.0));
        assert_eq!(z, [2.0, 3.5, 4.25, 5.0, 8.0]);
    }

    #[test]
    fn outliers_are_clamped_to_the_ends_and_counted() {
        let mut values: Vec<f64> = (0..=100).map(f64::from).collect();
        (values[0], values[100]) = (-1e9, 1e9);
        let range = DepthRange::Ends { near_m: 1.0, far_m: 99.0, percentiles: [2.0, 98.0] };
        let (z, found) = scaled(&values, DepthKind::Relative, &range);
        assert_eq!((z[0], z[2], z[98], z[100]), (1.0, 1.0, 99.0, 99.0));
        assert!((found.clamped_share - 4.0 / 101.0).abs() < 1e-15);
    }

    #[test]
    fn a_flat_image_is_at_its_mean_and_holes_stay_holes() {
        let (z, _) = scaled(&[3.0; 4], DepthKind::RelativeInverse, &mean(4.0, 10.0));
        assert!(z.iter().all(|z| (z - 4.0).abs() < 1e-12), "{z:?}");
        let (mut depth, mut valid) = image(&[f64::NAN, 1.0, f64::INFINITY, 2.0]);
        valid[3] = false;
        let range = mean(4.0, 10.0);
        let path = Path::new("d");
        scale(&mut depth, &mut valid, DepthKind::Relative, &range, path).unwrap();
        assert_eq!(valid, [false, true, false, false]);
        let (mut depth, mut valid) = image(&[f64::NAN]);
        let none = scale(&mut depth, &mut valid, DepthKind::Relative, &range, path);
        assert!(matches!(none, Err(SceneError::NoDepth { .. })));
    }

    proptest! {
        #[test]
        fn the_mean_is_met_and_scale_and_shift_do_not_matter(
            values in prop::collection::vec(-5.0f64..5.0, 3..60),
            gain in 0.1f64..50.0, shift in -20.0f64..20.0,
            mean_m in 0.5f64..50.0, ratio in 1.1f64..100.0,
            inverse: bool,
        ) {
            let kind = if inverse { DepthKind::RelativeInverse } else { DepthKind::Relative };
            let (z, ends) = scaled(&values, kind, &mean(mean_m, ratio));
            let found = z.iter().sum::<f64>() / z.len() as f64;
            prop_assert!((found / mean_m - 1.0).abs() < 1e-12);
            prop_assert!((ends.far_m / ends.near_m / ratio - 1.0).abs() < 1e-12);
            let others: Vec<f64> = values.iter().map(|v| v * gain + shift).collect();
            let (again, _) = scaled(&others, kind, &mean(mean_m, ratio));
            for (a, b) in z.iter().zip(&again) {
                prop_assert!((a / b - 1.0).abs() < 1e-9, "{a} {b}");
            }
        }
    }
}
