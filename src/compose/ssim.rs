//! Structural similarity (Wang, Bovik, Sheikh and Simoncelli, IEEE TIP 13, 2004), with the defaults of scikit-image.

/// Side of the window, px.
const WINDOW: usize = 7;

/// Computes the mean structural similarity of two grey images of 8-bit range over all windows inside the image: 7 x 7
/// px uniform windows, K1 = 0.01, K2 = 0.03, sample covariance (divided by 48). A smaller image has smaller windows.
///
/// Moving sums, which are exact for integers, make the time independent of the window size.
pub fn ssim_grey<T: Copy + Into<f64>>(a: &[T], b: &[T], width: usize, height: usize) -> f64 {
    let (c1, c2) = ((0.01 * 255.0f64).powi(2), (0.03 * 255.0f64).powi(2));
    let (across, down) = (WINDOW.min(width), WINDOW.min(height));
    let count = (across * down) as f64;
    let sample = count / (count - 1.0).max(1.0);
    // Sums of p, q, p^2, q^2 and p q over the window's rows, for each column.
    let mut columns = vec![[0.0; 5]; width];
    let add_row = |columns: &mut [[f64; 5]], y: usize, sign: f64| {
        let row = y * width..(y + 1) * width;
        for (column, (p, q)) in columns.iter_mut().zip(a[row.clone()].iter().zip(&b[row])) {
            let (p, q): (f64, f64) = ((*p).into(), (*q).into());
            for (total, value) in column.iter_mut().zip([p, q, p * p, q * q, p * q]) {
                *total += sign * value;
            }
        }
    };
    (0..down - 1).for_each(|y| add_row(&mut columns, y, 1.0));
    let (mut sum, mut windows) = (0.0, 0u64);
    for y0 in 0..=height - down {
        add_row(&mut columns, y0 + down - 1, 1.0);
        let mut s = [0.0; 5];
        for x in 0..width {
            for (total, value) in s.iter_mut().zip(columns[x]) {
                *total += value;
            }
            if x + 1 < across {
                continue;
            }
            let [ma, mb, maa, mbb, mab] = s.map(|v| v / count);
            let (va, vb) = (sample * (maa - ma * ma), sample * (mbb - mb * mb));
            let vab = sample * (mab - ma * mb);
            let likeness = (2.0 * ma * mb + c1) * (2.0 * vab + c2);
            sum += likeness / ((ma * ma + mb * mb + c1) * (va + vb + c2));
            windows += 1;
            for (total, value) in s.iter_mut().zip(columns[x + 1 - across]) {
                *total -= value;
            }
        }
        add_row(&mut columns, y0, -1.0);
    }
    sum / windows as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_images_score_1_and_constant_images_differ_in_luminance() {
        let ramp: Vec<f64> = (0..20 * 12).map(|k| f64::from(k % 256)).collect();
        assert!((ssim_grey(&ramp, &ramp, 20, 12) - 1.0).abs() < 1e-12);
        // Without structure, the second factor is 1.
        let (dark, bright) = (vec![50.0; 240], vec![100.0; 240]);
        let c1 = 6.5025;
        let expected = (2.0 * 50.0 * 100.0 + c1) / (50.0 * 50.0 + 100.0 * 100.0 + c1);
        assert!((ssim_grey(&dark, &bright, 20, 12) - expected).abs() < 1e-12);
    }

    #[test]
    fn scikit_image_agrees() {
        // skimage.metrics.structural_similarity(a, b), uint8, defaults; tests/train/ssim.py makes the number.
        let (width, height) = (23usize, 17usize);
        let at = |k: usize| ((k * k * 31 + k * 7) % 251) as f64;
        let a: Vec<f64> = (0..width * height).map(at).collect();
        let b: Vec<f64> =
            (0..width * height).map(|k| ((at(k) * 3.0 + at(k + 5)) / 4.0).floor()).collect();
        let found = ssim_grey(&a, &b, width, height);
        assert!((found - SKIMAGE).abs() < 1e-9, "{found}");
    }

    /// Computes the similarity with separate sums for each window.
    fn slow(a: &[f64], b: &[f64], width: usize, height: usize) -> f64 {
        let (across, down) = (WINDOW.min(width), WINDOW.min(height));
        let (mut sum, mut windows) = (0.0, 0.0);
        for y0 in 0..=height - down {
            for x0 in 0..=width - across {
                let cut = |image: &[f64]| -> Vec<f64> {
                    (y0..y0 + down)
                        .flat_map(|y| image[y * width + x0..][..across].to_vec())
                        .collect()
                };
                sum += ssim_grey(&cut(a), &cut(b), across, down);
                windows += 1.0;
            }
        }
        sum / windows
    }

    #[test]
    fn moving_sums_are_the_sums_of_each_window() {
        for (width, height) in [(31, 25), (7, 40), (40, 7), (5, 12), (12, 5), (1, 9), (9, 1)] {
            let at = |k: usize, salt: usize| ((k * k * 37 + k * salt) % 256) as f64;
            let a: Vec<f64> = (0..width * height).map(|k| at(k, 11)).collect();
            let b: Vec<f64> = (0..width * height).map(|k| at(k, 5)).collect();
            let (fast, exact) = (ssim_grey(&a, &b, width, height), slow(&a, &b, width, height));
            assert!((fast - exact).abs() < 1e-12, "{width}x{height} {fast} {exact}");
            // Fractional, nearly flat values: the worst case for rounding in moving sums.
            let near = |v: &f64| 250.0 + v / 768.0;
            let (a, b): (Vec<f64>, Vec<f64>) =
                (a.iter().map(near).collect(), b.iter().map(near).collect());
            let (fast, exact) = (ssim_grey(&a, &b, width, height), slow(&a, &b, width, height));
            assert!((fast - exact).abs() < 1e-9, "{width}x{height} {fast} {exact}");
        }
    }

    const SKIMAGE: f64 = 0.922_082_920_764_543_2;
}
