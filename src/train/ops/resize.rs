//! Bilinear resizing and its gradient.

use super::values;
use candle_core::{CpuStorage, CustomOp1, Layout, Result, Shape, Tensor};
use rayon::prelude::*;

/// Positions of pixels in a resized image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sampling {
    /// Pixel centres at halves (PyTorch's `align_corners=False`).
    Centres,
    /// The first pixels coincide, and position k is k times the ratio of the sizes (TensorFlow 1).
    Corners,
    /// First and last pixels coincide (PyTorch's `align_corners=True`).
    Aligned,
}

/// Resizes a (batch, channels, rows, columns) f32 tensor bilinearly, with pixel centres at halves and clamping at the
/// borders (PyTorch's `align_corners=False` without antialiasing).
pub fn bilinear(image: &Tensor, rows: usize, columns: usize) -> Result<Tensor> {
    bilinear_at(image, rows, columns, Sampling::Centres)
}

/// Resizes like [`bilinear`], with pixels at the given positions.
pub fn bilinear_at(
    image: &Tensor,
    rows: usize,
    columns: usize,
    sampling: Sampling,
) -> Result<Tensor> {
    let (_, _, from_rows, from_columns) = image.dims4()?;
    if [from_rows, from_columns] == [rows, columns] {
        return Ok(image.clone());
    }
    image.contiguous()?.apply_op1(Resize { to: [rows, columns], sampling })
}

/// Returns the two neighbours of each of `to` pixels among `from` pixels of a line, and the weight of the second.
fn taps(from: usize, to: usize, sampling: Sampling) -> Vec<(usize, usize, f32)> {
    let scale = from as f64 / to as f64;
    let tap = |place: usize| {
        let at = match sampling {
            Sampling::Centres => ((place as f64 + 0.5) * scale - 0.5).max(0.0),
            Sampling::Corners => place as f64 * scale,
            Sampling::Aligned if to == 1 => 0.0,
            Sampling::Aligned => place as f64 * ((from - 1) as f64 / (to - 1) as f64),
        };
        let first = (at as usize).min(from - 1);
        (first, (first + 1).min(from - 1), (at - first as f64) as f32)
    };
    (0..to).map(tap).collect()
}

struct Resize {
    to: [usize; 2],
    sampling: Sampling,
}

impl CustomOp1 for Resize {
    fn name(&self) -> &'static str {
        "bilinear"
    }

    fn cpu_fwd(&self, image: &CpuStorage, layout: &Layout) -> Result<(CpuStorage, Shape)> {
        let (batch, channels, from_rows, from_columns) = layout.shape().dims4()?;
        let image = values("bilinear", image, layout)?;
        let [rows, columns] = self.to;
        let of = |from, to| taps(from, to, self.sampling);
        let (down, across) = (of(from_rows, rows), of(from_columns, columns));
        let mut out = vec![0.0; batch * channels * rows * columns];
        let planes = out.par_chunks_exact_mut(rows * columns);
        planes.zip(image.par_chunks_exact(from_rows * from_columns)).for_each(|(out, plane)| {
            let mut line = vec![0.0; from_columns];
            for (out, &(first, second, weight)) in out.chunks_exact_mut(columns).zip(&down) {
                let upper = &plane[first * from_columns..][..from_columns];
                let lower = &plane[second * from_columns..][..from_columns];
                for (line, (upper, lower)) in line.iter_mut().zip(upper.iter().zip(lower)) {
                    *line = (1.0 - weight) * upper + weight * lower;
                }
                for (out, &(first, second, weight)) in out.iter_mut().zip(&across) {
                    *out = (1.0 - weight) * line[first] + weight * line[second];
                }
            }
        });
        Ok((CpuStorage::F32(out), (batch, channels, rows, columns).into()))
    }

    fn bwd(&self, image: &Tensor, _result: &Tensor, gradient: &Tensor) -> Result<Option<Tensor>> {
        let (_, _, rows, columns) = image.dims4()?;
        let back = ResizeGradient { from: [rows, columns], sampling: self.sampling };
        Ok(Some(gradient.contiguous()?.apply_op1_no_bwd(&back)?))
    }
}

/// The transpose of [`Resize`].
struct ResizeGradient {
    from: [usize; 2],
    sampling: Sampling,
}

impl CustomOp1 for ResizeGradient {
    fn name(&self) -> &'static str {
        "bilinear-gradient"
    }

    fn cpu_fwd(&self, gradient: &CpuStorage, layout: &Layout) -> Result<(CpuStorage, Shape)> {
        let (batch, channels, rows, columns) = layout.shape().dims4()?;
        let gradient = values("bilinear", gradient, layout)?;
        let [from_rows, from_columns] = self.from;
        let of = |from, to| taps(from, to, self.sampling);
        let (down, across) = (of(from_rows, rows), of(from_columns, columns));
        let mut out = vec![0.0; batch * channels * from_rows * from_columns];
        let planes = out.par_chunks_exact_mut(from_rows * from_columns);
        planes.zip(gradient.par_chunks_exact(rows * columns)).for_each(|(out, gradient)| {
            let mut line = vec![0.0; from_columns];
            for (gradient, &(upper, lower, weight)) in gradient.chunks_exact(columns).zip(&down) {
                line.fill(0.0);
                for (gradient, &(first, second, weight)) in gradient.iter().zip(&across) {
                    line[first] += (1.0 - weight) * gradient;
                    line[second] += weight * gradient;
                }
                for (row, weight) in [(upper, 1.0 - weight), (lower, weight)] {
                    let out = &mut out[row * from_columns..][..from_columns];
                    out.iter_mut().zip(&line).for_each(|(out, value)| *out += weight * value);
                }
            }
        });
        Ok((CpuStorage::F32(out), (batch, channels, from_rows, from_columns).into()))
    }
}
