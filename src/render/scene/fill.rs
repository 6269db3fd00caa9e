//! Fills holes in inverse depth. A hole is 0; every other value is above 0.
//!
//! Inverse depth is interpolated, because it is linear across the image of a plane. The bits are reproducible: one
//! thread, a fixed order, sums in `f64`.

/// Fills holes by pull-push interpolation (Gortler et al., "The Lumigraph", 1996).
///
/// Pull: a coarse pixel is the unweighted mean of the valid pixels among its 2x2 children; the top level is the first
/// without holes. Push: a hole takes 9/16 of its parent, 3/16 of each of the parent's two neighbours on the hole's
/// side, and 1/16 of the diagonal neighbour; indices are clamped. Valid pixels keep their bits. At least one pixel must
/// be valid.
pub(super) fn smooth(inverse_depth_per_m: &mut [f32], width: usize, height: usize) {
    debug_assert!(inverse_depth_per_m.iter().any(|&w| w > 0.0));
    if !inverse_depth_per_m.contains(&0.0) {
        return;
    }
    let mut coarse = Level::pull(inverse_depth_per_m, width, height);
    smooth(&mut coarse.w, coarse.width, coarse.height);
    coarse.push(inverse_depth_per_m, width);
}

/// Fills holes with the smallest valid value: the farthest depth.
pub(super) fn far(inverse_depth_per_m: &mut [f32]) {
    let farthest =
        inverse_depth_per_m.iter().copied().filter(|&w| w > 0.0).fold(f32::INFINITY, f32::min);
    for w in inverse_depth_per_m.iter_mut().filter(|w| **w == 0.0) {
        *w = farthest;
    }
}

/// A level of the pyramid, half the size of the level below, rounded up.
struct Level {
    width: usize,
    w: Vec<f32>,
    height: usize,
}

impl Level {
    /// Computes the level above `fine`.
    fn pull(fine: &[f32], fine_width: usize, fine_height: usize) -> Self {
        let (width, height) = (fine_width.div_ceil(2), fine_height.div_ceil(2));
        let mut w = Vec::with_capacity(width * height);
        for j in 0..height {
            let top = &fine[2 * j * fine_width..][..fine_width];
            // An odd last row or column has no partner; an empty row or a hole takes the partner's place.
            let bottom = if 2 * j + 1 < fine_height {
                &fine[(2 * j + 1) * fine_width..][..fine_width]
            } else {
                &[]
            };
            let (tops, last_top) = top.as_chunks::<2>();
            let (bottoms, last_bottom) = bottom.as_chunks::<2>();
            if bottoms.is_empty() {
                w.extend(tops.iter().map(|&[a, b]| mean_of_valid([a, b, 0.0, 0.0])));
            } else {
                w.extend(
                    tops.iter().zip(bottoms).map(|(&[a, b], &[c, d])| mean_of_valid([a, b, c, d])),
                );
            }
            if let [a] = *last_top {
                let c = last_bottom.first().copied().unwrap_or(0.0);
                w.push(mean_of_valid([a, 0.0, c, 0.0]));
            }
        }
        Self { width, w, height }
    }

    /// Fills the holes of `fine`, the level below. This level has no holes.
    fn push(&self, fine: &mut [f32], fine_width: usize) {
        for (y, row) in fine.chunks_exact_mut(fine_width).enumerate() {
            let near = &self.w[y / 2 * self.width..][..self.width];
            let beside = &self.w[toward(y, self.height) * self.width..][..self.width];
            for (x, w) in row.iter_mut().enumerate() {
                if *w == 0.0 {
                    let (a, b) = (x / 2, toward(x, self.width));
                    *w = (0.5625 * near[a] as f64
                        + 0.1875 * (near[b] as f64 + beside[a] as f64)
                        + 0.0625 * beside[b] as f64) as f32;
                }
            }
        }
    }
}

/// Returns the coarse neighbour on the side of fine pixel `i`, clamped to `0..count`.
fn toward(i: usize, count: usize) -> usize {
    if i % 2 == 1 { (i / 2 + 1).min(count - 1) } else { (i / 2).saturating_sub(1) }
}

/// Returns the mean of the valid values; a hole if all are holes.
fn mean_of_valid(children: [f32; 4]) -> f32 {
    let (mut sum, mut count) = (0.0, 0u32);
    for child in children {
        sum += child as f64;
        count += u32::from(child > 0.0);
    }
    if count == 0 { 0.0 } else { (sum / count as f64) as f32 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn holes_between_two_pixels_are_interpolated() {
        // Level 1 of [a, hole, hole, b] is [a, b]; each hole takes 3/4 of its parent and 1/4 of the other pixel.
        let mut w = [1.0, 0.0, 0.0, 2.0];
        smooth(&mut w, 4, 1);
        assert_eq!(w, [1.0, 1.25, 1.75, 2.0]);
        let mut w = [1.0, 0.0, 0.0, 2.0];
        smooth(&mut w, 1, 4);
        assert_eq!(w, [1.0, 1.25, 1.75, 2.0]);
    }

    #[test]
    fn one_valid_pixel_fills_all() {
        for (width, height) in [(1, 1), (1, 7), (7, 1), (5, 3), (33, 17)] {
            for at in 0..width * height {
                let mut w = vec![0.0; width * height];
                w[at] = 0.3;
                smooth(&mut w, width, height);
                assert!(w.iter().all(|&w| w == 0.3), "{width}x{height} at {at}");
            }
        }
    }

    #[test]
    fn far_takes_the_smallest_inverse_depth() {
        let mut w = [0.0, 2.0, 0.5, 0.0];
        far(&mut w);
        assert_eq!(w, [0.5, 2.0, 0.5, 0.5]);
    }

    #[test]
    fn extreme_values_do_not_overflow() {
        let mut w = [f32::MAX, f32::MAX, 0.0, f32::MAX, f32::MAX, 0.0];
        smooth(&mut w, 3, 2);
        assert_eq!(w, [f32::MAX; 6]);
        let mut w = [f32::MIN_POSITIVE, 0.0, 0.0, 0.0];
        smooth(&mut w, 2, 2);
        assert_eq!(w, [f32::MIN_POSITIVE; 4]);
    }

    proptest! {
        #[test]
        fn fills_everything_within_the_range_and_keeps_valid_bits(
            width in 1usize..40, height in 1usize..40, seed in any::<u64>(), keep in 1u64..100,
        ) {
            let mut state = seed | 1;
            let mut draw = || {
                state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                state >> 33
            };
            let mut holed: Vec<f32> = (0..width * height)
                .map(|_| if draw() % 100 < keep { 0.01 + draw() as f32 * 1e-9 } else { 0.0 })
                .collect();
            holed[0] = 1.0;
            let mut filled = holed.clone();
            smooth(&mut filled, width, height);
            let low = holed.iter().copied().filter(|&w| w > 0.0).fold(f32::INFINITY, f32::min);
            let high = holed.iter().copied().fold(0.0, f32::max);
            for (before, after) in holed.iter().zip(&filled) {
                if *before > 0.0 {
                    prop_assert_eq!(before.to_bits(), after.to_bits());
                }
                prop_assert!((low..=high).contains(after));
            }
        }
    }
}
