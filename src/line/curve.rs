//! Smooth curves of red, green and blue through given points.

/// Red, green and blue as functions of a number: a constant, or a curve through given points.
///
/// Between its points, the curve is the monotone cubic of Fritsch and Butland ("A Method for Constructing Local Monotone Piecewise
/// Cubic Interpolants", SIAM J. Sci. Stat. Comput. 5, 1984), which has a continuous slope and no value beyond those of its neighbours.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// Ascending.
    points: Vec<f64>,
    values: Vec<[f64; 3]>,
    slopes: Vec<[f64; 3]>,
}

impl Curve {
    /// Makes a curve of one value.
    pub fn constant(value: [f64; 3]) -> Self {
        Self { points: vec![1.0], values: vec![value], slopes: vec![[0.0; 3]] }
    }

    /// Makes a curve through `values` at ascending `points`.
    ///
    /// Panics if there are no points, or not as many values.
    pub fn through(points: Vec<f64>, values: Vec<[f64; 3]>) -> Self {
        assert!(!points.is_empty() && points.len() == values.len(), "a curve has points");
        let steps: Vec<(f64, [f64; 3])> = (1..points.len())
            .map(|k| {
                let width = points[k] - points[k - 1];
                (width, [0, 1, 2].map(|c| (values[k][c] - values[k - 1][c]) / width))
            })
            .collect();
        let slope = |k: usize, c: usize| match (k.checked_sub(1).map(|k| steps[k]), steps.get(k)) {
            (Some((before, left)), Some(&(behind, right))) => {
                let (left, right) = (left[c], right[c]);
                // A weighted harmonic mean, or flat at an extremum.
                if left * right <= 0.0 {
                    0.0
                } else {
                    let [u, v] = [before + 2.0 * behind, 2.0 * before + behind];
                    (u + v) / (u / left + v / right)
                }
            }
            (Some((_, only)), None) | (None, Some(&(_, only))) => only[c],
            (None, None) => 0.0,
        };
        let slopes = (0..points.len()).map(|k| [0, 1, 2].map(|c| slope(k, c))).collect();
        Self { points, values, slopes }
    }

    /// Returns red, green and blue at a number; beyond the points, those of the nearest one.
    #[inline]
    pub fn at(&self, x: f64) -> [f64; 3] {
        let last = self.points.len() - 1;
        let behind = self.points.partition_point(|of| *of <= x);
        if behind == 0 || behind > last {
            return self.values[behind.min(last)];
        }
        let k = behind - 1;
        let width = self.points[behind] - self.points[k];
        let t = (x - self.points[k]) / width;
        // Hermite's cubic.
        let [square, cube] = [t * t, t * t * t];
        let weights = [2.0 * cube - 3.0 * square + 1.0, 3.0 * square - 2.0 * cube];
        let rates = [cube - 2.0 * square + t, cube - square];
        [0, 1, 2].map(|c| {
            weights[0] * self.values[k][c]
                + weights[1] * self.values[behind][c]
                + width * (rates[0] * self.slopes[k][c] + rates[1] * self.slopes[behind][c])
        })
    }

    /// True if the curve has the same value everywhere.
    pub fn is_constant(&self) -> bool {
        self.values.iter().all(|value| *value == self.values[0])
    }

    /// True if the colours differ.
    pub fn is_coloured(&self) -> bool {
        self.values.iter().any(|[r, g, b]| r != g || g != b)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The curve meets its points, is monotone between them, and has a continuous slope.
    #[test]
    fn a_curve_is_smooth_and_has_no_overshoot() {
        let points = vec![0.0, 0.17, 0.5, 0.77, 1.0];
        let values = [1.0, 0.4, 0.12, 0.12, 0.15].map(|v| [v, 0.5 * v, 1.0 - v]);
        let curve = Curve::through(points.clone(), values.to_vec());
        for (cos, value) in points.iter().zip(values) {
            let found = curve.at(*cos);
            assert!((0..3).all(|c| (found[c] - value[c]).abs() < 1e-15), "{found:?}");
        }
        let step = 1e-4;
        for i in 0..9990 {
            let cos = 1e-4 * f64::from(i) + 5e-4;
            let [a, b, c] = [cos - step, cos, cos + step].map(|cos| curve.at(cos)[0]);
            // Second differences of a continuous slope vanish with the square of the step.
            assert!((a - 2.0 * b + c).abs() < 60.0 * step * step, "{cos}");
            let k = points.partition_point(|of| *of <= cos).clamp(1, 4);
            let [low, high] = [values[k - 1][0], values[k][0]];
            assert!((low.min(high) - 1e-12..=low.max(high) + 1e-12).contains(&b), "{cos}: {b}");
        }
        assert_eq!([curve.at(-1.0), curve.at(2.0)], [values[0], values[4]]);
        assert_eq!(Curve::constant([0.1, 0.2, 0.3]).at(0.4), [0.1, 0.2, 0.3]);
        // A line stays a line.
        let line = Curve::through(vec![0.0, 0.3, 1.0], [1.0, 0.7, 0.0].map(|v| [v; 3]).to_vec());
        assert!((line.at(0.55)[1] - 0.45).abs() < 1e-15);
    }
}
