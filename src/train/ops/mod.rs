//! Tensor operations that candle computes slowly, with wrong gradients or not at all: convolution, pooling, resizing,
//! norm with leaky ReLU, absolute value, mean absolute differences, bounds.
//!
//! ```text
//! matrix.rs    matrix products by the gemm crate            convolve.rs   convolution op: tensors, gradients
//! window.rs    unfolding of the pixels under a kernel       pool.rs       2 x 2 max pooling
//! kernel.rs    convolution and its two gradients on slices  resize.rs     bilinear resizing
//! difference.rs   |x|, mean absolute difference             norm.rs       batch norm and leaky ReLU
//! halve.rs     2 x 2 mean pooling                           bound.rs      bound of an output by its input
//! slope.rs     mean absolute difference of slopes           direct.rs     3 x 3 convolutions for unet_op.rs, on lanes.rs
//! image.rs     images and kernels of direct.rs              buffers.rs    memory of images
//! ```
//!
//! The order of sums does not depend on the number of threads.

mod bound;
pub(crate) mod buffers;
mod convolve;
mod difference;
pub(crate) mod direct;
mod halve;
pub(crate) mod image;
mod kernel;
mod lanes;
mod matrix;
mod norm;
mod pool;
#[cfg(test)]
pub(crate) mod reference;
mod resize;
mod slope;
mod window;

pub use bound::{bounded, brightened};
pub use convolve::{conv2d, conv2d_bias_leaky};
pub use difference::{absolute, mean_absolute_difference};
pub use halve::mean_pool2;
pub use matrix::{Mat, MatMut, product};
pub use norm::{NormOptions, channel_statistics, norm_act};
pub use pool::max_pool2;
pub use resize::{Sampling, bilinear, bilinear_at};
pub use slope::mean_slope_difference;
pub use window::Window;

use candle_core::{CpuStorage, Layout, Result};

/// Returns the values of a contiguous f32 tensor.
pub fn values<'a>(op: &str, storage: &'a CpuStorage, layout: &Layout) -> Result<&'a [f32]> {
    let Some((start, end)) = layout.contiguous_offsets() else {
        candle_core::bail!("{op}: the tensor is not contiguous");
    };
    match storage {
        CpuStorage::F32(values) => Ok(&values[start..end]),
        _ => candle_core::bail!("{op}: the tensor is not f32"),
    }
}

#[cfg(test)]
mod tests;
