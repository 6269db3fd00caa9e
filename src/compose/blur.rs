//! Gaussian blur of planes whose border values continue outwards.

/// Radius of the kernel in standard deviations.
const RADIUS_SIGMAS: f64 = 2.5;

/// Blurs planes of a size, px, in place. The order of each sum is that of the kernel's weights.
pub(crate) fn blur(planes: &mut [f32], size: [usize; 2], sigma_px: f64) {
    if let Some(mut blur) = Blur::new(size, sigma_px) {
        for plane in planes.chunks_exact_mut(size[0] * size[1]) {
            blur.rows(plane);
            blur.columns(plane);
        }
    }
}

/// Returns blurred planes, with the values of [`blur`].
pub(crate) fn blurred(planes: &[f32], size: [usize; 2], sigma_px: f64) -> Vec<f32> {
    let Some(mut blur) = Blur::new(size, sigma_px) else { return planes.to_vec() };
    let mut made = vec![0.0; planes.len()];
    let pixels = size[0] * size[1];
    for (plane, out) in planes.chunks_exact(pixels).zip(made.chunks_exact_mut(pixels)) {
        blur.rows(plane);
        blur.columns(out);
    }
    made
}

/// A kernel, and the plane between its two passes.
struct Blur {
    size: [usize; 2],
    kernel: Vec<f32>,
    padded: Vec<f32>,
    across: Vec<f32>,
}

impl Blur {
    /// Returns `None` for a kernel of one weight.
    fn new(size: [usize; 2], sigma_px: f64) -> Option<Self> {
        let radius = (RADIUS_SIGMAS * sigma_px).ceil() as usize;
        let [width, height] = size;
        (radius > 0).then(|| Self {
            size,
            kernel: kernel(radius, sigma_px),
            padded: vec![0.0; width + 2 * radius],
            across: vec![0.0; width * height],
        })
    }

    /// Blurs the rows of a plane into `across`.
    fn rows(&mut self, plane: &[f32]) {
        let (width, radius) = (self.size[0], self.kernel.len() / 2);
        for (row, out) in plane.chunks_exact(width).zip(self.across.chunks_exact_mut(width)) {
            self.padded[..radius].fill(row[0]);
            self.padded[radius..radius + width].copy_from_slice(row);
            self.padded[radius + width..].fill(row[width - 1]);
            weighted(out, &self.kernel, |k| &self.padded[k..k + width]);
        }
    }

    /// Blurs the columns of `across` into a plane.
    fn columns(&self, plane: &mut [f32]) {
        let ([width, height], radius) = (self.size, self.kernel.len() / 2);
        for (y, out) in plane.chunks_exact_mut(width).enumerate() {
            let row = |k: usize| (y + k).saturating_sub(radius).min(height - 1);
            weighted(out, &self.kernel, |k| &self.across[row(k) * width..][..width]);
        }
    }
}

/// Columns whose sums stay in registers.
const LANES: usize = 32;

/// Sets `out` to the sum of rows times weights.
fn weighted<'a>(out: &mut [f32], kernel: &[f32], row: impl Fn(usize) -> &'a [f32]) {
    let whole = out.len() / LANES * LANES;
    for (part, out) in out[..whole].chunks_exact_mut(LANES).enumerate() {
        let mut sums = [0.0f32; LANES];
        for (k, weight) in kernel.iter().enumerate() {
            let values = &row(k)[part * LANES..][..LANES];
            for (sum, value) in sums.iter_mut().zip(values) {
                *sum += weight * value;
            }
        }
        out.copy_from_slice(&sums);
    }
    let rest = &mut out[whole..];
    rest.fill(0.0);
    for (k, weight) in kernel.iter().enumerate() {
        for (sum, value) in rest.iter_mut().zip(&row(k)[whole..]) {
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
        // Wide rows, whose sums are taken in parts, have the sums of the kernel's order.
        let [width, height] = [75, 9];
        let values: Vec<f32> = (0..width * height).map(|k| libm::sinf(k as f32 * 1.3)).collect();
        let made = blurred(&values, [width, height], 1.1);
        let kernel = kernel(3, 1.1);
        let across = |y: usize, x: usize| {
            let place = |k: usize| (x + k).saturating_sub(3).min(width - 1);
            kernel
                .iter()
                .enumerate()
                .fold(0.0f32, |sum, (k, w)| sum + w * values[y * width + place(k)])
        };
        for (at, value) in made.iter().enumerate() {
            let (y, x) = (at / width, at % width);
            let place = |k: usize| (y + k).saturating_sub(3).min(height - 1);
            let sum =
                kernel.iter().enumerate().fold(0.0f32, |sum, (k, w)| sum + w * across(place(k), x));
            assert_eq!(*value, sum, "{y} {x}");
        }
    }
}
