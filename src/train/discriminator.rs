//! The conditional PatchGAN discriminator of Isola et al. (CVPR 2017), as Zhang et al. use it on (I, T).

use super::generator::{SLOPE, See, frozen, learning, numbered};
use super::ops::{NormOptions, Window, conv2d, norm_act};
use super::random::{RandomTensor, Stream};
use candle_core::{DType, Device, Result, Tensor, Var};

/// Output channels of the first four 4 x 4 convolutions, in multiples of the width. The fifth has one output channel.
const WIDTHS: [usize; 4] = [1, 2, 4, 8];

/// Strides of all five convolutions, px.
const STRIDES: [usize; 5] = [2, 2, 2, 1, 1];

const EPSILON: f64 = 1e-5;

/// The discriminator network, which returns 30 x 30 logits for 256 x 256 px.
pub struct Discriminator {
    kernels: Vec<Var>,
    /// Gains of the norms of the three middle layers.
    gains: Vec<Var>,
    offsets: Vec<Var>,
    slope: f32,
}

impl Discriminator {
    /// Draws kernels and gains with standard deviation 0.02 from a seed; the published width is 64.
    pub fn new(width: usize, seed: u64, name: &str) -> Result<Self> {
        let widths: Vec<usize> = WIDTHS.iter().map(|times| times * width).chain([1]).collect();
        let mut inputs = 6;
        let mut discriminator =
            Self { kernels: Vec::new(), gains: Vec::new(), offsets: Vec::new(), slope: SLOPE };
        for (layer, &outputs) in widths.iter().enumerate() {
            let mut stream = Stream::new(seed, &format!("{name} kernel.{layer}"));
            let kernel = stream.normal_tensor(&[outputs, inputs, 4, 4], 0.02)?;
            discriminator.kernels.push(Var::from_tensor(&kernel)?);
            if is_normed(layer) {
                let mut stream = Stream::new(seed, &format!("{name} gain.{layer}"));
                let gain = (stream.normal_tensor(&[outputs], 0.02)? + 1.0)?;
                discriminator.gains.push(Var::from_tensor(&gain)?);
                discriminator.offsets.push(Var::zeros(outputs, DType::F32, &Device::Cpu)?);
            }
            inputs = outputs;
        }
        Ok(discriminator)
    }

    /// Returns all trainable variables by name, in a fixed order.
    pub fn variables(&self) -> Vec<(String, Var)> {
        numbered(&[("kernel", &self.kernels), ("gain", &self.gains), ("offset", &self.offsets)])
    }

    /// Sets the slope of the leaky ReLU for negative numbers.
    #[must_use]
    pub fn with_slope(self, slope: f32) -> Self {
        Self { slope, ..self }
    }

    /// Computes logits (batch, 1, ...), above 0 if real, of an image and one of its layers, both (batch, 3, ...).
    pub fn forward(&self, image: &Tensor, layer_of_it: &Tensor) -> Result<Tensor> {
        self.forward_by(image, layer_of_it, learning)
    }

    /// Computes the logits with detached weights: gradients flow only to the images, which is cheaper.
    pub fn forward_frozen(&self, image: &Tensor, layer_of_it: &Tensor) -> Result<Tensor> {
        self.forward_by(image, layer_of_it, frozen)
    }

    fn forward_by(&self, image: &Tensor, layer_of_it: &Tensor, see: See) -> Result<Tensor> {
        let norm = NormOptions { epsilon: EPSILON, slope: self.slope };
        let mut x = Tensor::cat(&[image, layer_of_it], 1)?;
        let mut normed = self.gains.iter().zip(&self.offsets);
        for (layer, (kernel, stride)) in self.kernels.iter().zip(STRIDES).enumerate() {
            let window = Window { padding: 1, stride, dilation: 1 };
            x = conv2d(&x, &see(kernel), window)?;
            if is_normed(layer)
                && let Some((gain, offset)) = normed.next()
            {
                let gain = see(gain);
                let rows = [&gain.zeros_like()?, &gain, &see(offset)];
                x = norm_act(&x, &Tensor::stack(&rows, 0)?, norm)?;
            } else if layer == 0 {
                x = leaky(&x, self.slope)?;
            }
        }
        Ok(x)
    }
}

/// True for all layers except the first and the last.
fn is_normed(layer: usize) -> bool {
    (1..=3).contains(&layer)
}

/// Applies leaky ReLU with PyTorch's gradient at 0.
fn leaky(x: &Tensor, slope: f32) -> Result<Tensor> {
    let steep = x.gt(0.0)?.to_dtype(x.dtype())?;
    x * ((steep * f64::from(1.0 - slope))? + f64::from(slope))?
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_and_logits_have_the_published_sizes() {
        let discriminator = Discriminator::new(64, 1, "d").unwrap();
        let variables = discriminator.variables();
        let count: usize = variables.iter().map(|(_, v)| v.elem_count()).sum();
        let kernels = 16 * (6 * 64 + 64 * 128 + 128 * 256 + 256 * 512 + 512);
        assert_eq!(count, kernels + 2 * (128 + 256 + 512));
        let narrow = Discriminator::new(4, 1, "d").unwrap();
        let image = Tensor::zeros((1, 3, 256, 256), DType::F32, &Device::Cpu).unwrap();
        assert_eq!(narrow.forward(&image, &image).unwrap().dims(), [1, 1, 30, 30]);
    }
}
