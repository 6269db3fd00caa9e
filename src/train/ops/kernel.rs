//! Convolution and its two gradients on slices. The image is unfolded in parts that fit in the cache; every part is one
//! matrix product, and threads compute parts in parallel.
//!
//! The division into parts depends only on the sizes, and the order of partial sums is fixed, so the result's bits do
//! not depend on the number of threads.

use super::matrix::{Mat, MatMut, product};
use super::window::{Sizes, Window};
use rayon::prelude::*;
use std::cell::RefCell;

/// Number of positions per part of a pointwise convolution.
const PLACES_AT_ONCE: usize = 4096;

/// Largest number of partial sums of a kernel's gradient.
const SUMS: usize = 8;

/// Number of input channels per part of an image gradient that needs [`Sizes::fold`].
const CHANNELS_AT_ONCE: usize = 4;

thread_local! {
    static BUFFER: RefCell<Vec<f32>> = const { RefCell::new(Vec::new()) };
}

/// Calls `with` with a thread-local buffer of `len` arbitrary values.
fn with_buffer<T>(len: usize, with: impl FnOnce(&mut [f32]) -> T) -> T {
    BUFFER.with_borrow_mut(|buffer| {
        if buffer.len() < len {
            buffer.resize(len, 0.0);
        }
        with(&mut buffer[..len])
    })
}

/// Convolves `image` with `kernel`, without mirroring the kernel.
pub(super) fn forward(sizes: &Sizes, image: &[f32], kernel: &[f32]) -> Vec<f32> {
    let (seen, out_len) = (sizes.seen(), sizes.out_len());
    let kernel = Mat::by_rows(kernel, sizes.channels_out, seen, seen);
    let mut out = vec![0.0; sizes.batch * sizes.channels_out * out_len];
    let planes = sizes.channels_in * sizes.image_len();
    let rows = sizes.rows_at_once();
    let width = if sizes.is_pointwise() { PLACES_AT_ONCE } else { rows * sizes.out[1] };
    let parts: Vec<(usize, usize, MatMut)> = out
        .chunks_exact_mut((sizes.channels_out * out_len).max(1))
        .enumerate()
        .flat_map(|(item, out)| {
            let blocks = MatMut::column_blocks(out, sizes.channels_out, out_len, width);
            blocks.into_iter().enumerate().map(move |(part, block)| (item, part, block))
        })
        .collect();
    parts.into_par_iter().for_each(|(item, part, mut block)| {
        let image = &image[item * planes..][..planes];
        if sizes.is_pointwise() {
            let seen =
                Mat::by_rows(&image[part * width..], sizes.channels_in, block.columns, out_len);
            product(&mut block, kernel, seen, false);
            return;
        }
        let first = part * rows;
        with_buffer(seen * block.columns, |buffer| {
            sizes.unfold(image, first..first + block.columns / sizes.out[1], buffer);
            let unfolded = Mat::by_rows(buffer, seen, block.columns, block.columns);
            product(&mut block, kernel, unfolded, false);
        });
    });
    out
}

/// Computes the kernel's gradient: the sum of its input pixels, weighted with the result's gradient.
pub(super) fn kernel_gradient(sizes: &Sizes, image: &[f32], gradient: &[f32]) -> Vec<f32> {
    let (seen, out_len, image_len) = (sizes.seen(), sizes.out_len(), sizes.image_len());
    let rows = if sizes.is_pointwise() {
        (PLACES_AT_ONCE / sizes.out[1]).max(1)
    } else {
        sizes.rows_at_once()
    };
    let parts_of_one = sizes.out[0].div_ceil(rows);
    let parts = sizes.batch * parts_of_one;
    let at_once = parts.div_ceil(SUMS).max(1);
    let sums: Vec<Vec<f32>> = (0..parts.div_ceil(at_once))
        .into_par_iter()
        .map(|chunk| {
            let mut sum = vec![0.0; sizes.channels_out * seen];
            for part in chunk * at_once..((chunk + 1) * at_once).min(parts) {
                let (item, first) = (part / parts_of_one, part % parts_of_one * rows);
                let rows = first..(first + rows).min(sizes.out[0]);
                let places = rows.len() * sizes.out[1];
                let start = item * sizes.channels_out * out_len + first * sizes.out[1];
                let of_part = Mat::by_rows(&gradient[start..], sizes.channels_out, places, out_len);
                let image =
                    &image[item * sizes.channels_in * image_len..][..sizes.channels_in * image_len];
                let mut out = MatMut::whole(&mut sum, sizes.channels_out, seen);
                if sizes.is_pointwise() {
                    let seen =
                        Mat::by_rows(&image[first * sizes.out[1]..], seen, places, image_len);
                    product(&mut out, of_part, seen.transposed(), true);
                } else {
                    with_buffer(seen * places, |buffer| {
                        sizes.unfold(image, rows, buffer);
                        let unfolded = Mat::by_rows(buffer, seen, places, places);
                        product(&mut out, of_part, unfolded.transposed(), true);
                    });
                }
            }
            sum
        })
        .collect();
    let mut sums = sums.into_iter();
    let mut total = sums.next().unwrap_or_default();
    for sum in sums {
        total.iter_mut().zip(sum).for_each(|(total, part)| *total += part);
    }
    total
}

pub(super) fn image_gradient(sizes: &Sizes, kernel: &[f32], gradient: &[f32]) -> Vec<f32> {
    let reach = sizes.window.dilation * (sizes.kernel[0] - 1);
    let is_square = sizes.kernel[0] == sizes.kernel[1];
    if sizes.window.stride == 1 && is_square && reach >= sizes.window.padding {
        // The gradient is convolved with the kernel rotated by 180 degrees, with inputs and outputs exchanged.
        let turned = Sizes {
            batch: sizes.batch,
            channels_in: sizes.channels_out,
            image: sizes.out,
            channels_out: sizes.channels_in,
            kernel: sizes.kernel,
            out: sizes.image,
            window: Window { padding: reach - sizes.window.padding, ..sizes.window },
        };
        return forward(&turned, gradient, &turn(sizes, kernel));
    }
    let (image_len, out_len, size) =
        (sizes.image_len(), sizes.out_len(), sizes.kernel[0] * sizes.kernel[1]);
    let mut out = vec![0.0; sizes.batch * sizes.channels_in * image_len];
    let channels_of = |group: usize| {
        let first = group * CHANNELS_AT_ONCE;
        first..(first + CHANNELS_AT_ONCE).min(sizes.channels_in)
    };
    let groups: Vec<(usize, usize, &mut [f32])> = out
        .chunks_exact_mut((sizes.channels_in * image_len).max(1))
        .enumerate()
        .flat_map(|(item, planes)| {
            let groups = planes.chunks_mut(CHANNELS_AT_ONCE * image_len).enumerate();
            groups.map(move |(group, planes)| (item, group, planes))
        })
        .collect();
    groups.into_par_iter().for_each(|(item, group, planes)| {
        let channels = channels_of(group);
        let rows = channels.len() * size;
        let gradient = &gradient[item * sizes.channels_out * out_len..];
        let gradient = Mat::by_rows(gradient, sizes.channels_out, out_len, out_len);
        let weights =
            Mat::by_rows(&kernel[channels.start * size..], sizes.channels_out, rows, sizes.seen());
        with_buffer(rows * out_len, |buffer| {
            product(
                &mut MatMut::whole(buffer, rows, out_len),
                weights.transposed(),
                gradient,
                false,
            );
            sizes.fold(buffer, channels.len(), planes);
        });
    });
    out
}

/// Returns the kernel rotated by 180 degrees, with inputs and outputs exchanged.
fn turn(sizes: &Sizes, kernel: &[f32]) -> Vec<f32> {
    let size = sizes.kernel[0] * sizes.kernel[1];
    let mut turned = Vec::with_capacity(kernel.len());
    for input in 0..sizes.channels_in {
        for output in 0..sizes.channels_out {
            let start = (output * sizes.channels_in + input) * size;
            turned.extend(kernel[start..][..size].iter().rev());
        }
    }
    turned
}
