//! Sizes of a convolution, and unfolding of the pixels under its kernel into a matrix (im2col).

use candle_core::{Result, bail};
use std::ops::Range;

/// Padding, stride and dilation of a kernel, equal in both directions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// Width of the zero border around the image, px.
    pub padding: usize,
    /// Distance between kernel positions, px.
    pub stride: usize,
    /// Distance between the kernel's pixels, px.
    pub dilation: usize,
}

impl Window {
    /// Returns the window with which a kernel of odd size keeps the image size.
    pub const fn same(kernel: usize, dilation: usize) -> Self {
        Self { padding: dilation * (kernel / 2), stride: 1, dilation }
    }
}

/// All sizes of a convolution.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sizes {
    pub(super) batch: usize,
    pub(super) channels_in: usize,
    /// Rows and columns of the image.
    pub(super) image: [usize; 2],
    pub(super) channels_out: usize,
    pub(super) kernel: [usize; 2],
    /// Rows and columns of the result.
    pub(super) out: [usize; 2],
    pub(super) window: Window,
}

impl Sizes {
    /// Computes the sizes from the shapes of an image (batch, in, rows, columns) and a kernel (out, in, rows, columns).
    pub(super) fn new(image: &[usize], kernel: &[usize], window: Window) -> Result<Self> {
        let (
            &[batch, channels_in, rows, columns],
            &[channels_out, of, kernel_rows, kernel_columns],
        ) = (image, kernel)
        else {
            bail!(
                "conv2d: image and kernel must have four dimensions, not {image:?} and {kernel:?}"
            );
        };
        let fits = |size: usize, kernel: usize| {
            kernel > 0 && size + 2 * window.padding > window.dilation * (kernel - 1)
        };
        let is_sound = window.stride > 0
            && window.dilation > 0
            && of == channels_in
            && fits(rows, kernel_rows)
            && fits(columns, kernel_columns);
        if !is_sound {
            bail!(
                "conv2d: a kernel of {kernel:?} does not fit an image of {image:?} with {window:?}"
            );
        }
        let out = |size: usize, kernel: usize| {
            (size + 2 * window.padding - window.dilation * (kernel - 1) - 1) / window.stride + 1
        };
        Ok(Self {
            batch,
            channels_in,
            image: [rows, columns],
            channels_out,
            kernel: [kernel_rows, kernel_columns],
            out: [out(rows, kernel_rows), out(columns, kernel_columns)],
            window,
        })
    }

    /// Returns the number of values under the kernel at one position, over all channels.
    pub(super) fn seen(&self) -> usize {
        self.channels_in * self.kernel[0] * self.kernel[1]
    }

    pub(super) fn image_len(&self) -> usize {
        self.image[0] * self.image[1]
    }

    pub(super) fn out_len(&self) -> usize {
        self.out[0] * self.out[1]
    }

    /// True for a 1 x 1 kernel with stride 1 and without padding, which needs no unfolding.
    pub(super) fn is_pointwise(&self) -> bool {
        self.kernel == [1, 1] && self.window.stride == 1 && self.window.padding == 0
    }

    /// Returns the number of result rows to unfold at once: up to 768 KiB and a quarter (rounded up), but at least one.
    pub(super) fn rows_at_once(&self) -> usize {
        let fit = 768 * 1024 / 4 / self.seen() / self.out[1];
        fit.max(1).min(self.out[0].div_ceil(4)).max(1)
    }

    /// Returns the result columns with `kernel_column` inside the image, and the image column of the first of them.
    fn inside(&self, kernel_column: usize) -> (Range<usize>, usize) {
        let offset = (kernel_column * self.window.dilation) as isize - self.window.padding as isize;
        let (stride, width) = (self.window.stride, self.image[1] as isize);
        let first = (-offset).max(0) as usize;
        let first = first.div_ceil(stride);
        let end = ((width - offset).max(0) as usize).div_ceil(stride).min(self.out[1]);
        let first = first.min(end);
        let column = (first * stride) as isize + offset;
        (first..end, column.max(0) as usize)
    }

    /// Returns the image row under a kernel row at a result row; `None` in the zero border.
    fn image_row(&self, row: usize, kernel_row: usize) -> Option<usize> {
        let row = row * self.window.stride + kernel_row * self.window.dilation;
        let row = row.checked_sub(self.window.padding)?;
        (row < self.image[0]).then_some(row)
    }

    /// Calls `with` with the channel, row and column of each kernel pixel, in storage order.
    fn each_pixel(&self, channels: Range<usize>, mut with: impl FnMut(usize, usize, usize)) {
        for channel in channels {
            for row in 0..self.kernel[0] {
                for column in 0..self.kernel[1] {
                    with(channel, row, column);
                }
            }
        }
    }

    /// Writes the image values under the kernel at `rows` of the result: [`Self::seen`] rows, one column per position.
    pub(super) fn unfold(&self, image: &[f32], rows: Range<usize>, into: &mut [f32]) {
        let places = rows.len() * self.out[1];
        let mut lines = into.chunks_exact_mut(places);
        self.each_pixel(0..self.channels_in, |channel, kernel_row, kernel_column| {
            let line = lines.next().expect("a line for each kernel pixel");
            let (inside, column) = self.inside(kernel_column);
            let plane = &image[channel * self.image_len()..][..self.image_len()];
            for (part, row) in line.chunks_exact_mut(self.out[1]).zip(rows.clone()) {
                let Some(row) = self.image_row(row, kernel_row).filter(|_| !inside.is_empty())
                else {
                    part.fill(0.0);
                    continue;
                };
                let from = &plane[row * self.image[1]..][..self.image[1]];
                part[..inside.start].fill(0.0);
                part[inside.end..].fill(0.0);
                let part = &mut part[inside.clone()];
                if self.window.stride == 1 {
                    part.copy_from_slice(&from[column..][..part.len()]);
                } else {
                    let seen = from[column..].iter().step_by(self.window.stride);
                    part.iter_mut().zip(seen).for_each(|(to, from)| *to = *from);
                }
            }
        });
    }

    /// Applies the transpose of [`Self::unfold`] to some channels: adds each position's values to the image's `planes`.
    pub(super) fn fold(&self, unfolded: &[f32], channels: usize, planes: &mut [f32]) {
        let mut lines = unfolded.chunks_exact(self.out_len());
        self.each_pixel(0..channels, |channel, kernel_row, kernel_column| {
            let line = lines.next().expect("a line for each kernel pixel");
            let (inside, column) = self.inside(kernel_column);
            let plane = &mut planes[channel * self.image_len()..][..self.image_len()];
            for (part, row) in line.chunks_exact(self.out[1]).zip(0..self.out[0]) {
                let Some(row) = self.image_row(row, kernel_row).filter(|_| !inside.is_empty())
                else {
                    continue;
                };
                let to = &mut plane[row * self.image[1]..][..self.image[1]];
                let seen = to[column..].iter_mut().step_by(self.window.stride);
                seen.zip(&part[inside.clone()]).for_each(|(to, from)| *to += from);
            }
        });
    }
}
