//! Image features of the frozen VGG-19 up to conv5_2 (Simonyan and Zisserman, ICLR 2015).

use super::ops::{Sampling, Window, conv2d_bias_leaky, max_pool2, mean_pool2};
use super::random::{RandomTensor, Stream};
use candle_core::{DType, Device, Result, Tensor};
use plan::FeatureStyle;
use std::collections::HashMap;

/// Indices of the convolutions in torchvision's `vgg19().features`; a ReLU follows each.
pub const VGG_PLACES: [usize; 14] = [0, 2, 5, 7, 10, 12, 14, 16, 19, 21, 23, 25, 28, 30];

/// Numbers of output channels of the convolutions in [`VGG_PLACES`].
pub const VGG_WIDTHS: [usize; 14] =
    [64, 64, 128, 128, 256, 256, 256, 256, 512, 512, 512, 512, 512, 512];

/// Positions in [`VGG_PLACES`] of the convolutions that follow a max pooling.
const POOLS: [usize; 4] = [2, 4, 8, 12];

/// Positions in [`VGG_PLACES`] of conv1_2, conv2_2, conv3_2, conv4_2 and conv5_2, which yield the features.
const TAPS: [usize; 5] = [1, 3, 5, 9, 13];

/// Mean and standard deviation of red, green and blue in ImageNet, as sRGB values in [0, 1]. torchvision's weights
/// expect this normalisation.
const MEAN: [f32; 3] = [0.485, 0.456, 0.406];
const DEVIATION: [f32; 3] = [0.229, 0.224, 0.225];

/// What the programs of Zhang et al. and of Kim et al. subtract from codes (0 to 255) of blue, green and red: the means of
/// red, green and blue.
const CAFFE_MEAN: [f32; 3] = [123.68, 116.779, 103.939];

/// Largest code of a picture in these programs, by which they also divide the features of the hypercolumn.
const LARGEST_CODE: f64 = 255.0;

#[derive(Debug, thiserror::Error)]
pub enum VggError {
    #[error(
        "{name} is missing: the file must hold torchvision's vgg19 (features.0 to features.30)"
    )]
    Missing { name: String },
    #[error(
        "{name} is {found:?}, but must be {expected:?}: these are not torchvision's vgg19 weights"
    )]
    Shape { name: String, found: Vec<usize>, expected: Vec<usize> },
    #[error(transparent)]
    Tensor(#[from] candle_core::Error),
}

pub struct Vgg {
    /// Kernel and bias of each convolution.
    convolutions: Vec<(Tensor, Tensor)>,
    mean: Tensor,
    deviation: Tensor,
    caffe_mean: Tensor,
    style: FeatureStyle,
}

impl Vgg {
    /// Builds the network from tensors with torchvision's names. `narrow` divides all widths; it is 1 for the published
    /// weights.
    pub fn new(
        weights: &HashMap<String, Tensor>,
        narrow: usize,
    ) -> std::result::Result<Self, VggError> {
        let tensor = |name: String, expected: Vec<usize>| {
            let Some(tensor) = weights.get(&name) else {
                return Err(VggError::Missing { name });
            };
            if tensor.dims() != expected {
                return Err(VggError::Shape { name, found: tensor.dims().to_vec(), expected });
            }
            Ok(tensor.to_dtype(DType::F32)?)
        };
        Self::of(narrow, |place, [width, channels]| {
            let kernel = tensor(format!("features.{place}.weight"), vec![width, channels, 3, 3])?;
            Ok((kernel, tensor(format!("features.{place}.bias"), vec![width])?))
        })
    }

    /// Initialises kernels from a seed (He et al., standard deviation sqrt(2 / (9 channels))) and biases with 0. Random
    /// features suit the feature loss nearly as well as trained ones, but contain little semantic information.
    pub fn random(seed: u64, narrow: usize) -> Result<Self> {
        Self::of(narrow, |place, [width, channels]| {
            let deviation = (2.0 / (9 * channels) as f64).sqrt();
            let mut stream = Stream::new(seed, &format!("vgg features.{place}"));
            let kernel = stream.normal_tensor(&[width, channels, 3, 3], deviation)?;
            Ok((kernel, Tensor::zeros(width, DType::F32, &Device::Cpu)?))
        })
    }

    /// Builds the network. `layer` returns the kernel and the bias of a convolution from its index in torchvision and
    /// its numbers of outputs and inputs.
    fn of<E: From<candle_core::Error>>(
        narrow: usize,
        layer: impl Fn(usize, [usize; 2]) -> std::result::Result<(Tensor, Tensor), E>,
    ) -> std::result::Result<Self, E> {
        let mut channels = 3;
        let mut convolutions = Vec::new();
        for (place, width) in VGG_PLACES.into_iter().zip(VGG_WIDTHS) {
            convolutions.push(layer(place, [width / narrow, channels])?);
            channels = width / narrow;
        }
        let row = |values: [f32; 3]| Tensor::new(&values, &Device::Cpu)?.reshape((1, 3, 1, 1));
        Ok(Self {
            convolutions,
            mean: row(MEAN)?,
            deviation: row(DEVIATION)?,
            caffe_mean: row(CAFFE_MEAN)?,
            style: FeatureStyle::Torch,
        })
    }

    /// Returns the weights by torchvision's names.
    pub fn weights(&self) -> impl Iterator<Item = (String, &Tensor)> {
        VGG_PLACES.into_iter().zip(&self.convolutions).flat_map(|(place, (kernel, bias))| {
            [(format!("features.{place}.weight"), kernel), (format!("features.{place}.bias"), bias)]
        })
    }

    /// Returns the network with another computation of the features.
    #[must_use]
    pub fn with_style(self, style: FeatureStyle) -> Self {
        Self { style, ..self }
    }

    /// Returns the factor of differences of features in the feature loss: caffe's features are of codes from 0 to 255.
    pub fn loss_factor(&self) -> f64 {
        match self.style {
            FeatureStyle::Torch => 1.0,
            FeatureStyle::Caffe => LARGEST_CODE,
        }
    }

    /// Returns the positions of pixels in features that are resized for the hypercolumn.
    pub fn sampling(&self) -> Sampling {
        match self.style {
            FeatureStyle::Torch => Sampling::Centres,
            FeatureStyle::Caffe => Sampling::Corners,
        }
    }

    /// Converts images to the input of the first convolution.
    fn normalised(&self, images: &Tensor) -> Result<Tensor> {
        match self.style {
            FeatureStyle::Torch => images.broadcast_sub(&self.mean)?.broadcast_div(&self.deviation),
            FeatureStyle::Caffe => {
                let channels = [2, 1, 0].map(|channel| images.narrow(1, channel, 1));
                let [blue, green, red] = channels;
                let reversed = Tensor::cat(&[blue?, green?, red?], 1)?;
                (reversed * LARGEST_CODE)?.broadcast_sub(&self.caffe_mean)
            }
        }
    }

    /// Computes relu(conv1_2) to relu(conv5_2) of images with sRGB values in [0, 1], (batch, 3, rows, columns). Each
    /// feature has half the size of the previous one. With caffe's style, they are divided by 255.
    pub fn features(&self, images: &Tensor) -> Result<Vec<Tensor>> {
        let mut features = Vec::with_capacity(TAPS.len());
        let mut x = self.normalised(images)?;
        for (index, (kernel, bias)) in self.convolutions.iter().enumerate() {
            if POOLS.contains(&index) {
                x = match self.style {
                    FeatureStyle::Torch => max_pool2(&x)?,
                    FeatureStyle::Caffe => average_pool2(&x)?,
                };
            }
            x = conv2d_bias_leaky(&x, kernel, bias, Window::same(3, 1), 0.0)?;
            if TAPS.contains(&index) {
                features.push(match self.style {
                    FeatureStyle::Torch => x.clone(),
                    FeatureStyle::Caffe => (&x / LARGEST_CODE)?,
                });
            }
        }
        Ok(features)
    }

    /// Returns the number of channels of each tensor that [`Self::features`] returns.
    pub fn widths(&self) -> Vec<usize> {
        TAPS.iter().map(|&tap| self.convolutions[tap].1.elem_count()).collect()
    }
}

/// Returns the means of 2 x 2 px; ignores an odd last row or column.
fn average_pool2(image: &Tensor) -> Result<Tensor> {
    let (_, _, rows, columns) = image.dims4()?;
    mean_pool2(&image.narrow(2, 0, rows / 2 * 2)?.narrow(3, 0, columns / 2 * 2)?)
}
