//! How far each pixel of a layer moved at the last two doublings of its samples: what the stated error is made of.

use crate::trace::{CELL_PX, rms_error};

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

    /// Estimated RMS error over the film and its colours, all pixels having as many samples.
    pub(super) fn rms_error(&self) -> f64 {
        let mean = |squares: &[f64]| squares.iter().sum::<f64>() / (3 * squares.len()) as f64;
        rms_error(mean(&self.last), mean(&self.before))
    }

    /// The same where each cell of [`CELL_PX`] has its own number. A cell stops when its own estimate is small, which
    /// it is now and then by chance: so of each cell the larger of its two moves counts, as it did for the decision.
    pub(super) fn rms_error_of_cells(&self, width: usize) -> f64 {
        let cell = CELL_PX as usize;
        let across = width.div_ceil(cell);
        let height = self.last.len() / width;
        let mut cells = vec![[0.0; 2]; across * height.div_ceil(cell)];
        for (q, (last, before)) in self.last.iter().zip(&self.before).enumerate() {
            let sums = &mut cells[q / width / cell * across + q % width / cell];
            sums[0] += last;
            sums[1] += before;
        }
        let total: f64 = cells.iter().map(|[a, b]| f64::max(*a, 0.5 * b)).sum();
        (total / (3 * self.last.len()) as f64).sqrt()
    }
}
