//! Batch norm and leaky ReLU in one operation, with batch statistics.

use super::values;
use candle_core::{CpuStorage, CustomOp2, CustomOp3, Layout, Result, Shape, Tensor};
use rayon::prelude::*;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NormOptions {
    /// Constant added to the variance.
    pub epsilon: f64,
    /// Slope of leaky ReLU for numbers up to 0.
    pub slope: f32,
}

/// Computes `lrelu(a x + b norm(x) + c)` of a (batch, channels, rows, columns) f32 tensor. `coefficients` holds a, b
/// and c of every channel and has the shape (3, channels).
///
/// `norm(x)` is `(x - mean) / sqrt(variance + epsilon)`, with mean and variance over all pixels of a channel in the
/// batch. Zhang et al.'s adaptive norm has one a and one b for all channels; batch norm with gain and offset has a = 0.
pub fn norm_act(x: &Tensor, coefficients: &Tensor, options: NormOptions) -> Result<Tensor> {
    let (_, channels, _, _) = x.dims4()?;
    if coefficients.dims() != [3, channels] {
        candle_core::bail!(
            "norm_act: {:?} coefficients for {channels} channels, but (3, {channels}) are needed",
            coefficients.dims()
        );
    }
    x.contiguous()?.apply_op2(&coefficients.contiguous()?, NormAct(options))
}

/// Returns the means and the scales `1 / sqrt(variance + epsilon)` of the channels of a tensor (batch, channels, rows,
/// columns), each (channels).
pub fn channel_statistics(x: &Tensor, epsilon: f64) -> Result<[Tensor; 2]> {
    let (batch, channels, rows, columns) = x.dims4()?;
    let values: Vec<f32> = x.flatten_all()?.to_vec1()?;
    let found = statistics(&values, [batch, channels, rows * columns], epsilon);
    let (means, scales): (Vec<f32>, Vec<f32>) = found.into_iter().unzip();
    let tensor = |values| Tensor::from_vec(values, channels, x.device());
    Ok([tensor(means)?, tensor(scales)?])
}

/// Returns the mean and `1 / sqrt(variance + epsilon)` of each channel.
fn statistics(x: &[f32], [batch, channels, pixels]: [usize; 3], epsilon: f64) -> Vec<(f32, f32)> {
    let of = |channel: usize| {
        let (mut sum, mut squares) = (0.0, 0.0);
        for item in 0..batch {
            let plane = &x[(item * channels + channel) * pixels..][..pixels];
            let [of_plane, of_squares] = sums(plane, |[sum, squares], lane, value| {
                sum[lane] += value;
                squares[lane] += value * value;
            });
            sum += of_plane;
            squares += of_squares;
        }
        let count = (batch * pixels) as f64;
        let mean = sum / count;
        let variance = (squares / count - mean * mean).max(0.0);
        (mean as f32, (1.0 / (variance + epsilon).sqrt()) as f32)
    };
    (0..channels).into_par_iter().map(of).collect()
}

/// Sums over a plane: in f32 within groups of 1,024 values (in sixteen lanes), in f64 over the groups.
fn sums<const N: usize, T: Copy>(
    plane: &[T],
    add: impl Fn(&mut [[f32; 16]; N], usize, T),
) -> [f64; N] {
    let mut totals = [0.0; N];
    for thousand in plane.chunks(1024) {
        let mut lanes = [[0.0f32; 16]; N];
        for values in thousand.chunks(16) {
            for (lane, value) in values.iter().enumerate() {
                add(&mut lanes, lane, *value);
            }
        }
        for (total, lanes) in totals.iter_mut().zip(&lanes) {
            *total += lanes.iter().map(|v| f64::from(*v)).sum::<f64>();
        }
    }
    totals
}

struct NormAct(NormOptions);

impl CustomOp2 for NormAct {
    fn name(&self) -> &'static str {
        "norm-act"
    }

    fn cpu_fwd(
        &self,
        x: &CpuStorage,
        layout: &Layout,
        coefficients: &CpuStorage,
        coefficients_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let (batch, channels, rows, columns) = layout.shape().dims4()?;
        let pixels = rows * columns;
        let x = values("norm_act", x, layout)?;
        let coefficients = values("norm_act", coefficients, coefficients_layout)?;
        let statistics = statistics(x, [batch, channels, pixels], self.0.epsilon);
        let slope = self.0.slope;
        let mut out = vec![0.0; x.len()];
        let planes = out.par_chunks_exact_mut(pixels.max(1)).zip(x.par_chunks_exact(pixels.max(1)));
        planes.enumerate().for_each(|(plane, (out, x))| {
            let line = Line::new(coefficients, &statistics, plane % channels);
            for (out, x) in out.iter_mut().zip(x) {
                let z = line.at(*x);
                *out = if z > 0.0 { z } else { slope * z };
            }
        });
        Ok((CpuStorage::F32(out), layout.shape().clone()))
    }

    fn bwd(
        &self,
        x: &Tensor,
        coefficients: &Tensor,
        _result: &Tensor,
        gradient: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>)> {
        let (_, channels, ..) = x.dims4()?;
        let gradient = gradient.contiguous()?;
        let both = x.apply_op3_no_bwd(coefficients, &gradient, &NormActGradient(self.0))?;
        let count = x.elem_count();
        let of_x = both.narrow(0, 0, count)?.reshape(x.shape())?;
        let of_coefficients = both.narrow(0, count, 3 * channels)?.reshape((3, channels))?;
        Ok((Some(of_x), Some(of_coefficients)))
    }
}

/// The operation before ReLU, which is affine in x for each channel: `steepness x + offset`.
struct Line {
    steepness: f32,
    offset: f32,
}

impl Line {
    fn new(coefficients: &[f32], statistics: &[(f32, f32)], channel: usize) -> Self {
        let channels = statistics.len();
        let [a, b, c] = [0, 1, 2].map(|row| coefficients[row * channels + channel]);
        let (mean, inverse_deviation) = statistics[channel];
        Self { steepness: a + b * inverse_deviation, offset: c - b * mean * inverse_deviation }
    }

    fn at(&self, x: f32) -> f32 {
        self.steepness * x + self.offset
    }
}

/// Operation for the gradients of x and of the coefficients, concatenated.
struct NormActGradient(NormOptions);

impl CustomOp3 for NormActGradient {
    fn name(&self) -> &'static str {
        "norm-act-gradient"
    }

    fn cpu_fwd(
        &self,
        x: &CpuStorage,
        layout: &Layout,
        coefficients: &CpuStorage,
        coefficients_layout: &Layout,
        gradient: &CpuStorage,
        gradient_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let (batch, channels, rows, columns) = layout.shape().dims4()?;
        let pixels = rows * columns;
        let x = values("norm_act", x, layout)?;
        let coefficients = values("norm_act", coefficients, coefficients_layout)?;
        let gradient = values("norm_act", gradient, gradient_layout)?;
        let statistics = statistics(x, [batch, channels, pixels], self.0.epsilon);
        let slope = self.0.slope;
        let passed = |line: &Line, x: f32, gradient: f32| {
            if line.at(x) > 0.0 { gradient } else { slope * gradient }
        };
        // Returns the sums of e, e x and e norm(x), where e is the gradient before ReLU.
        let of_channel = |channel: usize| {
            let line = Line::new(coefficients, &statistics, channel);
            let (mean, inverse_deviation) = statistics[channel];
            let mut totals = [0.0; 3];
            for item in 0..batch {
                let start = (item * channels + channel) * pixels;
                let pairs: Vec<(f32, f32)> = x[start..][..pixels]
                    .iter()
                    .copied()
                    .zip(gradient[start..][..pixels].iter().copied())
                    .collect();
                let parts = sums(&pairs, |[all, by_x, by_norm], lane, (x, gradient)| {
                    let e = passed(&line, x, gradient);
                    all[lane] += e;
                    by_x[lane] += e * x;
                    by_norm[lane] += e * (x - mean) * inverse_deviation;
                });
                (0..3).for_each(|k| totals[k] += parts[k]);
            }
            totals
        };
        let totals: Vec<[f64; 3]> = (0..channels).into_par_iter().map(of_channel).collect();
        let mut out = vec![0.0; x.len() + 3 * channels];
        let (of_x, of_coefficients) = out.split_at_mut(x.len());
        let count = (batch * pixels) as f64;
        let planes = of_x.par_chunks_exact_mut(pixels.max(1));
        let planes = planes.zip(x.par_chunks_exact(pixels.max(1)));
        let planes = planes.zip(gradient.par_chunks_exact(pixels.max(1)));
        planes.enumerate().for_each(|(plane, ((out, x), gradient))| {
            let channel = plane % channels;
            let line = Line::new(coefficients, &statistics, channel);
            let (mean, inverse_deviation) = statistics[channel];
            let [a, b] = [0, 1].map(|row| coefficients[row * channels + channel]);
            let [all, _, by_norm] = totals[channel].map(|total| (total / count) as f32);
            let scale = b * inverse_deviation;
            for ((out, x), gradient) in out.iter_mut().zip(x).zip(gradient) {
                let e = passed(&line, *x, *gradient);
                let norm = (x - mean) * inverse_deviation;
                *out = a * e + scale * (e - all - norm * by_norm);
            }
        });
        for (channel, [all, by_x, by_norm]) in totals.into_iter().enumerate() {
            of_coefficients[channel] = by_x as f32;
            of_coefficients[channels + channel] = by_norm as f32;
            of_coefficients[2 * channels + channel] = all as f32;
        }
        let len = out.len();
        Ok((CpuStorage::F32(out), len.into()))
    }
}
