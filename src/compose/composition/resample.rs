//! Scaling down by an even or uneven factor: a triangle filter as wide as the factor, without aliasing.

/// Weights of the input values of one output value.
struct Taps {
    first: usize,
    weights: Vec<f32>,
}

/// Scales square planes with a side of `from` px down to `to` px. `to` must not exceed `from`.
pub(super) fn resample(planes: &[f32], from: usize, to: usize) -> Vec<f32> {
    let taps = taps(from, to);
    let mut out = Vec::with_capacity(planes.len() / from / from * to * to);
    let mut narrow = Vec::with_capacity(from * to);
    for plane in planes.chunks_exact(from * from) {
        narrow.clear();
        for row in plane.chunks_exact(from) {
            narrow.extend(taps.iter().map(|taps| {
                let values = &row[taps.first..][..taps.weights.len()];
                values.iter().zip(&taps.weights).map(|(v, w)| v * w).sum::<f32>()
            }));
        }
        for taps in &taps {
            let begin = out.len();
            out.resize(begin + to, 0.0);
            for (k, weight) in taps.weights.iter().enumerate() {
                let row = &narrow[(taps.first + k) * to..][..to];
                for (sum, value) in out[begin..].iter_mut().zip(row) {
                    *sum += weight * value;
                }
            }
        }
    }
    out
}

/// Returns the taps of all output values. The weights of each output value have the sum 1.
fn taps(from: usize, to: usize) -> Vec<Taps> {
    let scale = from as f64 / to as f64;
    let taps = (0..to).map(|k| {
        let centre = (k as f64 + 0.5) * scale;
        let first = (centre - scale).floor().max(0.0) as usize;
        let end = ((centre + scale).ceil() as usize).min(from);
        let weight = |at: usize| (1.0 - ((at as f64 + 0.5 - centre) / scale).abs()).max(0.0);
        let sum: f64 = (first..end).map(weight).sum();
        Taps { first, weights: (first..end).map(|at| (weight(at) / sum) as f32).collect() }
    });
    taps.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constants_stay_and_ramps_keep_their_slope() {
        let (from, to) = (53, 32);
        let mut planes = vec![0.375; from * from];
        planes.extend((0..from * from).map(|k| (k % from) as f32 + 0.5));
        let small = resample(&planes, from, to);
        assert_eq!(small.len(), 2 * to * to);
        assert!(small[..to * to].iter().all(|v| (v - 0.375).abs() < 1e-6));
        let scale = from as f32 / to as f32;
        for (k, value) in small[to * to..].iter().enumerate() {
            let column = k % to;
            let expected = (column as f32 + 0.5) * scale;
            // The filter leaves the picture at its border.
            let allowed = if (2..to - 2).contains(&column) { 0.1 } else { 0.5 };
            assert!((value - expected).abs() < allowed, "{column}: {value} {expected}");
        }
        assert_eq!(resample(&planes, from, from), planes);
    }
}
