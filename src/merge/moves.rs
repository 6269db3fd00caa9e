//! How far each pixel of a layer moved at the last two doublings of its samples: what the stated error is made of.

use crate::trace::square_error;

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

    /// Estimated RMS error over the film and its colours.
    pub(super) fn rms_error(&self) -> f64 {
        let mean = |squares: &[f64]| squares.iter().sum::<f64>() / (3 * squares.len()) as f64;
        square_error(mean(&self.last), mean(&self.before)).sqrt()
    }
}
