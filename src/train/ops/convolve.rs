//! Convolution of tensors, alone or with a bias and a leaky ReLU.

use super::kernel::{forward, image_gradient, kernel_gradient};
use super::values;
use super::window::{Sizes, Window};
use candle_core::{CpuStorage, CustomOp2, CustomOp3, Layout, Result, Shape, Tensor};
use rayon::prelude::*;

/// Convolves `image` (batch, in, rows, columns) with `kernel` (out, in, rows, columns), both f32, to (batch, out, ...).
///
/// The backward pass skips unused gradients (of frozen kernels and input images).
pub fn conv2d(image: &Tensor, kernel: &Tensor, window: Window) -> Result<Tensor> {
    image.contiguous()?.apply_op2(&kernel.contiguous()?, Convolve(window))
}

/// Computes `conv2d(image, kernel) + bias` with negative values multiplied by `slope`: 0 for ReLU, 1 for none. `bias` has
/// one value per output channel. The gradient at 0 is `slope`.
pub fn conv2d_bias_leaky(
    image: &Tensor,
    kernel: &Tensor,
    bias: &Tensor,
    window: Window,
    slope: f32,
) -> Result<Tensor> {
    let (image, kernel, bias) = (image.contiguous()?, kernel.contiguous()?, bias.contiguous()?);
    image.apply_op3(&kernel, &bias, ConvolveBiasLeaky(window, slope))
}

struct Convolve(Window);

impl CustomOp2 for Convolve {
    fn name(&self) -> &'static str {
        "conv2d"
    }

    fn cpu_fwd(
        &self,
        image: &CpuStorage,
        image_layout: &Layout,
        kernel: &CpuStorage,
        kernel_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let sizes = Sizes::new(image_layout.dims(), kernel_layout.dims(), self.0)?;
        let image = values("conv2d", image, image_layout)?;
        let kernel = values("conv2d", kernel, kernel_layout)?;
        Ok((CpuStorage::F32(forward(&sizes, image, kernel)), shape_of(&sizes)))
    }

    fn bwd(
        &self,
        image: &Tensor,
        kernel: &Tensor,
        _result: &Tensor,
        gradient: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>)> {
        gradients(self.0, image, kernel, &gradient.contiguous()?)
    }
}

struct ConvolveBiasLeaky(Window, f32);

impl CustomOp3 for ConvolveBiasLeaky {
    fn name(&self) -> &'static str {
        "conv2d-bias-leaky"
    }

    fn cpu_fwd(
        &self,
        image: &CpuStorage,
        image_layout: &Layout,
        kernel: &CpuStorage,
        kernel_layout: &Layout,
        bias: &CpuStorage,
        bias_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let sizes = Sizes::new(image_layout.dims(), kernel_layout.dims(), self.0)?;
        let image = values("conv2d", image, image_layout)?;
        let kernel = values("conv2d", kernel, kernel_layout)?;
        let bias = values("conv2d", bias, bias_layout)?;
        if bias.len() != sizes.channels_out {
            candle_core::bail!("conv2d: {} biases for {} outputs", bias.len(), sizes.channels_out);
        }
        let mut out = forward(&sizes, image, kernel);
        let slope = self.1;
        let planes = out.par_chunks_exact_mut(sizes.out_len().max(1)).enumerate();
        planes.for_each(|(plane, values)| {
            let bias = bias[plane % sizes.channels_out];
            for value in values {
                let x = *value + bias;
                *value = if slope == 0.0 { x.max(0.0) } else { leaky(x, slope, x) };
            }
        });
        Ok((CpuStorage::F32(out), shape_of(&sizes)))
    }

    fn bwd(
        &self,
        image: &Tensor,
        kernel: &Tensor,
        bias: &Tensor,
        result: &Tensor,
        gradient: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let mut passed = gradient.contiguous()?;
        if self.1 != 1.0 {
            passed = passed.apply_op2_no_bwd(result, &LeakyGradient(self.1))?;
        }
        let (of_image, of_kernel) = gradients(self.0, image, kernel, &passed)?;
        let of_bias = bias.track_op().then(|| passed.sum((0, 2, 3))).transpose()?;
        Ok((of_image, of_kernel, of_bias))
    }
}

/// Computes the gradients of the image and of the kernel, each only if candle tracks the tensor.
fn gradients(
    window: Window,
    image: &Tensor,
    kernel: &Tensor,
    gradient: &Tensor,
) -> Result<(Option<Tensor>, Option<Tensor>)> {
    let mut of_image = None;
    if image.track_op() {
        let op = ImageGradient(window, image.dims().to_vec());
        of_image = Some(gradient.apply_op2_no_bwd(kernel, &op)?);
    }
    let mut of_kernel = None;
    if kernel.track_op() {
        let op = KernelGradient(window, kernel.dims().to_vec());
        of_kernel = Some(image.apply_op2_no_bwd(gradient, &op)?);
    }
    Ok((of_image, of_kernel))
}

fn shape_of(sizes: &Sizes) -> Shape {
    let [rows, columns] = sizes.out;
    (sizes.batch, sizes.channels_out, rows, columns).into()
}

/// Operation for the gradient of the image from the result's gradient and the kernel; holds the image's dimensions.
struct ImageGradient(Window, Vec<usize>);

impl CustomOp2 for ImageGradient {
    fn name(&self) -> &'static str {
        "conv2d-image-gradient"
    }

    fn cpu_fwd(
        &self,
        gradient: &CpuStorage,
        gradient_layout: &Layout,
        kernel: &CpuStorage,
        kernel_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let sizes = Sizes::new(&self.1, kernel_layout.dims(), self.0)?;
        let gradient = values("conv2d", gradient, gradient_layout)?;
        let kernel = values("conv2d", kernel, kernel_layout)?;
        let out = image_gradient(&sizes, kernel, gradient);
        Ok((CpuStorage::F32(out), self.1.clone().into()))
    }
}

/// Operation for the gradient of the kernel from the image and the result's gradient; holds the kernel's dimensions.
struct KernelGradient(Window, Vec<usize>);

impl CustomOp2 for KernelGradient {
    fn name(&self) -> &'static str {
        "conv2d-kernel-gradient"
    }

    fn cpu_fwd(
        &self,
        image: &CpuStorage,
        image_layout: &Layout,
        gradient: &CpuStorage,
        gradient_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let sizes = Sizes::new(image_layout.dims(), &self.1, self.0)?;
        let image = values("conv2d", image, image_layout)?;
        let gradient = values("conv2d", gradient, gradient_layout)?;
        let out = kernel_gradient(&sizes, image, gradient);
        Ok((CpuStorage::F32(out), self.1.clone().into()))
    }
}

/// Returns `value` if `x` is positive, and `slope` times `value` otherwise.
fn leaky(x: f32, slope: f32, value: f32) -> f32 {
    if x > 0.0 { value } else { slope * value }
}

/// Operation that copies the first tensor where the second is positive, and multiplies it by the slope elsewhere.
struct LeakyGradient(f32);

impl CustomOp2 for LeakyGradient {
    fn name(&self) -> &'static str {
        "leaky-gradient"
    }

    fn cpu_fwd(
        &self,
        gradient: &CpuStorage,
        gradient_layout: &Layout,
        result: &CpuStorage,
        result_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let gradient = values("leaky", gradient, gradient_layout)?;
        let result = values("leaky", result, result_layout)?;
        let slope = self.0;
        let pairs = gradient.par_iter().zip(result).with_min_len(1 << 15);
        let out = if slope == 0.0 {
            // 0 times a negative or infinite gradient is not 0.
            pairs.map(|(gradient, result)| if *result > 0.0 { *gradient } else { 0.0 }).collect()
        } else {
            pairs.map(|(gradient, result)| leaky(*result, slope, *gradient)).collect()
        };
        Ok((CpuStorage::F32(out), gradient_layout.shape().clone()))
    }
}
