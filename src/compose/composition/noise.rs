//! A sensor's noise: normal, with a variance of `shot_noise` times the light plus the square of `read_noise`.

use crate::quantiles::Quantiles;
use crate::random::Stream;

/// Adds noise to linear values. Uses 4 bytes of the stream for each value.
pub(super) fn add_noise(values: &mut [f32], shot: f32, read: f32, stream: &mut Stream) {
    let quantiles = Quantiles::normal();
    let mut bytes = [0; 16_384];
    for part in values.chunks_mut(bytes.len() / 4) {
        let bytes = &mut bytes[..4 * part.len()];
        stream.fill(bytes);
        for (value, word) in part.iter_mut().zip(bytes.chunks_exact(4)) {
            let word = u32::from_le_bytes([word[0], word[1], word[2], word[3]]);
            let sigma = (shot * value.max(0.0) + read * read).sqrt();
            *value += sigma * quantiles.of(word);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
