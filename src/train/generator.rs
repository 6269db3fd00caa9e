//! The generator of Zhang, Ng and Chen (CVPR 2018), with a hypercolumn, dilated convolutions and adaptive norms. SP-net
//! and BT-net share the architecture.

use super::ops::{
    NormOptions, Sampling, Window, bilinear_at, channel_statistics, conv2d, norm_act,
};
use super::random::{RandomTensor, Stream};
use candle_core::{DType, Device, Result, Tensor, Var};
use plan::Start;

/// Dilation of each 3 x 3 convolution.
pub const DILATIONS: [usize; 8] = [1, 2, 4, 8, 16, 32, 64, 1];

const EPSILON: f64 = 1e-3;

/// Largest distance between an output pixel and the input pixels that change it, px, apart from features and norms.
pub(super) const REACH_PX: usize = 128;

/// Slope of the leaky ReLU for negative numbers (Zhang et al.).
pub const SLOPE: f32 = 0.2;

#[derive(Clone, Debug, PartialEq)]
pub struct GeneratorOptions {
    /// Number of hidden channels; 64 in the paper.
    pub width: usize,
    /// Number of output channels: 6 for SP-net (T*, R~*), 3 for BT-net (R*).
    pub outputs: usize,
    /// Numbers of channels of the input features, finest first; empty without a feature network.
    pub features: Vec<usize>,
    /// Positions of pixels in resized features.
    pub sampling: Sampling,
    pub start: Start,
    /// Slope of the leaky ReLU, usually [`SLOPE`]. With 1, the network is linear except for its norms.
    pub slope: f32,
}

pub struct Generator {
    /// The first kernel is (width, inputs, 1, 1); its inputs are the features, coarsest first, and then RGB. The others
    /// are (width, width, 3, 3).
    kernels: Vec<Var>,
    /// Parameters of each layer's adaptive norm, `by_itself x + by_norm (norm(x) + offset)`.
    by_itself: Vec<Var>,
    by_norm: Vec<Var>,
    offsets: Vec<Var>,
    last: Var,
    last_bias: Var,
    sampling: Sampling,
    norm: NormOptions,
    /// True if the first three outputs are added to the images.
    is_residual: bool,
}

impl Generator {
    /// Initialises the weights from a seed; `name` separates the random streams of networks.
    pub fn new(options: &GeneratorOptions, seed: u64, name: &str) -> Result<Self> {
        let width = options.width;
        let inputs = options.features.iter().sum::<usize>() + 3;
        let mut generator = Self {
            kernels: Vec::new(),
            by_itself: Vec::new(),
            by_norm: Vec::new(),
            offsets: Vec::new(),
            last: Var::zeros((options.outputs, width, 1, 1), DType::F32, &Device::Cpu)?,
            last_bias: Var::zeros(options.outputs, DType::F32, &Device::Cpu)?,
            sampling: options.sampling,
            norm: NormOptions { epsilon: EPSILON, slope: options.slope },
            is_residual: options.start == Start::Residual,
        };
        for layer in 0..=DILATIONS.len() {
            let (channels, size) = if layer == 0 { (inputs, 1) } else { (width, 3) };
            let shape = [width, channels, size, size];
            let kernel = match options.start {
                Start::Identity | Start::Residual => identity(shape)?,
                Start::Random => {
                    let deviation = (2.0 / (channels * size * size) as f64).sqrt();
                    let mut stream = Stream::new(seed, &format!("{name} kernel.{layer}"));
                    stream.normal_tensor(&shape, deviation)?
                }
            };
            generator.kernels.push(Var::from_tensor(&kernel)?);
            generator.by_itself.push(Var::ones(1, DType::F32, &Device::Cpu)?);
            generator.by_norm.push(Var::zeros(1, DType::F32, &Device::Cpu)?);
            generator.offsets.push(Var::zeros(width, DType::F32, &Device::Cpu)?);
        }
        if generator.is_residual {
            return Ok(generator);
        }
        // Initialisation of Glorot and Bengio, as in Zhang et al.
        let deviation = (2.0 / (width + options.outputs) as f64).sqrt();
        let mut stream = Stream::new(seed, &format!("{name} last"));
        let last = stream.normal_tensor(&[options.outputs, width, 1, 1], deviation)?;
        generator.last.set(&last)?;
        Ok(generator)
    }

    /// Returns all trainable variables by name, in a fixed order.
    pub fn variables(&self) -> Vec<(String, Var)> {
        let mut variables = numbered(&[
            ("kernel", &self.kernels),
            ("by_itself", &self.by_itself),
            ("by_norm", &self.by_norm),
            ("offset", &self.offsets),
        ]);
        variables.push(("last".to_owned(), self.last.clone()));
        variables.push(("last_bias".to_owned(), self.last_bias.clone()));
        variables
    }

    /// Computes the output (batch, outputs, rows, columns), not clamped, from sRGB-coded images (batch, 3, rows,
    /// columns) and their features, finest first.
    pub fn forward(&self, images: &Tensor, features: &[Tensor]) -> Result<Tensor> {
        self.forward_by(images, features, learning, &mut Norms::Batch)
    }

    /// Computes the output with detached weights, which receive no gradients.
    pub fn forward_frozen(
        &self,
        images: &Tensor,
        features: &[Tensor],
        norms: &mut Norms,
    ) -> Result<Tensor> {
        self.forward_by(images, features, frozen, norms)
    }

    fn forward_by(
        &self,
        images: &Tensor,
        features: &[Tensor],
        see: See,
        norms: &mut Norms,
    ) -> Result<Tensor> {
        let mut x = self.first(images, features, see)?;
        x = self.norm(0, &x, see, norms)?;
        for (layer, dilation) in DILATIONS.into_iter().enumerate() {
            let kernel = see(&self.kernels[layer + 1]);
            x = conv2d(&x, &kernel, Window::same(3, dilation))?;
            x = self.norm(layer + 1, &x, see, norms)?;
        }
        let out = conv2d(&x, &see(&self.last), Window::same(1, 1))?;
        let out = out.broadcast_add(&see(&self.last_bias).reshape((1, (), 1, 1))?)?;
        if !self.is_residual {
            return Ok(out);
        }
        let more = out.dim(1)? - images.dim(1)?;
        out + images.pad_with_zeros(1, 0, more)?
    }

    /// Computes the 1 x 1 convolution of the hypercolumn. The convolution commutes with resizing, so each feature is
    /// convolved at its own size, and no full-size tensor of all channels is needed.
    fn first(&self, images: &Tensor, features: &[Tensor], see: See) -> Result<Tensor> {
        let (_, _, rows, columns) = images.dims4()?;
        let mut start = 0;
        let mut sum: Option<Tensor> = None;
        for part in features.iter().rev().chain([images]) {
            let channels = part.dim(1)?;
            let kernel = see(&self.kernels[0]).narrow(1, start, channels)?;
            start += channels;
            let out = conv2d(part, &kernel, Window::same(1, 1))?;
            let out = bilinear_at(&out, rows, columns, self.sampling)?;
            sum = Some(match sum {
                None => out,
                Some(sum) => (sum + out)?,
            });
        }
        sum.ok_or_else(|| candle_core::Error::Msg("generator: no image".to_owned()))
    }

    fn norm(&self, layer: usize, x: &Tensor, see: See, norms: &mut Norms) -> Result<Tensor> {
        let channels = x.dim(1)?;
        let by_itself = see(&self.by_itself[layer]).broadcast_as(channels)?.contiguous()?;
        let by_norm = see(&self.by_norm[layer]).broadcast_as(channels)?.contiguous()?;
        let offset = by_norm.mul(&see(&self.offsets[layer]))?;
        let coefficients = match norms {
            Norms::Given(statistics) => {
                // norm(x) is (x - mean) scale, so the layer is linear before its leaky ReLU.
                let [mean, scale] = &statistics.0[layer];
                let scale = by_norm.mul(scale)?;
                let offset = (offset - mean.mul(&scale)?)?;
                [(by_itself + scale)?, by_norm.zeros_like()?, offset]
            }
            Norms::Record(statistics) => {
                statistics.0.push(channel_statistics(x, self.norm.epsilon)?);
                [by_itself, by_norm, offset]
            }
            Norms::Batch => [by_itself, by_norm, offset],
        };
        norm_act(x, &Tensor::stack(&coefficients, 0)?, self.norm)
    }
}

/// Means and scales `1 / sqrt(variance + epsilon)` of the channels of each layer, over the pixels of an image.
#[derive(Default)]
pub struct Statistics(Vec<[Tensor; 2]>);

/// Source of the statistics with which a pass normalises.
pub enum Norms<'a> {
    /// The batch itself, as in training.
    Batch,
    /// The batch itself; they are also added to these.
    Record(&'a mut Statistics),
    /// Those of another pass, so that parts of an image are normalised like the whole.
    Given(&'a Statistics),
}

/// Returns the variables of all lists, each with the name `LIST.INDEX`.
pub(super) fn numbered(lists: &[(&str, &Vec<Var>)]) -> Vec<(String, Var)> {
    let mut named = Vec::new();
    for (name, list) in lists {
        named.extend(list.iter().enumerate().map(|(k, v)| (format!("{name}.{k}"), v.clone())));
    }
    named
}

/// Function that reads a weight in a forward pass, with or without gradients to the weight.
pub(super) type See = fn(&Var) -> Tensor;

/// Reads a weight so that gradients flow to it.
pub(super) fn learning(weight: &Var) -> Tensor {
    weight.as_tensor().clone()
}

pub(super) fn frozen(weight: &Var) -> Tensor {
    weight.detach()
}

/// Returns a kernel that copies each input channel to the output channel of the same index.
fn identity([outputs, inputs, rows, columns]: [usize; 4]) -> Result<Tensor> {
    let mut values = vec![0.0f32; outputs * inputs * rows * columns];
    for channel in 0..outputs.min(inputs) {
        let plane = (channel * inputs + channel) * rows * columns;
        values[plane + rows / 2 * columns + columns / 2] = 1.0;
    }
    Tensor::from_vec(values, (outputs, inputs, rows, columns), &Device::Cpu)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options(outputs: usize, start: Start) -> GeneratorOptions {
        GeneratorOptions {
            width: 64,
            outputs,
            features: vec![64, 128, 256, 512, 512],
            sampling: Sampling::Centres,
            start,
            slope: SLOPE,
        }
    }

    #[test]
    fn generators_have_the_published_number_of_weights() {
        let count = |outputs| {
            let generator = Generator::new(&options(outputs, Start::Identity), 1, "g").unwrap();
            let variables = generator.variables();
            variables.iter().map(|(_, v)| v.elem_count()).sum::<usize>()
        };
        let layers = 64 * 1475 + 8 * 64 * 64 * 9 + 9 * (64 + 2);
        assert_eq!(count(6), layers + 6 * 65);
        assert_eq!(count(3), layers + 3 * 65);
    }

    #[test]
    fn residual_generators_begin_as_the_identity() {
        let image = Stream::new(1, "image").normal_tensor(&[1, 3, 9, 8], 1.0).unwrap();
        let numbers = |t: &Tensor| t.flatten_all().unwrap().to_vec1::<f32>().unwrap();
        for outputs in [3, 6] {
            let options = GeneratorOptions {
                width: 4,
                features: Vec::new(),
                ..options(outputs, Start::Residual)
            };
            let made = Generator::new(&options, 1, "g").unwrap();
            let made = numbers(&made.forward(&image, &[]).unwrap());
            let mut expected = numbers(&image);
            expected.resize(made.len(), 0.0);
            assert_eq!(made, expected);
        }
    }

    #[test]
    fn identity_kernels_copy_the_first_channels() {
        let kernel = identity([2, 3, 3, 3]).unwrap();
        let image = Stream::new(1, "image").normal_tensor(&[1, 3, 5, 6], 1.0).unwrap();
        let passed = conv2d(&image, &kernel, Window::same(3, 1)).unwrap();
        let numbers = |t: &Tensor| t.flatten_all().unwrap().to_vec1::<f32>().unwrap();
        assert_eq!(numbers(&passed), numbers(&image.narrow(1, 0, 2).unwrap()));
    }
}
