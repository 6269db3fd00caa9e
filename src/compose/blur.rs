//! Gaussian blur of planes whose border values continue outwards.

/// Radius of the kernel in standard deviations.
const RADIUS_SIGMAS: f64 = 2.5;

/// Blurs planes of a size, px, in place. The order of each sum is that of the kernel's weights.
pub(crate) fn blur(planes: &mut [f32], [width, height]: [usize; 2], sigma_px: f64) {
    let radius = (RADIUS_SIGMAS * sigma_px).ceil() as usize;
    if radius == 0 {
        return;
    }
    let kernel = kernel(radius, sigma_px);
    let mut padded = vec![0.0; width + 2 * radius];
    let mut across = vec![0.0; width * height];
    for plane in planes.chunks_exact_mut(width * height) {
        for (row, out) in plane.chunks_exact(width).zip(across.chunks_exact_mut(width)) {
            padded[..radius].fill(row[0]);
            padded[radius..radius + width].copy_from_slice(row);
            padded[radius + width..].fill(row[width - 1]);
            weighted(out, &kernel, |k| &padded[k..k + width]);
        }
        for (y, out) in plane.chunks_exact_mut(width).enumerate() {
            let row = |k: usize| (y + k).saturating_sub(radius).min(height - 1);
            weighted(out, &kernel, |k| &across[row(k) * width..][..width]);
        }
    }
}

/// Sets `out` to the sum of rows times weights.
fn weighted<'a>(out: &mut [f32], kernel: &[f32], row: impl Fn(usize) -> &'a [f32]) {
    out.fill(0.0);
    for (k, weight) in kernel.iter().enumerate() {
        for (sum, value) in out.iter_mut().zip(row(k)) {
            *sum += weight * value;
        }
    }
}

/// Returns Gaussian weights at distances up to `radius`, with sum 1.
fn kernel(radius: usize, sigma_px: f64) -> Vec<f32> {
    let weight = |k: usize| {
        let t = (k as f64 - radius as f64) / sigma_px;
        libm::exp(-0.5 * t * t)
    };
    let sum: f64 = (0..=2 * radius).map(weight).sum();
    (0..=2 * radius).map(|k| (weight(k) / sum) as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_spread_and_constants_stay() {
        let side = 33;
        let mut planes = vec![0.0; side * side];
        planes[16 * side + 16] = 1.0;
        planes.extend(vec![0.75; side * side]);
        let before = planes.clone();
        blur(&mut planes, [side; 2], 0.0);
        assert_eq!(planes, before);
        blur(&mut planes, [side; 2], 2.0);
        let (point, even) = planes.split_at(side * side);
        assert!(even.iter().all(|v| (v - 0.75).abs() < 1e-6));
        let (mut sum, mut squares) = (0.0, 0.0);
        for (k, value) in point.iter().enumerate() {
            sum += value;
            squares += value * (k as f32 % side as f32 - 16.0).powi(2);
        }
        // The kernel ends at 2.5 sigma, so its variance is less than 4 px^2.
        assert!((sum - 1.0).abs() < 1e-5 && (3.5..4.0).contains(&squares), "{sum} {squares}");
        assert_eq!(point[16 * side + 13], point[13 * side + 16]);
    }

    #[test]
    fn each_side_of_a_rectangle_continues_its_border() {
        let [width, height] = [7, 4];
        let mut planes: Vec<f32> = (0..width * height).map(|k| (k / width) as f32).collect();
        blur(&mut planes, [width, height], 0.8);
        for row in planes.chunks_exact(width) {
            assert!(row.iter().all(|v| (v - row[0]).abs() < 1e-6));
        }
        let sum: f32 = planes.iter().step_by(width).sum();
        assert!((sum - 6.0).abs() < 1e-5 && planes[0] > 0.1, "{planes:?}");
    }
}
