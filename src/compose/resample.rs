//! Scaling down by an even or uneven factor: a triangle filter as wide as the factor, without aliasing.

/// Weights of the input values of one output value.
struct Taps {
    first: usize,
    weights: Vec<f32>,
}

/// Scales planes of the size `from`, px, down to the size `to`, which must not exceed `from`.
pub(crate) fn resample(planes: &[f32], from: [usize; 2], to: [usize; 2]) -> Vec<f32> {
    let ([width, height], [columns, rows]) = (from, to);
    let (across, down) = (taps(width, columns), taps(height, rows));
    let mut out = Vec::with_capacity(planes.len() / (width * height) * columns * rows);
    let mut narrow = Vec::with_capacity(columns * height);
    for plane in planes.chunks_exact(width * height) {
        narrow.clear();
        for row in plane.chunks_exact(width) {
            narrow.extend(across.iter().map(|taps| {
                let values = &row[taps.first..][..taps.weights.len()];
                values.iter().zip(&taps.weights).map(|(v, w)| v * w).sum::<f32>()
            }));
        }
        for taps in &down {
            let begin = out.len();
            out.resize(begin + columns, 0.0);
            for (k, weight) in taps.weights.iter().enumerate() {
                let row = &narrow[(taps.first + k) * columns..][..columns];
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
        let small = resample(&planes, [from; 2], [to; 2]);
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
        assert_eq!(resample(&planes, [from; 2], [from; 2]), planes);
    }
}
