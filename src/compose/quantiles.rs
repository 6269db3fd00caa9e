//! Quantiles of symmetric distributions as tables, by which random words become noise.

use std::sync::LazyLock;

/// Nodes of the quantile function per factor of two of the probability.
const NODE_BITS: u32 = 6;
const NODES: usize = 1 << NODE_BITS;
const BETWEEN_BITS: u32 = 23 - NODE_BITS;
/// Half the probability of the least random word.
const LEAST: f32 = 1.0 / 8_589_934_592.0;
const FIRST: u32 = LEAST.to_bits() >> BETWEEN_BITS;
const NODE_COUNT: usize = (32 << NODE_BITS) + 1;

/// A symmetric distribution with mean 0.
#[derive(Clone, Debug)]
pub(crate) struct Quantiles {
    /// Values that a number exceeds with the nodes' probabilities; the last one, 0, is repeated.
    nodes: Vec<f32>,
}

static NORMAL: LazyLock<Quantiles> = LazyLock::new(|| Quantiles::new(normal_exceeded_with));

impl Quantiles {
    /// Makes the table of a function that returns the value exceeded with a probability from 1e-10 to 0.5.
    fn new(exceeded_with: impl Fn(f64) -> f64) -> Self {
        let node = |k: usize| f64::from(f32::from_bits((FIRST + k as u32) << BETWEEN_BITS));
        Self {
            nodes: (0..NODE_COUNT).map(|k| exceeded_with(node(k)) as f32).chain([0.0]).collect(),
        }
    }

    /// Returns the standard normal distribution.
    pub(crate) fn normal() -> &'static Self {
        &NORMAL
    }

    /// Makes Tukey's lambda distribution with a standard deviation of 1: Q(p) = (p^lambda - (1 - p)^lambda) / lambda, scaled.
    /// `lambda` must lie above -0.5, where the variance is finite.
    pub(crate) fn tukey(lambda: f64) -> Self {
        let scale = 1.0 / tukey_deviation(lambda);
        if lambda.abs() < LOGISTIC {
            return Self::new(|p| scale * libm::log((1.0 - p) / p));
        }
        // A sensor has a table of its own, so it must be cheap: few of its powers are computed by themselves.
        let mantissa = |k: usize| libm::pow(1.0 + k as f64 / NODES as f64, lambda);
        let mantissas: [f64; NODES] = std::array::from_fn(mantissa);
        let exponents: [f64; 34] = std::array::from_fn(|e| libm::exp2(-lambda * e as f64));
        let power = |probability: f64| {
            let node = ((probability as f32).to_bits() >> BETWEEN_BITS) as usize;
            mantissas[node % NODES] * exponents[127 - node / NODES]
        };
        Self::new(|p| scale * (power_below_one(p, lambda) - power(p)) / lambda)
    }

    /// Returns the number of a random word. Differs from the exact quantile by less than 2e-5 for the normal distribution.
    #[inline]
    pub(crate) fn of(&self, word: u32) -> f32 {
        let probability = ((word & 0x7fff_ffff) as f32 + 0.5) * (1.0 / 4_294_967_296.0);
        let bits = probability.to_bits();
        let node = ((bits >> BETWEEN_BITS) - FIRST) as usize;
        let between = (bits & ((1 << BETWEEN_BITS) - 1)) as f32 / (1 << BETWEEN_BITS) as f32;
        let (low, high) = (self.nodes[node], self.nodes[node + 1]);
        let size = low + (high - low) * between;
        f32::from_bits(size.to_bits() | (word & 0x8000_0000))
    }
}

/// Returns the value that a standard normal number exceeds with a probability from 1e-10 to 0.5, by Newton's method.
fn normal_exceeded_with(probability: f64) -> f64 {
    let mut z = libm::sqrt(-2.0 * libm::log(2.0 * probability));
    for _ in 0..60 {
        let excess = 0.5 * libm::erfc(z * std::f64::consts::FRAC_1_SQRT_2) - probability;
        let density = libm::exp(-0.5 * z * z) / libm::sqrt(std::f64::consts::TAU);
        // Newton's steps from above overshoot in the tail, so they are bounded.
        z = (z + (excess / density).clamp(-0.5, 0.5)).max(0.0);
    }
    z
}

/// Below this size of lambda, the distribution is the logistic one, its limit.
const LOGISTIC: f64 = 1e-6;

/// Returns (1 - p)^lambda for a p from 0 to 0.5, by its series where p is small.
fn power_below_one(p: f64, lambda: f64) -> f64 {
    if p > 1.0 / 256.0 {
        return libm::pow(1.0 - p, lambda);
    }
    let terms = (1..6).rev().map(f64::from);
    terms.fold(1.0, |sum, k| 1.0 - sum * p * (lambda - k + 1.0) / k)
}

/// Returns the standard deviation of Tukey's lambda distribution with scale 1.
pub fn tukey_deviation(lambda: f64) -> f64 {
    if lambda.abs() < LOGISTIC {
        return std::f64::consts::PI / libm::sqrt(3.0);
    }
    let gamma = libm::tgamma(lambda + 1.0);
    let moment = 1.0 / (1.0 + 2.0 * lambda) - gamma * gamma / libm::tgamma(2.0 * lambda + 2.0);
    libm::sqrt(2.0 * moment) / lambda.abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_normal_distribution() {
        for word in (0..=u32::MAX / 2).step_by(65_537).chain([0, 1, 2, u32::MAX / 2]) {
            let size = f64::from(Quantiles::normal().of(word));
            // Values near 0 stay above it: half of the words have the other sign.
            assert!(size >= 0.0);
            assert_eq!(Quantiles::normal().of(word | 0x8000_0000), -size as f32);
            let exact = normal_exceeded_with((f64::from(word) + 0.5) / 4_294_967_296.0);
            assert!((size - exact).abs() < 2e-5, "{word}: {size} {exact}");
        }
        // Published quantiles of 0.975 and 0.9995.
        assert!((normal_exceeded_with(0.025) - 1.959_963_985).abs() < 1e-8);
        assert!((normal_exceeded_with(0.0005) - 3.290_526_731).abs() < 1e-8);
    }

    #[test]
    fn tukey_lambda_has_its_deviation_and_known_members() {
        // Lambda 0 is the logistic distribution, 0.5 to 1 bounded, and 0.1349 nearly normal.
        assert!((tukey_deviation(0.0) - tukey_deviation(1e-5)).abs() < 1e-4);
        assert!((tukey_deviation(1.0) - 1.0 / libm::sqrt(3.0)).abs() < 1e-12, "uniform on [-1, 1]");
        for word in (0..u32::MAX / 2).step_by(1_000_003) {
            let (normal, tukey) = (Quantiles::normal().of(word), Quantiles::tukey(0.1349).of(word));
            assert!(normal > 3.0 || (normal - tukey).abs() < 0.02, "{normal} {tukey}");
        }
        for lambda in [-0.26, -0.026, 0.0, 0.102] {
            let quantiles = Quantiles::tukey(lambda);
            let scale = 1.0 / tukey_deviation(lambda);
            for word in (1..u32::MAX / 2).step_by(20_000_003) {
                let p = (f64::from(word) + 0.5) / 4_294_967_296.0;
                let exact = if lambda == 0.0 {
                    libm::log((1.0 - p) / p)
                } else {
                    (libm::pow(1.0 - p, lambda) - libm::pow(p, lambda)) / lambda
                };
                let found = f64::from(quantiles.of(word));
                let allowed = 5e-5 * (1.0 + exact * scale);
                assert!((found - exact * scale).abs() < allowed, "{lambda} {word}: {found}");
            }
            // The mean of the squares at evenly spaced words; far tails of -0.26 are a few thousandths of it.
            let count = 4_000_000u32;
            let step = u32::MAX / 2 / count;
            let squares = (0..count).map(|k| f64::from(quantiles.of(k * step + step / 2)).powi(2));
            let variance = squares.sum::<f64>() / f64::from(count);
            assert!((variance - 1.0).abs() < 0.004, "{lambda}: {variance}");
        }
    }
}
