//! The absolute value, and the mean absolute difference in one pass.

use super::values;
use candle_core::{CpuStorage, CustomOp2, CustomOp3, Layout, Result, Shape, Tensor};
use rayon::prelude::*;

/// Computes |x| with PyTorch's gradient 0 at 0. candle's gradient 1 there would bias black and clipped pixels.
pub fn absolute(x: &Tensor) -> Result<Tensor> {
    // The sign is constant, so the derivative of the product is the sign.
    x * x.sign()?.detach()
}

/// Number of differences that one thread sums at a time.
const AT_ONCE: usize = 1 << 15;

/// Computes the mean of |a - b| of f32 tensors of one shape. Sums are f64. The gradient is 0 where a = b.
pub fn mean_absolute_difference(a: &Tensor, b: &Tensor) -> Result<Tensor> {
    a.contiguous()?.apply_op2(&b.contiguous()?, Difference)
}

struct Difference;

impl CustomOp2 for Difference {
    fn name(&self) -> &'static str {
        "mean-absolute-difference"
    }

    fn cpu_fwd(
        &self,
        a: &CpuStorage,
        a_layout: &Layout,
        b: &CpuStorage,
        b_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let [a, b] = both(a, a_layout, b, b_layout)?;
        let sums: Vec<f64> =
            a.par_chunks(AT_ONCE).zip(b.par_chunks(AT_ONCE)).map(|(a, b)| total(a, b)).collect();
        let mean = sums.iter().sum::<f64>() / a.len().max(1) as f64;
        Ok((CpuStorage::F32(vec![mean as f32]), Shape::from(())))
    }

    fn bwd(
        &self,
        a: &Tensor,
        b: &Tensor,
        _result: &Tensor,
        gradient: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>)> {
        let of = |one: &Tensor, other: &Tensor| -> Result<Option<Tensor>> {
            if !one.track_op() {
                return Ok(None);
            }
            let (one, other) = (one.contiguous()?, other.contiguous()?);
            let side = one.apply_op3_no_bwd(&other, &gradient.contiguous()?, &Side)?;
            Ok(Some(side))
        };
        Ok((of(a, b)?, of(b, a)?))
    }
}

/// Operation for the gradient of the first tensor, given both tensors and the result's gradient.
struct Side;

impl CustomOp3 for Side {
    fn name(&self) -> &'static str {
        "mean-absolute-difference-gradient"
    }

    fn cpu_fwd(
        &self,
        a: &CpuStorage,
        a_layout: &Layout,
        b: &CpuStorage,
        b_layout: &Layout,
        gradient: &CpuStorage,
        gradient_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let [a, b] = both(a, a_layout, b, b_layout)?;
        let gradient = values("difference", gradient, gradient_layout)?;
        let each = gradient.first().copied().unwrap_or(0.0) / a.len().max(1) as f32;
        let pairs = a.par_iter().zip(b).with_min_len(AT_ONCE);
        let out = pairs.map(|(a, b)| signed(a - b, each));
        Ok((CpuStorage::F32(out.collect()), a_layout.shape().clone()))
    }
}

/// Sums |a - b| over all pairs of values, in a fixed order that the compiler vectorises.
pub(super) fn total(a: &[f32], b: &[f32]) -> f64 {
    let mut sums = [0.0f64; 8];
    for (a, b) in a.chunks(8).zip(b.chunks(8)) {
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum += f64::from((a - b).abs());
        }
    }
    sums.iter().sum()
}

/// Returns `each` with the sign of a difference; 0 for 0, and NaN, which must propagate, for NaN.
pub(super) fn signed(difference: f32, each: f32) -> f32 {
    if difference > 0.0 {
        each
    } else if difference < 0.0 {
        -each
    } else {
        difference
    }
}

fn both<'a>(
    a: &'a CpuStorage,
    a_layout: &Layout,
    b: &'a CpuStorage,
    b_layout: &Layout,
) -> Result<[&'a [f32]; 2]> {
    if a_layout.dims() != b_layout.dims() {
        candle_core::bail!(
            "difference: {:?} and {:?} differ in shape",
            a_layout.dims(),
            b_layout.dims()
        );
    }
    Ok([values("difference", a, a_layout)?, values("difference", b, b_layout)?])
}
