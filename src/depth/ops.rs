//! Layers of a transformer, faster than candle's: sums over rows are fused, and attention never stores the scores of all
//! tokens.

use rayon::prelude::*;
use train::candle_core::{CpuStorage, CustomOp1, CustomOp3, Layout, Result, Shape, Tensor, bail};
use train::ops::{Mat, MatMut, product, values};

/// Columns of a product that one thread computes.
const BLOCK_COLUMNS: usize = 192;
/// Queries whose scores are in memory together, for each thread.
const BLOCK_QUERIES: usize = 96;
/// Columns of a product of keys are a multiple of this: the largest vector.
const PADDING: usize = 16;
/// Added to the variance in a norm, as in DINOv2.
const EPSILON: f32 = 1e-6;

/// Computes x W + b of x (rows, in), W (in, out), b (out). Matrix products of rows need no copy of W in this order.
pub(crate) fn linear(x: &Tensor, weight: &Tensor, bias: &Tensor) -> Result<Tensor> {
    x.contiguous()?.apply_op3(weight, bias, OfThree("linear", linear_on_cpu::<false>))
}

/// Computes GELU(x W + b), with the error function.
pub(crate) fn linear_gelu(x: &Tensor, weight: &Tensor, bias: &Tensor) -> Result<Tensor> {
    x.contiguous()?.apply_op3(weight, bias, OfThree("linear", linear_on_cpu::<true>))
}

/// Normalises each row to mean 0 and variance 1, then multiplies by `weight` and adds `bias`.
pub(crate) fn layer_norm(x: &Tensor, weight: &Tensor, bias: &Tensor) -> Result<Tensor> {
    x.contiguous()?.apply_op3(weight, bias, OfThree("layer_norm", layer_norm_on_cpu))
}

/// Computes x + y * scale, with one scale for each column.
pub(crate) fn add_scaled(x: &Tensor, y: &Tensor, scale: &Tensor) -> Result<Tensor> {
    let y = y.contiguous()?;
    x.contiguous()?.apply_op3(&y, scale, OfThree("add_scaled", add_scaled_on_cpu))
}

/// Computes softmax(q k^T / sqrt(d)) v of each head, from rows of queries, keys and values (tokens, 3 width) to (tokens, width).
pub(crate) fn attention(qkv: &Tensor, heads: usize) -> Result<Tensor> {
    qkv.contiguous()?.apply_op1(Attention { heads })
}

/// An operation of three tensors: its name, and a function of their values and shapes.
struct OfThree(&'static str, fn([&[f32]; 3], [&Shape; 3]) -> Made);

/// Values of a tensor and their shape.
type Made = Result<(Vec<f32>, Shape)>;

impl CustomOp3 for OfThree {
    fn name(&self) -> &'static str {
        self.0
    }

    fn cpu_fwd(
        &self,
        a: &CpuStorage,
        of_a: &Layout,
        b: &CpuStorage,
        of_b: &Layout,
        c: &CpuStorage,
        of_c: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let [a, b, c] =
            [values(self.0, a, of_a)?, values(self.0, b, of_b)?, values(self.0, c, of_c)?];
        let (made, shape) = (self.1)([a, b, c], [of_a.shape(), of_b.shape(), of_c.shape()])?;
        Ok((CpuStorage::F32(made), shape))
    }
}

fn linear_on_cpu<const GELU: bool>(
    [x, weight, bias]: [&[f32]; 3],
    [of_x, of_weight, of_bias]: [&Shape; 3],
) -> Made {
    let ((rows, inner), (of, columns)) = (of_x.dims2()?, of_weight.dims2()?);
    if inner != of || of_bias.elem_count() != columns {
        bail!("linear: {of_weight:?} does not fit {of_x:?}");
    }
    let mut out = vec![0.0f32; rows * columns];
    let blocks = MatMut::column_blocks(&mut out, rows, columns, BLOCK_COLUMNS);
    let x = Mat::by_rows(x, rows, inner, inner);
    blocks.into_par_iter().enumerate().for_each(|(block, mut out)| {
        let first = block * BLOCK_COLUMNS;
        let matrix = Mat::by_rows(&weight[first..], inner, out.columns(), columns);
        product(&mut out, x, matrix, false);
    });
    let fused = is_fused();
    out.par_chunks_exact_mut(columns.max(1)).for_each(|row| {
        for (value, bias) in row.iter_mut().zip(bias) {
            *value += bias;
        }
        if GELU {
            gelu(fused, row);
        }
    });
    Ok((out, Shape::from((rows, columns))))
}

fn layer_norm_on_cpu([x, weight, bias]: [&[f32]; 3], [of_x, ..]: [&Shape; 3]) -> Made {
    let (_, columns) = of_x.dims2()?;
    let mut out = x.to_vec();
    out.par_chunks_exact_mut(columns.max(1)).for_each(|row| {
        let mean = sum(row, |value| value) / columns as f32;
        let variance = sum(row, |value| (value - mean) * (value - mean)) / columns as f32;
        let scale = 1.0 / (variance + EPSILON).sqrt();
        for ((value, weight), bias) in row.iter_mut().zip(weight).zip(bias) {
            *value = (*value - mean) * scale * weight + bias;
        }
    });
    Ok((out, of_x.clone()))
}

/// Adds the values of a function in eight interleaved sums.
fn sum(row: &[f32], of: impl Fn(f32) -> f32) -> f32 {
    let mut sums = [0.0f32; 8];
    for part in row.chunks(8) {
        for (sum, value) in sums.iter_mut().zip(part) {
            *sum += of(*value);
        }
    }
    sums.iter().sum()
}

fn add_scaled_on_cpu([x, y, scale]: [&[f32]; 3], [of_x, ..]: [&Shape; 3]) -> Made {
    let (_, columns) = of_x.dims2()?;
    let mut out = x.to_vec();
    let rows_of_y = y.par_chunks_exact(columns.max(1));
    out.par_chunks_exact_mut(columns.max(1)).zip(rows_of_y).for_each(|(row, y)| {
        for ((value, y), scale) in row.iter_mut().zip(y).zip(scale) {
            *value += y * scale;
        }
    });
    Ok((out, of_x.clone()))
}

struct Attention {
    heads: usize,
}

impl CustomOp1 for Attention {
    fn name(&self) -> &'static str {
        "attention"
    }

    fn cpu_fwd(&self, qkv: &CpuStorage, of_qkv: &Layout) -> Result<(CpuStorage, Shape)> {
        let (tokens, thrice) = of_qkv.shape().dims2()?;
        let width = thrice / 3;
        let size = width / self.heads;
        let qkv = values("attention", qkv, of_qkv)?;
        let fused = is_fused();
        let scale = 1.0 / (size as f32).sqrt();
        let part =
            |k: usize, head: usize, row: usize| &qkv[row * thrice + k * width + head * size..];
        // Keys of each head as columns, whole vectors of them: their product then needs no further copy.
        let padded = tokens.next_multiple_of(PADDING);
        let mut keys = vec![0.0f32; self.heads * size * padded];
        keys.par_chunks_exact_mut(size * padded).enumerate().for_each(|(head, keys)| {
            for token in 0..tokens {
                for (k, value) in part(1, head, token)[..size].iter().enumerate() {
                    keys[k * padded + token] = *value;
                }
            }
        });
        let tasks: Vec<(usize, usize)> = (0..self.heads)
            .flat_map(|head| (0..tokens).step_by(BLOCK_QUERIES).map(move |first| (head, first)))
            .collect();
        let made: Vec<Vec<f32>> = tasks
            .par_iter()
            .map_init(Vec::new, |scores, &(head, first)| {
                let count = BLOCK_QUERIES.min(tokens - first);
                let queries = Mat::by_rows(part(0, head, first), count, size, thrice);
                let keys = Mat::by_rows(&keys[head * size * padded..], size, padded, padded);
                let of_values = Mat::by_rows(part(2, head, 0), tokens, size, thrice);
                scores.resize(BLOCK_QUERIES * padded, 0.0f32);
                product(&mut MatMut::whole(scores, count, padded), queries, keys, false);
                let sums: Vec<f32> = scores
                    .chunks_exact_mut(padded)
                    .take(count)
                    .map(|row| exponentials(fused, &mut row[..tokens], scale))
                    .collect();
                let mut seen = vec![0.0f32; count * size];
                let weights = Mat::by_rows(scores, count, tokens, padded);
                product(&mut MatMut::whole(&mut seen, count, size), weights, of_values, false);
                for (row, sum) in seen.chunks_exact_mut(size).zip(sums) {
                    for value in row {
                        *value /= sum;
                    }
                }
                seen
            })
            .collect();
        let mut out = vec![0.0f32; tokens * width];
        for ((head, first), seen) in tasks.into_iter().zip(made) {
            for (row, values) in seen.chunks_exact(size).enumerate() {
                out[(first + row) * width + head * size..][..size].copy_from_slice(values);
            }
        }
        Ok((CpuStorage::F32(out), Shape::from((tokens, width))))
    }
}

/// True if the processor has the instructions of the fused functions.
fn is_fused() -> bool {
    #[cfg(target_arch = "x86_64")]
    return std::arch::is_x86_feature_detected!("avx2")
        && std::arch::is_x86_feature_detected!("fma");
    #[cfg(not(target_arch = "x86_64"))]
    false
}

/// Replaces each score s by exp((s - m) scale) with the largest score m. Returns their sum.
#[allow(unsafe_code, reason = "calls code of an instruction set that was detected")]
fn exponentials(fused: bool, row: &mut [f32], scale: f32) -> f32 {
    assert!(!fused || is_fused(), "the processor has no fused instructions");
    // SAFETY: the processor has AVX2 and FMA.
    if fused {
        unsafe { exponentials_avx2(row, scale) }
    } else {
        exponentials_of::<false>(row, scale)
    }
}

/// Replaces values x by x (1 + erf(x / sqrt 2)) / 2.
#[allow(unsafe_code, reason = "calls code of an instruction set that was detected")]
fn gelu(fused: bool, row: &mut [f32]) {
    assert!(!fused || is_fused(), "the processor has no fused instructions");
    // SAFETY: the processor has AVX2 and FMA.
    if fused { unsafe { gelu_avx2(row) } } else { gelu_of::<false>(row) }
}

#[allow(unsafe_code, reason = "an instruction set")]
#[cfg_attr(target_arch = "x86_64", target_feature(enable = "avx2,fma"))]
unsafe fn exponentials_avx2(row: &mut [f32], scale: f32) -> f32 {
    exponentials_of::<true>(row, scale)
}

#[allow(unsafe_code, reason = "an instruction set")]
#[cfg_attr(target_arch = "x86_64", target_feature(enable = "avx2,fma"))]
unsafe fn gelu_avx2(row: &mut [f32]) {
    gelu_of::<true>(row);
}

#[inline(always)]
fn exponentials_of<const FUSED: bool>(row: &mut [f32], scale: f32) -> f32 {
    let mut most = [f32::NEG_INFINITY; 16];
    for part in row.chunks_exact(16) {
        for (most, value) in most.iter_mut().zip(part) {
            *most = if *value > *most { *value } else { *most };
        }
    }
    let rest = row.chunks_exact(16).remainder();
    let most = most.iter().chain(rest).fold(f32::NEG_INFINITY, |a, b| a.max(*b));
    let mut sums = [0.0f32; 16];
    let mut parts = row.chunks_exact_mut(16);
    for part in &mut parts {
        for (sum, value) in sums.iter_mut().zip(part) {
            *value = exp::<FUSED>((*value - most) * scale);
            *sum += *value;
        }
    }
    for (sum, value) in sums.iter_mut().zip(parts.into_remainder()) {
        *value = exp::<FUSED>((*value - most) * scale);
        *sum += *value;
    }
    sums.iter().sum()
}

#[inline(always)]
fn gelu_of<const FUSED: bool>(row: &mut [f32]) {
    for value in row {
        *value = 0.5 * *value * (1.0 + erf::<FUSED>(*value * std::f32::consts::FRAC_1_SQRT_2));
    }
}

/// Computes a b + c, with one rounding if `FUSED`.
#[inline(always)]
fn add_product<const FUSED: bool>(a: f32, b: f32, c: f32) -> f32 {
    if FUSED { a.mul_add(b, c) } else { a * b + c }
}

/// Evaluates a polynomial; the first coefficient belongs to the highest power.
#[inline(always)]
fn polynomial<const FUSED: bool>(coefficients: &[f32], x: f32) -> f32 {
    let (first, rest) = coefficients.split_first().expect("a polynomial has coefficients");
    rest.iter().fold(*first, |sum, coefficient| add_product::<FUSED>(sum, x, *coefficient))
}

/// The error function within 2e-7 (Abramowitz and Stegun 7.1.26).
#[inline(always)]
fn erf<const FUSED: bool>(x: f32) -> f32 {
    const C: [f32; 6] = [1.061_405_4, -1.453_152, 1.421_413_7, -0.284_496_74, 0.254_829_6, 0.0];
    let size = x.abs();
    let t = 1.0 / (1.0 + 0.327_591_1 * size);
    let value = 1.0 - polynomial::<FUSED>(&C, t) * exp::<FUSED>(-size * size);
    f32::from_bits(value.to_bits() | (x.to_bits() & 0x8000_0000))
}

/// e^x for x up to 0, within 3e-7 of the result; less than 2e-38 below -87.
#[inline(always)]
fn exp<const FUSED: bool>(x: f32) -> f32 {
    const C: [f32; 7] = [0.001_398_2, 0.008_333_452, 0.041_665_796, 0.166_666_55, 0.5, 1.0, 1.0];
    // The sum with 1.5 * 2^23 rounds to the nearest whole number.
    const ROUND: f32 = 12_582_912.0;
    let x = if x < -87.0 { -87.0 } else { x };
    let rounded = add_product::<FUSED>(x, std::f32::consts::LOG2_E, ROUND);
    let whole = rounded - ROUND;
    // The logarithm of 2 in two parts.
    let rest = add_product::<FUSED>(whole, -0.693_359_4, x);
    let rest = add_product::<FUSED>(whole, 2.121_944_4e-4, rest);
    let exponent = (rounded.to_bits() << 23).wrapping_add(127 << 23);
    polynomial::<FUSED>(&C, rest) * f32::from_bits(exponent)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_are_near_those_of_libm() {
        for k in 0..200_000 {
            let x = -87.0 * k as f32 / 200_000.0;
            let exact = f64::from(x).exp();
            for found in [exp::<false>(x), exp::<true>(x)] {
                assert!((f64::from(found) / exact - 1.0).abs() < 3e-7, "{x}: {found} {exact}");
            }
        }
        assert!(exp::<true>(-200.0) < 2e-38);
        for (x, exact) in [(0.0, 0.0), (0.5, 0.520_499_9), (1.0, 0.842_700_8), (2.5, 0.999_593)] {
            for sign in [1.0, -1.0] {
                assert!((erf::<false>(sign * x) - sign * exact).abs() < 3e-7, "{x}");
                assert!((erf::<true>(sign * x) - sign * exact).abs() < 3e-7, "{x}");
            }
        }
    }

    #[test]
    fn instruction_sets_agree() {
        let values: Vec<f32> = (0..203).map(|k| ((k * 37) % 101) as f32 * 0.1 - 5.0).collect();
        let (mut plain, mut wide) = (values.clone(), values.clone());
        let a = exponentials(false, &mut plain, 0.5);
        let b = exponentials(is_fused(), &mut wide, 0.5);
        assert!((a / b - 1.0).abs() < 1e-6 && (plain.iter().sum::<f32>() / a - 1.0).abs() < 1e-6);
        assert_eq!(plain.iter().copied().fold(0.0, f32::max), 1.0);
        gelu(false, &mut plain);
        gelu(is_fused(), &mut wide);
        for (a, b) in plain.iter().zip(&wide) {
            assert!((a - b).abs() < 1e-6, "{a} {b}");
        }
    }
}
