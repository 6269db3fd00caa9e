//! A sensor's noise: normal, with a variance of `shot_noise` times the light plus the square of `read_noise`.

use crate::random::Stream;
use std::sync::LazyLock;

/// Nodes of the quantile function per factor of two of the probability.
const NODE_BITS: u32 = 6;
const BETWEEN_BITS: u32 = 23 - NODE_BITS;
/// Half the probability of the least random word.
const LEAST: f32 = 1.0 / 8_589_934_592.0;
const FIRST: u32 = LEAST.to_bits() >> BETWEEN_BITS;
const NODE_COUNT: usize = (32 << NODE_BITS) + 1;

/// Values that a standard normal number exceeds with the nodes' probabilities; the last one, 0, is repeated.
static QUANTILES: LazyLock<Vec<f32>> = LazyLock::new(|| {
    let node = |k: usize| f64::from(f32::from_bits((FIRST + k as u32) << BETWEEN_BITS));
    (0..NODE_COUNT).map(|k| exceeded_with(node(k)) as f32).chain([0.0]).collect()
});

/// Returns the value that a standard normal number exceeds with a probability from 1e-10 to 0.5, by Newton's method.
fn exceeded_with(probability: f64) -> f64 {
    let mut z = libm::sqrt(-2.0 * libm::log(2.0 * probability));
    for _ in 0..60 {
        let excess = 0.5 * libm::erfc(z * std::f64::consts::FRAC_1_SQRT_2) - probability;
        let density = libm::exp(-0.5 * z * z) / libm::sqrt(std::f64::consts::TAU);
        // Newton's steps from above overshoot in the tail, so they are bounded.
        z = (z + (excess / density).clamp(-0.5, 0.5)).max(0.0);
    }
    z
}

/// Returns a standard normal number of a random word; differs from the exact quantile by less than 2e-5.
fn normal(word: u32, quantiles: &[f32]) -> f32 {
    let probability = ((word & 0x7fff_ffff) as f32 + 0.5) * (1.0 / 4_294_967_296.0);
    let bits = probability.to_bits();
    let node = ((bits >> BETWEEN_BITS) - FIRST) as usize;
    let between = (bits & ((1 << BETWEEN_BITS) - 1)) as f32 / (1 << BETWEEN_BITS) as f32;
    let (low, high) = (quantiles[node], quantiles[node + 1]);
    let size = low + (high - low) * between;
    f32::from_bits(size.to_bits() | (word & 0x8000_0000))
}

/// Adds noise to linear values. Uses 4 bytes of the stream for each value.
pub(super) fn add_noise(values: &mut [f32], shot: f32, read: f32, stream: &mut Stream) {
    let quantiles = &QUANTILES[..];
    let mut bytes = [0; 16_384];
    for part in values.chunks_mut(bytes.len() / 4) {
        let bytes = &mut bytes[..4 * part.len()];
        stream.fill(bytes);
        for (value, word) in part.iter_mut().zip(bytes.chunks_exact(4)) {
            let word = u32::from_le_bytes([word[0], word[1], word[2], word[3]]);
            let sigma = (shot * value.max(0.0) + read * read).sqrt();
            *value += sigma * normal(word, quantiles);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_normal_distribution() {
        for word in (0..=u32::MAX / 2).step_by(65_537).chain([0, 1, 2, u32::MAX / 2]) {
            let size = f64::from(normal(word, &QUANTILES));
            // Values near 0 stay above it: half of the words have the other sign.
            assert!(size >= 0.0);
            assert_eq!(normal(word | 0x8000_0000, &QUANTILES), -size as f32);
            let exact = exceeded_with((f64::from(word) + 0.5) / 4_294_967_296.0);
            assert!((size - exact).abs() < 2e-5, "{word}: {size} {exact}");
        }
        // Published quantiles of 0.975 and 0.9995.
        assert!((exceeded_with(0.025) - 1.959_963_985).abs() < 1e-8);
        assert!((exceeded_with(0.0005) - 3.290_526_731).abs() < 1e-8);
    }

    #[test]
    fn noise_has_the_stated_variance_and_no_mean() {
        for (light, shot, read) in [(0.5, 1e-3, 1e-4), (0.0, 1e-3, 4e-3), (0.2, 1e-5, 1e-3)] {
            let mut values = vec![light; 120_000];
            add_noise(&mut values, shot, read, &mut Stream::new(3, "noise"));
            let count = values.len() as f64;
            let mean = values.iter().map(|v| f64::from(*v)).sum::<f64>() / count;
            let square = values.iter().map(|v| (f64::from(*v) - mean).powi(2)).sum::<f64>() / count;
            let expected = f64::from(shot * light + read * read);
            assert!((square / expected - 1.0).abs() < 0.02, "{light}: {square} {expected}");
            assert!((mean - f64::from(light)).abs() < 4.0 * (expected / count).sqrt(), "{mean}");
        }
    }
}
