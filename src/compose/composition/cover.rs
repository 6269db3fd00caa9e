//! Soft-edged masks of the part of a picture that a reflection covers.

use crate::random::Stream;

/// Range of a mask's offset, where its unbounded values have a standard deviation of about 1.
const OFFSET: [f64; 2] = [-0.6, 0.6];
/// Range of the factor of these values before the logistic function; the larger, the harder the edges.
const SHARPNESS: [f64; 2] = [3.0, 60.0];
/// Range of the least share of the reflection that is left.
const FLOOR: [f64; 2] = [0.0, 0.3];
/// Largest number of nodes along a side of blobs; the least is 2.
const MOST_NODES: usize = 6;

/// Returns the factors of a picture, above 0 and up to 1: one side of a straight edge or, as often, smooth blobs.
pub(super) fn cover(seed: u64, side_px: usize) -> Vec<f32> {
    let mut stream = Stream::new(seed, "cover");
    let offset = stream.uniform(OFFSET);
    let sharpness = stream.log_uniform(SHARPNESS);
    let floor = stream.uniform(FLOOR);
    let unbounded: Box<dyn Fn(f64, f64) -> f64> = if stream.unit() < 0.5 {
        let angle = stream.uniform([0.0, std::f64::consts::TAU]);
        let (across, down) = (libm::cos(angle), libm::sin(angle));
        Box::new(move |y, x| across * (2.0 * x - 1.0) + down * (2.0 * y - 1.0))
    } else {
        let count = 2 + stream.below(MOST_NODES - 1);
        let nodes: Vec<f64> = (0..count * count).map(|_| stream.normal()).collect();
        Box::new(move |y, x| between(&nodes, count, y, x))
    };
    let place = |k: usize| (k as f64 + 0.5) / side_px as f64;
    let factor = |at: usize| {
        let value = unbounded(place(at / side_px), place(at % side_px)) + offset;
        (floor + (1.0 - floor) / (1.0 + libm::exp(-sharpness * value))) as f32
    };
    (0..side_px * side_px).map(factor).collect()
}

/// Interpolates `count` x `count` nodes at a place from 0 to 1, with a slope of 0 at the nodes.
fn between(nodes: &[f64], count: usize, y: f64, x: f64) -> f64 {
    let split = |place: f64| {
        let at = place * (count - 1) as f64;
        let first = (at as usize).min(count - 2);
        let t = at - first as f64;
        (first, t * t * (3.0 - 2.0 * t))
    };
    let ((row, down), (column, across)) = (split(y), split(x));
    let along = |row: usize| {
        let [left, right] = [0, 1].map(|k| nodes[row * count + column + k]);
        left + (right - left) * across
    };
    let (above, below) = (along(row), along(row + 1));
    above + (below - above) * down
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_cover_parts_with_soft_edges() {
        const SIDE: usize = 64;
        let (mut parts, mut soft, mut total) = (0, 0, 0.0);
        for seed in 0..400 {
            let mask = cover(seed, SIDE);
            assert_eq!(mask, cover(seed, SIDE));
            assert!(mask.iter().all(|v| *v > 0.0 && *v <= 1.0));
            let share =
                |is: fn(&f32) -> bool| mask.iter().filter(|v| is(v)).count() as f64 / 4096.0;
            parts += u32::from(share(|v| *v > 0.9) > 0.1 && share(|v| *v < 0.4) > 0.1);
            soft += u32::from(share(|v| (0.4..0.9).contains(v)) > 0.02);
            total += mask.iter().sum::<f32>() / 4096.0;
        }
        assert!(parts > 250 && soft > 250, "{parts} {soft}");
        // Masks are as often light as dark, and none is darker than its floor, 0.15 on average.
        assert!((total / 400.0 - 0.575).abs() < 0.05, "{}", total / 400.0);
    }

    #[test]
    fn blobs_pass_through_their_nodes() {
        let nodes = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0];
        assert_eq!(between(&nodes, 3, 0.5, 1.0), 6.0);
        assert_eq!(between(&nodes, 3, 1.0, 0.0), 7.0);
        assert_eq!(between(&nodes, 3, 0.25, 0.25), 3.0);
    }
}
