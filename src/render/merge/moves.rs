//! Changes of each pixel at the last two doublings of its samples, from which the stated error is computed.

use super::noise::CELL_PX;
use crate::trace::square_error;

/// Tail of smooth areas that converge as samples^-1.4 (see [`square_error`]).
pub(super) const SMOOTH: f64 = 1.0 / 6.0;
/// Tail of smooth areas that converge as samples^-1, for layers seen through the lens in adaptive scenes: cells stop
/// when their moves are small, and few samples cannot distinguish smooth areas from edges that no sample has hit yet.
pub(super) const SMOOTH_OF_STOPPED: f64 = 1.0 / 3.0;

/// Squared moves of each pixel, summed over its colours, row by row.
pub(super) struct Moves {
    /// Squares of (first half - all).
    last: Vec<f64>,
    /// Squares of (first quarter - first half).
    before: Vec<f64>,
}

impl Moves {
    pub(super) fn new(pixels: usize) -> Self {
        Self { last: vec![0.0; pixels], before: vec![0.0; pixels] }
    }

    /// Adds the moves of one colour of one pixel.
    pub(super) fn add(&mut self, pixel: usize, last: f64, before: f64) {
        self.last[pixel] += last * last;
        self.before[pixel] += before * before;
    }

    /// Estimates the RMS error over the film and its colours; `tail` is [`SMOOTH`] or [`SMOOTH_OF_STOPPED`].
    pub(super) fn rms_error(&self, tail: f64) -> f64 {
        let mean = |squares: &[f64]| squares.iter().sum::<f64>() / (3 * squares.len()) as f64;
        square_error(mean(&self.last), mean(&self.before), tail).sqrt()
    }

    /// Computes the RMS of the last moves over the pixels and colours of each cell, row by row, for a film `width` px
    /// wide. Scales the map so that the RMS over all pixels is `rms`, unless no pixel moves.
    pub(super) fn map(&self, width: usize, rms: f64) -> Vec<f32> {
        const CELL: usize = CELL_PX as usize;
        let mean = self.last.iter().sum::<f64>() / self.last.len() as f64;
        let factor = if mean > 0.0 { rms / mean.sqrt() } else { 0.0 };
        let cells = width.div_ceil(CELL);
        let mut map = Vec::with_capacity(self.last.len().div_ceil(width).div_ceil(CELL) * cells);
        for rows in self.last.chunks(width * CELL) {
            let rows: Vec<&[f64]> = rows.chunks(width).collect();
            for start in (0..width).step_by(CELL) {
                let end = (start + CELL).min(width);
                let sums = rows.iter().map(|row| row[start..end].iter().sum::<f64>());
                let count = (rows.len() * (end - start)) as f64;
                map.push(((sums.sum::<f64>() / count).sqrt() * factor) as f32);
            }
        }
        map
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rms_of_a_map_is_the_stated_error() {
        // A film of 3 x 3 px has cells of 4, 2, 2 and 1 px.
        let mut moves = Moves::new(9);
        for (pixel, last) in [(0, 0.5), (0, -0.25), (4, 0.125), (5, 0.5), (8, 0.25)] {
            moves.add(pixel, last, 2.0 * last);
        }
        let stated = moves.rms_error(SMOOTH);
        let map = moves.map(3, stated);
        let squares = map.iter().zip([4.0, 2.0, 2.0, 1.0]);
        let sum: f64 = squares.map(|(v, count)| f64::from(v * v) * count).sum();
        assert!(((sum / 9.0).sqrt() - stated).abs() < 1e-7);
        assert!(map[1] > map[0] && map[0] > map[3] && map[2] == 0.0, "{map:?}");
        assert_eq!(Moves::new(2).map(1, 0.0), [0.0]);
    }
}
