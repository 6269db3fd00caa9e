//! Measures of the difference between an image and its reference.

use glasshouse_line::color::linear_to_srgb;
use serde::Serialize;

/// Side of a cell, px. The measures of the worst regions are RMSE values of cells.
pub(super) const CELL_PX: usize = 8;

/// Constant added to the squared reference in the relative error; the unit is linear radiance squared.
const RELATIVE_FLOOR: f64 = 1e-2;

/// Differences of a layer from its reference over all pixels and colours, in linear light except for `srgb_steps`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Deviation {
    /// Root of the mean squared difference.
    pub rmse: f64,
    /// Mean of difference^2 / (reference^2 + 1e-2).
    pub relative_mse: f64,
    /// Mean of (image - reference).
    pub bias: f64,
    /// Mean of the absolute difference of the sRGB-coded values, clamped to [0, 1], not rounded, times 255.
    pub srgb_steps: f64,
    /// RMSE of the worst cell of 8 x 8 px.
    pub cell_rmse_worst: f64,
    /// 99th percentile of the cells' RMSE.
    pub cell_rmse_p99: f64,
}

impl Deviation {
    /// Compares two images with `width` px in a row. Panics if they differ in size, have incomplete rows, or are empty.
    pub fn between(image: &[[f32; 3]], reference: &[[f32; 3]], width: usize) -> Self {
        assert!(
            image.len() == reference.len() && image.len().is_multiple_of(width) && width > 0,
            "the images must have the same size"
        );
        let (mut square, mut relative, mut signed, mut coded) = (0.0, 0.0, 0.0, 0.0);
        let cells_across = width.div_ceil(CELL_PX);
        let cells_down = (image.len() / width).div_ceil(CELL_PX);
        let mut cells = vec![(0.0, 0u32); cells_across * cells_down];
        for (q, (pixel, expected)) in image.iter().zip(reference).enumerate() {
            let cell = &mut cells[q / width / CELL_PX * cells_across + q % width / CELL_PX];
            for (&a, &b) in pixel.iter().zip(expected) {
                let difference = f64::from(a) - f64::from(b);
                let squared = difference * difference;
                square += squared;
                relative += squared / (f64::from(b) * f64::from(b) + RELATIVE_FLOOR);
                signed += difference;
                coded += (linear_to_srgb(a) - linear_to_srgb(b)).abs() * 255.0;
                cell.0 += squared;
                cell.1 += 1;
            }
        }
        let values = (image.len() * 3) as f64;
        let mut cells: Vec<f64> =
            cells.iter().map(|(square, count)| (square / f64::from(*count)).sqrt()).collect();
        cells.sort_by(f64::total_cmp);
        Self {
            rmse: (square / values).sqrt(),
            relative_mse: relative / values,
            bias: signed / values,
            srgb_steps: coded / values,
            cell_rmse_worst: cells[cells.len() - 1],
            cell_rmse_p99: cells[(cells.len() * 99).div_ceil(100) - 1],
        }
    }

    /// Averages over at least one seed: RMS of the RMSE values, means of the other measures.
    pub fn over_seeds(all: &[Self]) -> Self {
        let mean = |of: &dyn Fn(&Self) -> f64| all.iter().map(of).sum::<f64>() / all.len() as f64;
        let root = |of: &dyn Fn(&Self) -> f64| mean(&|d| of(d) * of(d)).sqrt();
        assert!(!all.is_empty(), "at least one seed");
        Self {
            rmse: root(&|d| d.rmse),
            relative_mse: mean(&|d| d.relative_mse),
            bias: mean(&|d| d.bias),
            srgb_steps: mean(&|d| d.srgb_steps),
            cell_rmse_worst: root(&|d| d.cell_rmse_worst),
            cell_rmse_p99: root(&|d| d.cell_rmse_p99),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_known_difference_has_the_expected_measures() {
        let (width, height) = (20, 10);
        let reference = vec![[0.5f32, 0.0, 2.0]; width * height];
        let mut image = reference.clone();
        // One cell of 4 x 2 px in the lower right corner is off by 0.25 in one colour.
        for y in 8..10 {
            for x in 16..20 {
                image[y * width + x][0] = 0.75;
            }
        }
        let d = Deviation::between(&image, &reference, width);
        let share = 8.0 / 600.0;
        let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
        close(d.rmse, 0.25 * f64::sqrt(share));
        close(d.bias, 0.25 * share);
        close(d.relative_mse, 0.0625 / 0.26 * share);
        close(d.srgb_steps, (linear_to_srgb(0.75) - linear_to_srgb(0.5)) * 255.0 * share);
        close(d.cell_rmse_worst, 0.25 / f64::sqrt(3.0));
        close(d.cell_rmse_p99, 0.25 / f64::sqrt(3.0));
        // Values above white do not change sRGB codes.
        image[0][2] = 9.0;
        let brighter = Deviation::between(&image, &reference, width);
        assert_eq!(brighter.srgb_steps, d.srgb_steps);
        assert!(brighter.rmse > d.rmse);
    }

    #[test]
    fn p99_ignores_the_worst_percent_of_the_cells() {
        let (width, height) = (80, 80);
        let reference = vec![[1.0f32; 3]; width * height];
        let mut image = reference.clone();
        image[0] = [2.0; 3];
        let d = Deviation::between(&image, &reference, width);
        assert_eq!((d.cell_rmse_worst, d.cell_rmse_p99), (0.125, 0.0));
    }
}
