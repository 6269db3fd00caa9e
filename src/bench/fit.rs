//! Fits the rate at which an error decreases with the number of samples.

use serde::Serialize;

/// Log-log slope of a layer's error over its samples; about -0.5 for independent samples.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Slope {
    pub variant: &'static str,
    pub layer: &'static str,
    /// Slope over all fitted rungs; `null` with fewer than two different numbers of samples.
    pub slope: Option<f64>,
    /// Number of fitted rungs.
    pub rungs: usize,
    /// Slope over the fitted rungs with at least 16 samples; `null` as above.
    pub tail_slope: Option<f64>,
}

/// Computes the least-squares slope of log `y` against log `x` over all positive points; `None` if all `x` are equal.
pub(super) fn log_log_slope(points: &[(f64, f64)]) -> Option<f64> {
    let logs: Vec<(f64, f64)> = points
        .iter()
        .filter(|(x, y)| *x > 0.0 && *y > 0.0)
        .map(|(x, y)| (libm::log(*x), libm::log(*y)))
        .collect();
    let n = logs.len() as f64;
    let (mean_x, mean_y) =
        (logs.iter().map(|p| p.0).sum::<f64>() / n, logs.iter().map(|p| p.1).sum::<f64>() / n);
    let over: f64 = logs.iter().map(|p| (p.0 - mean_x) * (p.1 - mean_y)).sum();
    let under: f64 = logs.iter().map(|p| (p.0 - mean_x) * (p.0 - mean_x)).sum();
    (under > 0.0).then(|| over / under)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_slope_of_a_power_is_its_exponent() {
        let points: Vec<(f64, f64)> =
            (0..6).map(|k| f64::from(1 << k)).map(|n| (n, 3.0 * libm::pow(n, -0.75))).collect();
        assert!((log_log_slope(&points).unwrap() + 0.75).abs() < 1e-12);
        assert_eq!(log_log_slope(&points[..1]), None);
        assert_eq!(log_log_slope(&[]), None);
    }
}
