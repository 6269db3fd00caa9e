//! Max pooling of 2 x 2 pixels and its gradient.

use super::values;
use candle_core::{CpuStorage, CustomOp1, CustomOp2, Layout, Result, Shape, Tensor};
use rayon::prelude::*;

/// Returns the 2 x 2 px maxima of a (batch, channels, rows, columns) f32 tensor; ignores an odd last row or column.
///
/// The gradient goes to the first largest pixel, as in PyTorch (candle's gradient is four times too small).
pub fn max_pool2(image: &Tensor) -> Result<Tensor> {
    image.contiguous()?.apply_op1(MaxPool2)
}

struct MaxPool2;

impl CustomOp1 for MaxPool2 {
    fn name(&self) -> &'static str {
        "max-pool2"
    }

    fn cpu_fwd(&self, image: &CpuStorage, layout: &Layout) -> Result<(CpuStorage, Shape)> {
        let (batch, channels, rows, columns) = layout.shape().dims4()?;
        let image = values("max_pool2", image, layout)?;
        let (down, across) = (rows / 2, columns / 2);
        let mut out = vec![0.0; batch * channels * down * across];
        if !out.is_empty() {
            let planes = out.par_chunks_exact_mut(down * across);
            planes.zip(image.par_chunks_exact(rows * columns)).for_each(|(out, plane)| {
                for (place, largest) in out.iter_mut().enumerate() {
                    *largest = plane[largest_of(plane, columns, place / across, place % across)];
                }
            });
        }
        Ok((CpuStorage::F32(out), (batch, channels, down, across).into()))
    }

    fn bwd(&self, image: &Tensor, _result: &Tensor, gradient: &Tensor) -> Result<Option<Tensor>> {
        let gradient = gradient.contiguous()?;
        Ok(Some(image.apply_op2_no_bwd(&gradient, &MaxPool2Gradient)?))
    }
}

/// Returns the index of the first largest of four pixels.
fn largest_of(plane: &[f32], columns: usize, row: usize, column: usize) -> usize {
    let first = 2 * row * columns + 2 * column;
    let mut largest = first;
    for place in [first + 1, first + columns, first + columns + 1] {
        if plane[place] > plane[largest] {
            largest = place;
        }
    }
    largest
}

struct MaxPool2Gradient;

impl CustomOp2 for MaxPool2Gradient {
    fn name(&self) -> &'static str {
        "max-pool2-gradient"
    }

    fn cpu_fwd(
        &self,
        image: &CpuStorage,
        layout: &Layout,
        gradient: &CpuStorage,
        gradient_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let (_, _, rows, columns) = layout.shape().dims4()?;
        let image = values("max_pool2", image, layout)?;
        let gradient = values("max_pool2", gradient, gradient_layout)?;
        let across = columns / 2;
        let mut out = vec![0.0; image.len()];
        if !gradient.is_empty() {
            let planes = out.par_chunks_exact_mut(rows * columns);
            let planes = planes.zip(image.par_chunks_exact(rows * columns));
            planes.zip(gradient.par_chunks_exact(rows / 2 * across)).for_each(
                |((out, plane), gradient)| {
                    for (place, gradient) in gradient.iter().enumerate() {
                        out[largest_of(plane, columns, place / across, place % across)] = *gradient;
                    }
                },
            );
        }
        Ok((CpuStorage::F32(out), layout.shape().clone()))
    }
}
