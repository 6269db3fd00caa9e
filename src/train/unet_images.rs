//! What the U-Net does with images between its convolutions: changes of size, joins, and their gradients.

use super::ops::buffers::Buffers;
use super::ops::image::Image;

/// Multiplies a gradient by the slope where the result is not positive, and adds its sums over all pixels.
pub(super) fn through_leaky(gradient: &mut Image, result: &Image, slope: f32, sums: &mut [f32]) {
    for row in 0..gradient.rows {
        let mut of_row = vec![0.0; sums.len()];
        let pixels = gradient.row_mut(row).chunks_exact_mut(sums.len());
        for (gradient, result) in pixels.zip(result.row(row).chunks_exact(sums.len())) {
            for ((gradient, result), sum) in gradient.iter_mut().zip(result).zip(&mut of_row) {
                *gradient *= if *result > 0.0 { 1.0 } else { slope };
                *sum += *gradient;
            }
        }
        sums.iter_mut().zip(of_row).for_each(|(sum, part)| *sum += part);
    }
}

/// Returns 2 x 2 px of an image (3, rows, columns) as twelve channels, less 0.5, for sizes that are padded to multiples
/// of `multiple` with the last row and column.
pub(super) fn unshuffled(
    image: &[f32],
    [rows, columns]: [usize; 2],
    multiple: usize,
    buffers: &Buffers,
) -> Image {
    let half = |length: usize| length.next_multiple_of(multiple) / 2;
    let mut out = Image::zeros(half(rows), half(columns), 12, buffers);
    let channels = out.channels;
    for row in 0..out.rows {
        for (column, pixel) in out.row_mut(row).chunks_exact_mut(channels).enumerate() {
            for (channel, value) in pixel[..12].iter_mut().enumerate() {
                let (plane, y, x) = (channel / 4, channel / 2 % 2, channel % 2);
                let (y, x) = ((2 * row + y).min(rows - 1), (2 * column + x).min(columns - 1));
                *value = image[(plane * rows + y) * columns + x] - 0.5;
            }
        }
    }
    out
}

/// Calls `with` with the place in (3, rows, columns) and the value of each residual.
pub(super) fn each_residual(
    residual: &Image,
    [rows, columns]: [usize; 2],
    mut with: impl FnMut(usize, f32),
) {
    for plane in 0..3 {
        for y in 0..rows {
            let row = residual.row(y / 2);
            for x in 0..columns {
                let channel = plane * 4 + y % 2 * 2 + x % 2;
                let value = row[x / 2 * residual.channels + channel];
                with((plane * rows + y) * columns + x, value);
            }
        }
    }
}

/// Writes a gradient (3, rows, columns) to twelve channels of 2 x 2 px; the gradient of padding is 0.
pub(super) fn gather(out: &mut Image, [rows, columns]: [usize; 2], gradient: &[f32]) {
    let channels = out.channels;
    for plane in 0..3 {
        for y in 0..rows {
            let row = out.row_mut(y / 2);
            for x in 0..columns {
                let channel = plane * 4 + y % 2 * 2 + x % 2;
                row[x / 2 * channels + channel] = gradient[(plane * rows + y) * columns + x];
            }
        }
    }
}

/// Returns the 2 x 2 px sums of the first channels, times `factor`.
fn sums_of_four(image: &Image, channels: usize, factor: f32, buffers: &Buffers) -> Image {
    let mut out = Image::unwritten(image.rows / 2, image.columns / 2, channels, buffers);
    for row in 0..out.rows {
        let (upper, lower) = (image.row(2 * row), image.row(2 * row + 1));
        for (pixel, sums) in out.row_mut(row).chunks_exact_mut(channels).enumerate() {
            let left = 2 * pixel * image.channels..2 * pixel * image.channels + channels;
            let right = left.start + image.channels..left.end + image.channels;
            let (a, b) = (&upper[left.clone()], &upper[right.clone()]);
            let (c, d) = (&lower[left], &lower[right]);
            for (k, sum) in sums.iter_mut().enumerate() {
                *sum = ((a[k] + b[k]) + (c[k] + d[k])) * factor;
            }
        }
    }
    out
}

pub(super) fn pooled(image: &Image, buffers: &Buffers) -> Image {
    sums_of_four(image, image.channels, 0.25, buffers)
}

/// Writes each pixel, times `factor`, to 2 x 2 px of the first channels of `out`.
pub(super) fn doubled(image: &Image, factor: f32, out: &mut Image) {
    let (channels, all) = (image.channels, out.channels);
    for row in 0..out.rows {
        let from = image.row(row / 2);
        for (column, pixel) in out.row_mut(row).chunks_exact_mut(all).enumerate() {
            let from = &from[column / 2 * channels..][..channels];
            pixel.iter_mut().zip(from).for_each(|(out, value)| *out = value * factor);
        }
    }
}

/// Doubles an image and appends the channels of `skip`, which has twice its size.
pub(super) fn joined(image: &Image, skip: &Image, buffers: &Buffers) -> Image {
    let channels = image.channels + skip.channels;
    let mut out = Image::unwritten(skip.rows, skip.columns, channels, buffers);
    doubled(image, 1.0, &mut out);
    for row in 0..out.rows {
        let all = out.channels;
        let pixels = out.row_mut(row).chunks_exact_mut(all);
        for (pixel, from) in pixels.zip(skip.row(row).chunks_exact(skip.channels)) {
            pixel[image.channels..].copy_from_slice(from);
        }
    }
    out
}

/// Inverts [`joined`] for a gradient: the sums of 2 x 2 px of the first channels, and the other channels.
pub(super) fn parted(gradient: &Image, channels: usize, buffers: &Buffers) -> (Image, Image) {
    let rest = gradient.channels - channels;
    let mut skip = Image::unwritten(gradient.rows, gradient.columns, rest, buffers);
    for row in 0..gradient.rows {
        let pixels = skip.row_mut(row).chunks_exact_mut(rest);
        for (pixel, from) in pixels.zip(gradient.row(row).chunks_exact(gradient.channels)) {
            pixel.copy_from_slice(&from[channels..]);
        }
    }
    (sums_of_four(gradient, channels, 1.0, buffers), skip)
}
