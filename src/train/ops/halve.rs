//! Mean pooling of 2 x 2 pixels and its gradient.

use super::values;
use candle_core::{CpuStorage, CustomOp1, Layout, Result, Shape, Tensor, bail};
use rayon::prelude::*;

/// Number of rows of the smaller image that one thread processes at a time.
const ROWS_AT_ONCE: usize = 64;

/// Returns the 2 x 2 px means of a (batch, channels, rows, columns) f32 tensor with even rows and columns.
pub fn mean_pool2(image: &Tensor) -> Result<Tensor> {
    match image.dims() {
        [_, _, rows, columns] if rows.is_multiple_of(2) && columns.is_multiple_of(2) => {}
        dims => bail!("mean_pool2: {dims:?} is not (batch, channels, even rows, even columns)"),
    }
    image.contiguous()?.apply_op1(MeanPool2)
}

struct MeanPool2;

impl CustomOp1 for MeanPool2 {
    fn name(&self) -> &'static str {
        "mean-pool2"
    }

    fn cpu_fwd(&self, image: &CpuStorage, layout: &Layout) -> Result<(CpuStorage, Shape)> {
        let (batch, channels, rows, columns) = layout.shape().dims4()?;
        let image = values("mean_pool2", image, layout)?;
        let mut out = vec![0.0; image.len() / 4];
        let lines = out.par_chunks_exact_mut((columns / 2).max(1)).with_min_len(ROWS_AT_ONCE);
        lines.zip(image.par_chunks_exact((2 * columns).max(1))).for_each(|(line, seen)| {
            let (upper, lower) = seen.split_at(columns);
            let pairs = upper.chunks_exact(2).zip(lower.chunks_exact(2));
            for (out, (upper, lower)) in line.iter_mut().zip(pairs) {
                *out = ((upper[0] + upper[1]) + (lower[0] + lower[1])) * 0.25;
            }
        });
        Ok((CpuStorage::F32(out), (batch, channels, rows / 2, columns / 2).into()))
    }

    fn bwd(&self, _image: &Tensor, _result: &Tensor, gradient: &Tensor) -> Result<Option<Tensor>> {
        Ok(Some(gradient.contiguous()?.apply_op1_no_bwd(&MeanPool2Gradient)?))
    }
}

/// Operation that repeats pixels to twice the size, and divides them by four.
struct MeanPool2Gradient;

impl CustomOp1 for MeanPool2Gradient {
    fn name(&self) -> &'static str {
        "mean-pool2-gradient"
    }

    fn cpu_fwd(&self, gradient: &CpuStorage, layout: &Layout) -> Result<(CpuStorage, Shape)> {
        let (batch, channels, rows, columns) = layout.shape().dims4()?;
        let gradient = values("mean_pool2", gradient, layout)?;
        let mut out = vec![0.0; 4 * gradient.len()];
        let lines = out.par_chunks_exact_mut((4 * columns).max(1)).with_min_len(ROWS_AT_ONCE);
        lines.zip(gradient.par_chunks_exact(columns.max(1))).for_each(|(line, gradient)| {
            let (upper, lower) = line.split_at_mut(2 * columns);
            for (pair, value) in upper.chunks_exact_mut(2).zip(gradient) {
                pair.fill(value * 0.25);
            }
            lower.copy_from_slice(upper);
        });
        Ok((CpuStorage::F32(out), (batch, channels, 2 * rows, 2 * columns).into()))
    }
}
