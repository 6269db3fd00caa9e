//! Gaussian blur with a kernel of a given width.

/// Continuation beyond a picture's border.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Border {
    Black,
    /// Mirror image at the outermost pixels, which are not repeated; OpenCV's default.
    Mirrored,
}

/// Blurs each plane along both axes.
pub(super) fn blur(
    values: &[f64],
    rows: usize,
    columns: usize,
    kernel: &[f64],
    border: Border,
) -> Vec<f64> {
    let mut blurred = Vec::with_capacity(values.len());
    for plane in values.chunks(rows * columns) {
        // Both passes blur along rows and transpose.
        let once = blur_rows(plane, columns, kernel, border);
        blurred.extend(blur_rows(&once, rows, kernel, border));
    }
    blurred
}

/// Blurs along the rows of one plane and transposes it.
fn blur_rows(plane: &[f64], columns: usize, kernel: &[f64], border: Border) -> Vec<f64> {
    let (rows, radius) = (plane.len() / columns, kernel.len() / 2);
    let mut turned = vec![0.0; plane.len()];
    let mut padded = vec![0.0; columns + 2 * radius];
    for (y, row) in plane.chunks(columns).enumerate() {
        for (k, value) in padded.iter_mut().enumerate() {
            *value = at(row, k as isize - radius as isize, border);
        }
        for x in 0..columns {
            let window = padded[x..].iter().zip(kernel);
            turned[x * rows + y] = window.map(|(value, weight)| value * weight).sum();
        }
    }
    turned
}

fn at(row: &[f64], place: isize, border: Border) -> f64 {
    let count = row.len() as isize;
    if (0..count).contains(&place) {
        return row[place as usize];
    }
    match border {
        Border::Black => 0.0,
        Border::Mirrored if count == 1 => row[0],
        Border::Mirrored => {
            let within = place.rem_euclid(2 * (count - 1));
            row[within.min(2 * (count - 1) - within) as usize]
        }
    }
}

/// Returns `width` Gaussian weights with sum 1; `width` must be odd.
pub(super) fn gaussian(width: usize, sigma: f64) -> Vec<f64> {
    let middle = (width / 2) as f64;
    let weights: Vec<f64> =
        (0..width).map(|k| (k as f64 - middle) / sigma).map(|t| libm::exp(-0.5 * t * t)).collect();
    let sum: f64 = weights.iter().sum();
    weights.iter().map(|w| w / sum).collect()
}
