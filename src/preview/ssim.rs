//! Structural similarity (Wang, Bovik, Sheikh and Simoncelli, IEEE TIP 13, 2004), as scikit-image computes it by default.

/// Side of the window, px.
const WINDOW: usize = 7;

/// Mean structural similarity of two grey images of 8-bit range: 7 x 7 px uniform window, K1 = 0.01, K2 = 0.03, sample
/// covariance (divided by 48), the mean over all windows that lie inside. Images smaller than the window are taken as one.
pub fn ssim_grey(a: &[f64], b: &[f64], width: usize, height: usize) -> f64 {
    let (c1, c2) = ((0.01 * 255.0f64).powi(2), (0.03 * 255.0f64).powi(2));
    let (across, down) = (WINDOW.min(width), WINDOW.min(height));
    let count = (across * down) as f64;
    let sample = count / (count - 1.0).max(1.0);
    let (mut sum, mut windows) = (0.0, 0u64);
    for y0 in 0..=height - down {
        for x0 in 0..=width - across {
            let mut s = [0.0; 5];
            for y in y0..y0 + down {
                for x in x0..x0 + across {
                    let (p, q) = (a[y * width + x], b[y * width + x]);
                    for (total, value) in s.iter_mut().zip([p, q, p * p, q * q, p * q]) {
                        *total += value;
                    }
                }
            }
            let [ma, mb, maa, mbb, mab] = s.map(|v| v / count);
            let (va, vb) = (sample * (maa - ma * ma), sample * (mbb - mb * mb));
            let vab = sample * (mab - ma * mb);
            let likeness = (2.0 * ma * mb + c1) * (2.0 * vab + c2);
            sum += likeness / ((ma * ma + mb * mb + c1) * (va + vb + c2));
            windows += 1;
        }
    }
    sum / windows as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_images_are_alike_and_constant_ones_by_their_luminance() {
        let ramp: Vec<f64> = (0..20 * 12).map(|k| f64::from(k % 256)).collect();
        assert!((ssim_grey(&ramp, &ramp, 20, 12) - 1.0).abs() < 1e-12);
        // Without structure the second factor is 1.
        let (dark, bright) = (vec![50.0; 240], vec![100.0; 240]);
        let c1 = 6.5025;
        let expected = (2.0 * 50.0 * 100.0 + c1) / (50.0 * 50.0 + 100.0 * 100.0 + c1);
        assert!((ssim_grey(&dark, &bright, 20, 12) - expected).abs() < 1e-12);
    }

    #[test]
    fn scikit_image_agrees() {
        // skimage.metrics.structural_similarity(a, b), uint8, defaults; tests/evaluate/ssim.py makes the number.
        let (width, height) = (23usize, 17usize);
        let at = |k: usize| ((k * k * 31 + k * 7) % 251) as f64;
        let a: Vec<f64> = (0..width * height).map(at).collect();
        let b: Vec<f64> = (0..width * height)
            .map(|k| ((at(k) * 3.0 + at(k + 5)) / 4.0).floor())
            .collect();
        let found = ssim_grey(&a, &b, width, height);
        assert!((found - SKIMAGE).abs() < 1e-9, "{found}");
    }

    const SKIMAGE: f64 = 0.922_082_920_764_543_2;
}
