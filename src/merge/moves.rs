//! How far each pixel of a layer moved at the last two doublings of its samples: what the stated error is made of.

use crate::trace::square_error;

/// Tail of a smooth part that converges as samples^-1.4, in mean squares of its last move.
pub(super) const SMOOTH: f64 = 1.0 / 6.0;
/// As samples^-1. For what is seen through the lens by cells that stopped by themselves: they stop when their moves look
/// small, and of so few samples a smooth part is not told well from edges that were not met yet.
pub(super) const SMOOTH_OF_STOPPED: f64 = 1.0 / 3.0;

/// Squares for each pixel, summed over its colours, row by row.
pub(super) struct Moves {
    /// Of (first half - all).
    last: Vec<f64>,
    /// Of (first quarter - first half).
    before: Vec<f64>,
}

impl Moves {
    pub(super) fn new(pixels: usize) -> Self {
        Self {
            last: vec![0.0; pixels],
            before: vec![0.0; pixels],
        }
    }

    /// One colour of one pixel.
    pub(super) fn add(&mut self, pixel: usize, last: f64, before: f64) {
        self.last[pixel] += last * last;
        self.before[pixel] += before * before;
    }

    /// Estimated RMS error over the film and its colours; `tail` of its smooth part.
    pub(super) fn rms_error(&self, tail: f64) -> f64 {
        let mean = |squares: &[f64]| squares.iter().sum::<f64>() / (3 * squares.len()) as f64;
        square_error(mean(&self.last), mean(&self.before), tail).sqrt()
    }

    /// How far each pixel moved at the last doubling (RMS over its colours), times the factor that makes the RMS of all
    /// `rms`.
    pub(super) fn map(&self, rms: f64) -> Vec<f32> {
        let mean = self.last.iter().sum::<f64>() / self.last.len() as f64;
        let factor = if mean > 0.0 { rms / mean.sqrt() } else { 0.0 };
        let values = self.last.iter();
        values.map(|last| (last.sqrt() * factor) as f32).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_map_adds_up_to_the_stated_error() {
        let mut moves = Moves::new(3);
        for (pixel, last) in [(0, 0.5), (0, -0.25), (1, 0.125), (2, 0.0)] {
            moves.add(pixel, last, 2.0 * last);
        }
        let map = moves.map(moves.rms_error(SMOOTH));
        let mean = map.iter().map(|v| f64::from(v * v)).sum::<f64>() / 3.0;
        assert!((mean.sqrt() - moves.rms_error(SMOOTH)).abs() < 1e-7);
        assert!(map[0] > map[1] && map[1] > map[2] && map[2] == 0.0);
        assert_eq!(Moves::new(2).map(0.0), [0.0; 2]);
    }
}
