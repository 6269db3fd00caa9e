//! A small residual U-Net for T* alone. It works at half of the size, on 2 x 2 px as channels, and has no norms, so that
//! a pixel's result depends on its neighbourhood alone.

use super::generator::{See, frozen, learning, numbered};
use super::ops::buffers::Buffers;
use super::random::{RandomTensor, Stream};
use super::unet_op::{Layer, UnetOp};
use candle_core::{DType, Device, Result, Tensor, Var};
use std::sync::Arc;

/// Slope of the leaky ReLU for negative numbers.
const SLOPE: f32 = 0.1;

/// Widths of the five sizes, 1/2 to 1/32 of the image, as multiples of the width.
const WIDTHS: [usize; 5] = [1, 2, 3, 4, 4];

/// Factor between the image and the smallest size.
pub(super) const MULTIPLE: usize = 32;

/// Largest distance between an output pixel and the input pixels that change it, px: two convolutions at each size, down
/// and up, the last convolution, and the rest of the largest cell.
pub(super) const REACH_PX: usize = 2 * (2 + 4 + 8 + 16) * 2 + 2 * 32 + 2 + (MULTIPLE - 1);

/// Number of channels of 2 x 2 px of R, G, B.
const CHANNELS: usize = 12;

/// Two 3 x 3 convolutions with leaky ReLU for each size on the way down and, but for the smallest, on the way up; then a
/// 3 x 3 convolution to the residual.
pub struct Unet {
    /// In the order of use, each (outputs, inputs, 3, 3).
    kernels: Vec<Var>,
    biases: Vec<Var>,
    last: Var,
    last_bias: Var,
    /// Layers of [`UnetOp`].
    layers: Arc<Vec<Layer>>,
    /// Memory of the images of training steps.
    buffers: Arc<Buffers>,
}

impl Unet {
    /// Initialises the weights from a seed as PyTorch's `Conv2d` does, uniform within +-1 / sqrt(inputs), and the last
    /// convolution with zeros: T* = I. `name` separates the random streams of networks.
    pub fn new(width: usize, seed: u64, name: &str) -> Result<Self> {
        let widths = WIDTHS.map(|factor| factor * width);
        let layers = layers(widths);
        let mut net = Self {
            kernels: Vec::new(),
            biases: Vec::new(),
            last: Var::zeros((CHANNELS, widths[0], 3, 3), DType::F32, &Device::Cpu)?,
            last_bias: Var::zeros(CHANNELS, DType::F32, &Device::Cpu)?,
            layers: Arc::new(layers),
            buffers: Arc::new(Buffers::reused()),
        };
        let before_last = net.layers.len() - 1;
        for (layer, at) in net.layers[..before_last].iter().enumerate() {
            let shape = [at.outputs, at.inputs.iter().sum(), 3, 3];
            let limit = 1.0 / ((shape[1] * shape[2] * shape[3]) as f64).sqrt();
            let uniform = |what: &str, dims: &[usize]| {
                let mut stream = Stream::new(seed, &format!("{name} {what}.{layer}"));
                Var::from_tensor(&stream.uniform_tensor(dims, limit)?)
            };
            net.kernels.push(uniform("kernel", &shape)?);
            net.biases.push(uniform("bias", &shape[..1])?);
        }
        Ok(net)
    }

    /// Returns all trainable variables by name, in a fixed order.
    pub fn variables(&self) -> Vec<(String, Var)> {
        let mut variables = numbered(&[("kernel", &self.kernels), ("bias", &self.biases)]);
        variables.push(("last".to_owned(), self.last.clone()));
        variables.push(("last_bias".to_owned(), self.last_bias.clone()));
        variables
    }

    /// Computes T* (batch, 3, rows, columns), not clamped, from sRGB-coded images of any size.
    pub fn forward(&self, images: &Tensor) -> Result<Tensor> {
        self.forward_by(images, learning)
    }

    /// Computes T* with detached weights, which receive no gradients.
    pub fn forward_frozen(&self, images: &Tensor) -> Result<Tensor> {
        self.forward_by(images, frozen)
    }

    fn forward_by(&self, images: &Tensor, see: See) -> Result<Tensor> {
        let weights: Vec<Tensor> = self
            .variables()
            .iter()
            .map(|(_, variable)| see(variable).flatten_all())
            .collect::<Result<_>>()?;
        let weights = Tensor::cat(&weights, 0)?;
        let op = if weights.track_op() {
            UnetOp::with_gradient(&self.layers, &self.buffers)
        } else {
            UnetOp::new(&self.layers)
        };
        images.contiguous()?.apply_op2(&weights, op)
    }
}

/// Returns the layers for the widths of the five sizes. Their weights are in the order of [`Unet::variables`]: kernels,
/// biases, last kernel, last bias.
fn layers(widths: [usize; 5]) -> Vec<Layer> {
    let mut layers = Vec::new();
    let mut add = |inputs: &[usize], outputs: usize, slope: f32| {
        layers.push(Layer { outputs, inputs: inputs.to_vec(), slope, kernel_at: 0, bias_at: 0 });
    };
    let mut two = |inputs: &[usize], outputs: usize| {
        add(inputs, outputs, SLOPE);
        add(&[outputs], outputs, SLOPE);
    };
    two(&[CHANNELS], widths[0]);
    for pair in widths.windows(2) {
        two(&pair[..1], pair[1]);
    }
    for pair in widths.windows(2).rev() {
        two(&[pair[1], pair[0]], pair[0]);
    }
    add(&[widths[0]], CHANNELS, 1.0);
    let before_last = layers.len() - 1;
    let mut at = 0;
    for part in [0..before_last, before_last..before_last + 1] {
        for layer in &mut layers[part.clone()] {
            layer.kernel_at = at;
            at += 9 * layer.outputs * layer.inputs.iter().sum::<usize>();
        }
        for layer in &mut layers[part] {
            layer.bias_at = at;
            at += layer.outputs;
        }
    }
    layers
}

#[cfg(test)]
mod tests {
    use super::super::ops::reference::{double_and_join, pad_to_multiple, shuffle2, unshuffle2};
    use super::super::ops::{Window, conv2d_bias_leaky, mean_pool2};
    use super::*;

    fn numbers(tensor: &Tensor) -> Vec<f32> {
        tensor.flatten_all().unwrap().to_vec1().unwrap()
    }

    #[test]
    fn the_untrained_network_is_the_identity_at_every_size() {
        let net = Unet::new(4, 1, "net").unwrap();
        for shape in [[2, 3, 32, 64], [1, 3, 17, 45]] {
            let images = Stream::new(1, "image").normal_tensor(&shape, 1.0).unwrap();
            assert_eq!(numbers(&net.forward(&images).unwrap()), numbers(&images));
        }
    }

    /// Returns a network whose last layer is not 0, and images of odd sizes.
    fn busy_net(width: usize) -> (Unet, Tensor) {
        let net = Unet::new(width, 1, "net").unwrap();
        let mut stream = Stream::new(1, "last");
        let last = stream.uniform_tensor(net.last.dims(), 0.1).unwrap();
        net.last.set(&last).unwrap();
        (net, stream.normal_tensor(&[3, 3, 37, 70], 0.3).unwrap())
    }

    /// Computes T* by one operation for each layer.
    fn by_layers(net: &Unet, images: &Tensor) -> Result<Tensor> {
        let (_, _, rows, columns) = images.dims4()?;
        let window = Window::same(3, 1);
        let mut layers = net.kernels.iter().zip(&net.biases);
        let mut two = |x: &Tensor| -> Result<Tensor> {
            layers.by_ref().take(2).try_fold(x.clone(), |x, (kernel, bias)| {
                conv2d_bias_leaky(&x, kernel.as_tensor(), bias.as_tensor(), window, SLOPE)
            })
        };
        let padded = pad_to_multiple(images, MULTIPLE)?;
        let mut x = two(&unshuffle2(&(padded - 0.5)?)?)?;
        let mut skips = Vec::new();
        for _ in 1..WIDTHS.len() {
            let smaller = two(&mean_pool2(&x)?)?;
            skips.push(x);
            x = smaller;
        }
        while let Some(skip) = skips.pop() {
            x = two(&double_and_join(&x, &skip)?)?;
        }
        let residual = conv2d_bias_leaky(&x, &net.last, &net.last_bias, window, 1.0)?;
        let residual = shuffle2(&residual)?.narrow(2, 0, rows)?.narrow(3, 0, columns)?;
        images + residual
    }

    #[test]
    fn one_operation_equals_its_layers_and_so_do_gradients() {
        for width in [3, 16, 20] {
            let (net, images) = busy_net(width);
            let of = |y: Tensor| {
                let gradients = y.sqr().unwrap().sum_all().unwrap().backward().unwrap();
                let of = |(_, v): (String, Var)| numbers(gradients.get(&v).unwrap());
                (numbers(&y), net.variables().into_iter().map(of).collect::<Vec<_>>())
            };
            let (y, gradients) = of(net.forward(&images).unwrap());
            let (expected, of_layers) = of(by_layers(&net, &images).unwrap());
            let off = |a: &[f32], b: &[f32]| {
                let length = |v: f64, w: &f32| v + f64::from(*w) * f64::from(*w);
                let d: Vec<f32> = a.iter().zip(b).map(|(a, b)| a - b).collect();
                (d.iter().fold(0.0, length) / b.iter().fold(0.0, length)).sqrt()
            };
            assert!(off(&y, &expected) < 1e-6, "width {width}");
            for (k, (found, expected)) in gradients.iter().zip(&of_layers).enumerate() {
                assert!(
                    off(found, expected) < 2e-4,
                    "width {width}, {k}: {}",
                    off(found, expected)
                );
            }
            assert_eq!(numbers(&net.forward_frozen(&images).unwrap()), y);
        }
    }

    #[test]
    fn results_do_not_depend_on_the_number_of_threads() {
        let (net, images) = busy_net(4);
        let of = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let y = net.forward(&images).unwrap();
                let gradients = y.sqr().unwrap().sum_all().unwrap().backward().unwrap();
                (numbers(&y), numbers(gradients.get(&net.kernels[2]).unwrap()))
            })
        };
        assert!(of(1) == of(3));
    }

    #[test]
    fn steps_use_the_memory_of_earlier_steps() {
        let (net, images) = busy_net(4);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let waiting: Vec<usize> = (0..3)
            .map(|_| {
                pool.install(|| {
                    let y = net.forward(&images).unwrap();
                    y.sqr().unwrap().sum_all().unwrap().backward().unwrap();
                });
                net.buffers.waiting()
            })
            .collect();
        assert!(waiting[0] > 0);
        assert_eq!(waiting, [waiting[0]; 3]);
    }

    #[test]
    fn the_network_has_the_stated_number_of_weights() {
        let net = Unet::new(16, 1, "net").unwrap();
        let count: usize = net.variables().iter().map(|(_, v)| v.elem_count()).sum();
        assert_eq!(count, 414_348);
        let other = Unet::new(16, 2, "net").unwrap();
        assert_ne!(numbers(&net.kernels[3]), numbers(&other.kernels[3]));
        let limit = 1.0 / (9.0f32 * 32.0).sqrt();
        let kernel = numbers(&net.kernels[3]);
        assert!(kernel.iter().all(|w| w.abs() <= limit));
        assert!(kernel.iter().any(|w| *w > 0.99 * limit));
    }
}
