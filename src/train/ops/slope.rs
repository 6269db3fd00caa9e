//! The mean absolute difference of two images' slopes: differences of neighbouring pixels, along rows and columns.

use super::difference::{signed, total};
use super::values;
use candle_core::{CpuStorage, CustomOp2, CustomOp3, Layout, Result, Shape, Tensor};
use rayon::prelude::*;

/// Computes the mean of |slope of (a - b)| along rows plus the mean along columns, of f32 tensors (batch, channels, rows,
/// columns) with two or more rows and columns. Sums are f64. The gradient is 0 where the slopes are equal.
pub fn mean_slope_difference(a: &Tensor, b: &Tensor) -> Result<Tensor> {
    let (_, _, rows, columns) = a.dims4()?;
    if rows < 2 || columns < 2 || a.dims() != b.dims() {
        candle_core::bail!(
            "slopes of {:?} and {:?}: not two images of one size",
            a.dims(),
            b.dims()
        );
    }
    a.contiguous()?.apply_op2(&b.detach().contiguous()?, Slopes)
}

/// Returns the numbers of slopes along rows and along columns.
fn counts(layout: &Layout) -> Result<[f64; 2]> {
    let (batch, channels, rows, columns) = layout.shape().dims4()?;
    let planes = batch * channels;
    Ok([planes * rows * (columns - 1), planes * (rows - 1) * columns].map(|count| count as f64))
}

/// Returns the slope of (a - b) between two places.
fn slope(a: &[f32], b: &[f32], from: usize, to: usize) -> f32 {
    (a[to] - b[to]) - (a[from] - b[from])
}

struct Slopes;

impl CustomOp2 for Slopes {
    fn name(&self) -> &'static str {
        "mean-slope-difference"
    }

    fn cpu_fwd(
        &self,
        a: &CpuStorage,
        layout: &Layout,
        b: &CpuStorage,
        b_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let (_, _, rows, columns) = layout.shape().dims4()?;
        let (a, b) = (values("slopes", a, layout)?, values("slopes", b, b_layout)?);
        let plane = rows * columns;
        let sums: Vec<[f64; 2]> = a
            .par_chunks_exact(plane)
            .zip(b.par_chunks_exact(plane))
            .map(|(a, b)| {
                let d: Vec<f32> = a.iter().zip(b).map(|(a, b)| a - b).collect();
                let along = d.chunks_exact(columns).map(|line| total(&line[1..], line));
                [along.sum(), total(&d[columns..], &d)]
            })
            .collect();
        let counts = counts(layout)?;
        let mean = |k: usize| sums.iter().map(|sum| sum[k]).sum::<f64>() / counts[k];
        Ok((CpuStorage::F32(vec![(mean(0) + mean(1)) as f32]), Shape::from(())))
    }

    fn bwd(
        &self,
        a: &Tensor,
        b: &Tensor,
        _result: &Tensor,
        gradient: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>)> {
        let gradient = gradient.contiguous()?;
        Ok((Some(a.apply_op3_no_bwd(b, &gradient, &SlopesGradient)?), None))
    }
}

/// Operation for the gradient of the first image, given both images and the result's gradient.
struct SlopesGradient;

impl CustomOp3 for SlopesGradient {
    fn name(&self) -> &'static str {
        "mean-slope-difference-gradient"
    }

    fn cpu_fwd(
        &self,
        a: &CpuStorage,
        layout: &Layout,
        b: &CpuStorage,
        b_layout: &Layout,
        gradient: &CpuStorage,
        gradient_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let (_, _, rows, columns) = layout.shape().dims4()?;
        let (a, b) = (values("slopes", a, layout)?, values("slopes", b, b_layout)?);
        let gradient = values("slopes", gradient, gradient_layout)?;
        let gradient = gradient.first().copied().unwrap_or(0.0);
        let [each_x, each_y] = counts(layout)?.map(|count| gradient / count as f32);
        let plane = rows * columns;
        let mut out = vec![0.0; a.len()];
        let planes = out.par_chunks_exact_mut(plane);
        planes.zip(a.par_chunks_exact(plane).zip(b.par_chunks_exact(plane))).for_each(
            |(out, (a, b))| {
                for row in 0..rows {
                    let start = row * columns;
                    for at in start..start + columns - 1 {
                        let push = signed(slope(a, b, at, at + 1), each_x);
                        out[at + 1] += push;
                        out[at] -= push;
                    }
                    if row + 1 < rows {
                        for at in start..start + columns {
                            let push = signed(slope(a, b, at, at + columns), each_y);
                            out[at + columns] += push;
                            out[at] -= push;
                        }
                    }
                }
            },
        );
        Ok((CpuStorage::F32(out), layout.shape().clone()))
    }
}
