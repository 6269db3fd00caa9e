//! Tensors of random numbers.

use candle_core::{Device, Result, Tensor};
pub use compose::Stream;

/// Tensors that a [`Stream`] fills.
pub trait RandomTensor {
    /// Returns a tensor of normal numbers with mean 0 and the given standard deviation.
    fn normal_tensor(&mut self, shape: &[usize], deviation: f64) -> Result<Tensor>;

    /// Returns a tensor of uniform numbers from `-limit` to `limit`.
    fn uniform_tensor(&mut self, shape: &[usize], limit: f64) -> Result<Tensor>;
}

impl RandomTensor for Stream {
    fn normal_tensor(&mut self, shape: &[usize], deviation: f64) -> Result<Tensor> {
        let count: usize = shape.iter().product();
        let values: Vec<f32> = (0..count).map(|_| (self.normal() * deviation) as f32).collect();
        Tensor::from_vec(values, shape, &Device::Cpu)
    }

    fn uniform_tensor(&mut self, shape: &[usize], limit: f64) -> Result<Tensor> {
        let count: usize = shape.iter().product();
        let values: Vec<f32> =
            (0..count).map(|_| ((2.0 * self.unit() - 1.0) * limit) as f32).collect();
        Tensor::from_vec(values, shape, &Device::Cpu)
    }
}
