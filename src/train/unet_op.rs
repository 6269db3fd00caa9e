//! The U-Net as one operation, with its own gradient. It is several times as fast as its layers as separate
//! operations: images stay in the layout of `ops/direct.rs`, and candle stores and adds no gradients between layers.

use super::ops::buffers::Buffers;
use super::ops::direct::{add_kernel_gradient, convolve};
use super::ops::image::{Image, Kernel};
use super::ops::values;
use super::unet_images::{
    doubled, each_residual, gather, joined, parted, pooled, through_leaky, unshuffled,
};
use candle_core::{CpuStorage, CustomOp2, Layout, Result, Shape, Tensor};
use rayon::prelude::*;
use std::sync::{Arc, OnceLock};

/// Largest number of partial sums of the weights' gradients, each over consecutive images of the batch.
const SUMS: usize = 4;

/// One convolution of the network.
#[derive(Clone, Debug)]
pub(super) struct Layer {
    pub(super) outputs: usize,
    /// Number of input channels of each joined image.
    pub(super) inputs: Vec<usize>,
    /// Slope for negative results.
    pub(super) slope: f32,
    /// Places of the kernel (outputs, inputs, 3, 3) and of the bias among all weights.
    pub(super) kernel_at: usize,
    pub(super) bias_at: usize,
}

impl Layer {
    /// Returns the channel of each input in an [`Image`], whose parts are padded to multiples of 16.
    fn places(&self) -> Vec<usize> {
        let mut first = 0;
        let mut places = Vec::new();
        for count in &self.inputs {
            places.extend(first..first + count);
            first += count.next_multiple_of(16);
        }
        places
    }

    fn padded_inputs(&self) -> usize {
        self.inputs.iter().map(|count| count.next_multiple_of(16)).sum()
    }

    /// Calls `with` with the place of each weight of the kernel among all, its row and column, output and input channel.
    fn each_weight(&self, mut with: impl FnMut(usize, [usize; 2], usize, usize)) {
        let places = self.places();
        let mut at = self.kernel_at;
        for output in 0..self.outputs {
            for place in &places {
                for y in 0..3 {
                    for x in 0..3 {
                        with(at, [y, x], output, *place);
                        at += 1;
                    }
                }
            }
        }
    }

    fn kernel(&self, weights: &[f32]) -> Kernel {
        let mut kernel = Kernel::zeros(self.padded_inputs(), self.outputs);
        self.each_weight(|at, pixel, output, input| {
            let place = kernel.index(pixel, input, output);
            kernel.values[place] = weights[at];
        });
        kernel
    }

    /// Returns the kernel rotated by 180 degrees, with inputs and outputs exchanged.
    fn turned_kernel(&self, weights: &[f32]) -> Kernel {
        let mut kernel = Kernel::zeros(self.outputs, self.padded_inputs());
        self.each_weight(|at, [y, x], output, input| {
            let place = kernel.index([2 - y, 2 - x], output, input);
            kernel.values[place] = weights[at];
        });
        kernel
    }

    fn bias(&self, weights: &[f32]) -> Vec<f32> {
        let mut bias = weights[self.bias_at..][..self.outputs].to_vec();
        bias.resize(self.outputs.next_multiple_of(16), 0.0);
        bias
    }
}

/// Origin of an image of the network. Numbers are those of earlier images.
#[derive(Clone, Copy, Debug)]
enum Made {
    Given,
    Convolved { layer: usize, image: usize },
    Pooled { image: usize },
    Joined { image: usize, skip: usize },
}

/// The images of the network for one image of the batch, in the order of their making.
type Tape = Vec<(Made, Image)>;

/// Operation for T* (batch, 3, rows, columns), not clamped, from sRGB-coded images and all weights, one after the other.
/// The images get no gradient.
pub(super) struct UnetOp {
    /// Layers in the order of use, two for each size and one more.
    layers: Arc<Vec<Layer>>,
    /// The images of the forward pass, if the operation needs a gradient.
    kept: Option<Arc<Kept>>,
}

/// The images of a forward pass, whose memory returns to the buffers with the last user.
struct Kept {
    tapes: OnceLock<Vec<Tape>>,
    buffers: Arc<Buffers>,
}

impl Drop for Kept {
    fn drop(&mut self) {
        for (_, image) in self.tapes.take().into_iter().flatten().flatten() {
            self.buffers.put(image.values);
        }
    }
}

impl UnetOp {
    /// Creates the operation of one forward pass, whose weights get no gradient.
    pub(super) fn new(layers: &Arc<Vec<Layer>>) -> Self {
        Self { layers: Arc::clone(layers), kept: None }
    }

    /// Creates the operation of one forward pass and one backward pass.
    pub(super) fn with_gradient(layers: &Arc<Vec<Layer>>, buffers: &Arc<Buffers>) -> Self {
        let kept = Kept { tapes: OnceLock::new(), buffers: Arc::clone(buffers) };
        Self { layers: Arc::clone(layers), kept: Some(Arc::new(kept)) }
    }

    /// Computes the images of the network. Without a gradient, images that are used up become empty.
    fn forward(&self, kernels: &[(Kernel, Vec<f32>)], given: Image, buffers: &Buffers) -> Tape {
        let mut tape: Tape = vec![(Made::Given, given)];
        let keeps = self.kept.is_some();
        let mut layer = 0;
        let mut convolved = |tape: &mut Tape, skips: &[usize]| {
            let (kernel, bias) = &kernels[layer];
            let image = tape.len() - 1;
            let out = convolve(&tape[image].1, kernel, bias, self.layers[layer].slope, buffers);
            if !keeps && !skips.contains(&image) {
                tape[image].1.values = Vec::new();
            }
            tape.push((Made::Convolved { layer, image }, out));
            layer += 1;
        };
        let sizes = self.layers.len() / 4;
        let mut skips = Vec::new();
        convolved(&mut tape, &skips);
        convolved(&mut tape, &skips);
        for _ in 0..sizes {
            let image = tape.len() - 1;
            skips.push(image);
            tape.push((Made::Pooled { image }, pooled(&tape[image].1, buffers)));
            convolved(&mut tape, &skips);
            convolved(&mut tape, &skips);
        }
        while let Some(skip) = skips.pop() {
            let image = tape.len() - 1;
            let whole = joined(&tape[image].1, &tape[skip].1, buffers);
            tape.push((Made::Joined { image, skip }, whole));
            if !keeps {
                tape[image].1.values = Vec::new();
                tape[skip].1.values = Vec::new();
            }
            convolved(&mut tape, &skips);
            convolved(&mut tape, &skips);
        }
        convolved(&mut tape, &skips);
        tape
    }
}

/// Returns the last image of a tape: the residual.
fn last(tape: &Tape) -> &Image {
    &tape[tape.len() - 1].1
}

impl CustomOp2 for UnetOp {
    fn name(&self) -> &'static str {
        "unet"
    }

    fn cpu_fwd(
        &self,
        images: &CpuStorage,
        layout: &Layout,
        weights: &CpuStorage,
        weights_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let (_, channels, rows, columns) = layout.shape().dims4()?;
        let images = values("unet", images, layout)?;
        let weights = values("unet", weights, weights_layout)?;
        if channels != 3 || images.is_empty() {
            candle_core::bail!("unet: the images are {:?}, not (batch, 3, ...)", layout.dims());
        }
        let kernels: Vec<(Kernel, Vec<f32>)> =
            self.layers.iter().map(|layer| (layer.kernel(weights), layer.bias(weights))).collect();
        let len = 3 * rows * columns;
        let mut out = images.to_vec();
        let multiple = 2 << (self.layers.len() / 4);
        let freed = Buffers::default();
        let buffers = self.kept.as_ref().map_or(&freed, |kept| &kept.buffers);
        let tapes: Vec<Tape> = out
            .par_chunks_exact_mut(len)
            .zip(images.par_chunks_exact(len))
            .map(|(out, image)| {
                let given = unshuffled(image, [rows, columns], multiple, buffers);
                let tape = self.forward(&kernels, given, buffers);
                each_residual(last(&tape), [rows, columns], |at, residual| out[at] += residual);
                tape
            })
            .collect();
        if let Some(kept) = &self.kept {
            // Each operation has one forward pass.
            let _ = kept.tapes.set(tapes);
        }
        Ok((CpuStorage::F32(out), layout.shape().clone()))
    }

    fn bwd(
        &self,
        _images: &Tensor,
        weights: &Tensor,
        _result: &Tensor,
        gradient: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>)> {
        let Some(kept) = &self.kept else {
            candle_core::bail!("unet: the forward pass kept no images for a gradient");
        };
        let op = Backward { layers: Arc::clone(&self.layers), kept: Arc::clone(kept) };
        let of_weights = gradient.contiguous()?.apply_op2_no_bwd(weights, &op)?;
        Ok((None, Some(of_weights)))
    }
}

/// Operation for the gradient of all weights, from the gradient of T* and the weights.
struct Backward {
    layers: Arc<Vec<Layer>>,
    kept: Arc<Kept>,
}

impl CustomOp2 for Backward {
    fn name(&self) -> &'static str {
        "unet-gradient"
    }

    fn cpu_fwd(
        &self,
        gradient: &CpuStorage,
        layout: &Layout,
        weights: &CpuStorage,
        weights_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let (_, _, rows, columns) = layout.shape().dims4()?;
        let gradient = values("unet", gradient, layout)?;
        let weights = values("unet", weights, weights_layout)?;
        let Some(tapes) = self.kept.tapes.get() else {
            candle_core::bail!("unet: there was no forward pass");
        };
        let turned: Vec<Kernel> =
            self.layers.iter().map(|layer| layer.turned_kernel(weights)).collect();
        let len = 3 * rows * columns;
        let at_once = tapes.len().div_ceil(SUMS).max(1);
        let sums: Vec<Sums> = tapes
            .par_chunks(at_once)
            .zip(gradient.par_chunks(at_once * len))
            .map(|(tapes, gradients)| {
                let mut sums = Sums::zeros(&self.layers);
                for (tape, gradient) in tapes.iter().zip(gradients.chunks_exact(len)) {
                    let residual = last(tape);
                    let mut given = Image::zeros(
                        residual.rows,
                        residual.columns,
                        residual.channels,
                        &self.kept.buffers,
                    );
                    gather(&mut given, [rows, columns], gradient);
                    sums.add(&self.layers, &turned, tape, given, &self.kept.buffers);
                }
                sums
            })
            .collect();
        let mut out = vec![0.0; weights.len()];
        let total = sums
            .into_iter()
            .reduce(|sum, part| sum.plus(&part))
            .unwrap_or_else(|| Sums::zeros(&[]));
        for (layer, (kernel, bias)) in self.layers.iter().zip(&total.0) {
            layer.each_weight(|at, pixel, output, input| {
                out[at] = kernel.values[kernel.index(pixel, input, output)];
            });
            out[layer.bias_at..][..layer.outputs].copy_from_slice(&bias[..layer.outputs]);
        }
        Ok((CpuStorage::F32(out), weights_layout.shape().clone()))
    }
}

/// Gradients of each layer's kernel and bias.
struct Sums(Vec<(Kernel, Vec<f32>)>);

impl Sums {
    fn zeros(layers: &[Layer]) -> Self {
        let zeros = |layer: &Layer| {
            let kernel = Kernel::zeros(layer.padded_inputs(), layer.outputs);
            let bias = vec![0.0; kernel.outputs];
            (kernel, bias)
        };
        Self(layers.iter().map(zeros).collect())
    }

    fn plus(mut self, other: &Self) -> Self {
        for ((kernel, bias), (more, more_bias)) in self.0.iter_mut().zip(&other.0) {
            kernel.values.iter_mut().zip(&more.values).for_each(|(sum, part)| *sum += part);
            bias.iter_mut().zip(more_bias).for_each(|(sum, part)| *sum += part);
        }
        self
    }

    /// Adds the gradients for one image of the batch, given the gradient of the last image of its tape.
    fn add(
        &mut self,
        layers: &[Layer],
        turned: &[Kernel],
        tape: &Tape,
        residual: Image,
        buffers: &Buffers,
    ) {
        let mut gradients: Vec<Option<Image>> = tape.iter().map(|_| None).collect();
        let add =
            |gradients: &mut Vec<Option<Image>>, number: usize, part: Image| match &mut gradients
                [number]
            {
                Some(sum) => {
                    sum.values.iter_mut().zip(&part.values).for_each(|(s, p)| *s += p);
                    buffers.put(part.values);
                }
                none => *none = Some(part),
            };
        if let Some(place) = gradients.last_mut() {
            *place = Some(residual);
        }
        for (number, (made, image)) in tape.iter().enumerate().rev() {
            let Some(mut gradient) = gradients[number].take() else {
                continue;
            };
            match *made {
                Made::Given => {}
                Made::Convolved { layer, image: from } => {
                    let (kernel, bias) = &mut self.0[layer];
                    through_leaky(&mut gradient, image, layers[layer].slope, bias);
                    add_kernel_gradient(&tape[from].1, &gradient, kernel);
                    if !matches!(tape[from].0, Made::Given) {
                        let none = vec![0.0; turned[layer].outputs];
                        let part = convolve(&gradient, &turned[layer], &none, 1.0, buffers);
                        add(&mut gradients, from, part);
                    }
                }
                Made::Pooled { image } => {
                    let [rows, columns] = [2 * gradient.rows, 2 * gradient.columns];
                    let mut part = Image::unwritten(rows, columns, gradient.channels, buffers);
                    doubled(&gradient, 0.25, &mut part);
                    add(&mut gradients, image, part);
                }
                Made::Joined { image, skip } => {
                    let (small, large) = parted(&gradient, tape[image].1.channels, buffers);
                    add(&mut gradients, image, small);
                    add(&mut gradients, skip, large);
                }
            }
            buffers.put(gradient.values);
        }
    }
}
