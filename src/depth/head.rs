//! DPT: four levels of tokens become images, are fused from coarse to fine, and become depth.

use super::config::{Config, PATCH_PX};
use super::ops::linear;
use super::weights::Weights;
use train::candle_core::{Result, Tensor};
use train::ops::{Sampling, Window, bilinear_at, conv2d, conv2d_bias_leaky};

/// A kernel and its bias.
struct Convolution {
    kernel: Tensor,
    bias: Tensor,
}

impl Convolution {
    /// Convolves an image (1, channels, rows, columns), with ReLU behind it if `relu`.
    fn forward(&self, image: &Tensor, window: Window, relu: bool) -> Result<Tensor> {
        let slope = if relu { 0.0 } else { 1.0 };
        conv2d_bias_leaky(image, &self.kernel, &self.bias, window, slope)
    }
}

/// A residual unit with ReLU before each convolution.
struct Residual([Convolution; 2]);

impl Residual {
    fn forward(&self, image: &Tensor) -> Result<Tensor> {
        let window = Window::same(3, 1);
        let inner = self.0[0].forward(&image.relu()?, window, true)?;
        image + self.0[1].forward(&inner, window, false)?
    }
}

/// A level of the encoder.
struct Level {
    projection: Tensor,
    projection_bias: Tensor,
    resize: Option<Convolution>,
    kernel: Tensor,
}

/// A step from a coarse level to the next finer one.
struct Fusion {
    units: [Option<Residual>; 2],
    projection: Convolution,
}

pub(crate) struct Head {
    levels: Vec<Level>,
    fusions: Vec<Fusion>,
    last: [Convolution; 3],
}

impl Head {
    pub(crate) fn new(weights: &Weights, config: &Config) -> Result<Self> {
        let get = |name: &str| weights.get(name);
        let convolution = |name: &str| {
            Ok::<_, train::candle_core::Error>(Convolution {
                kernel: get(&format!("{name}.weight"))?,
                bias: get(&format!("{name}.bias"))?,
            })
        };
        let level = |number: usize| {
            let name = format!("neck.reassemble_stage.layers.{number}");
            let channels = config.level_channels[number];
            let resize =
                if number == 2 { None } else { Some(convolution(&format!("{name}.resize"))?) };
            Ok::<_, train::candle_core::Error>(Level {
                projection: get(&format!("{name}.projection.weight"))?
                    .reshape((channels, config.width))?
                    .t()?
                    .contiguous()?,
                projection_bias: get(&format!("{name}.projection.bias"))?,
                resize,
                kernel: get(&format!("neck.convs.{number}.weight"))?,
            })
        };
        let residual = |name: String| {
            Ok::<_, train::candle_core::Error>(Residual([
                convolution(&format!("{name}.convolution1"))?,
                convolution(&format!("{name}.convolution2"))?,
            ]))
        };
        let fusion = |number: usize| {
            let name = format!("neck.fusion_stage.layers.{number}");
            let first = match number {
                0 => None,
                _ => Some(residual(format!("{name}.residual_layer1"))?),
            };
            Ok::<_, train::candle_core::Error>(Fusion {
                units: [first, Some(residual(format!("{name}.residual_layer2"))?)],
                projection: convolution(&format!("{name}.projection"))?,
            })
        };
        Ok(Self {
            levels: (0..4).map(level).collect::<Result<_>>()?,
            fusions: (0..4).map(fusion).collect::<Result<_>>()?,
            last: [
                convolution("head.conv1")?,
                convolution("head.conv2")?,
                convolution("head.conv3")?,
            ],
        })
    }

    /// Computes the last layer's values (rows, columns), before its activation, from the tokens of four blocks.
    pub(crate) fn forward(&self, tokens: &[Tensor], grid: [usize; 2]) -> Result<Tensor> {
        let mut images = Vec::new();
        for (number, (level, tokens)) in self.levels.iter().zip(tokens).enumerate() {
            let image = level.forward(number, tokens, grid)?;
            images.push(conv2d(&image, &level.kernel, Window::same(3, 1))?);
        }
        images.reverse();
        let mut fused: Option<Tensor> = None;
        for (number, (fusion, image)) in self.fusions.iter().zip(&images).enumerate() {
            let size = match images.get(number + 1) {
                Some(next) => [next.dim(2)?, next.dim(3)?],
                None => [2 * image.dim(2)?, 2 * image.dim(3)?],
            };
            fused = Some(fusion.forward(fused, image, size)?);
        }
        let Some(fused) = fused else {
            train::candle_core::bail!("the head has no level");
        };
        let [first, second, third] = &self.last;
        let half = first.forward(&fused, Window::same(3, 1), false)?;
        let [rows, columns] = grid.map(|side| side * PATCH_PX);
        let whole = bilinear_at(&half, rows, columns, Sampling::Aligned)?;
        let last = second.forward(&whole, Window::same(3, 1), true)?;
        third.forward(&last, Window::same(1, 1), false)?.reshape((rows, columns))
    }
}

impl Level {
    /// Turns tokens into an image (1, channels, rows, columns) of the level's size.
    fn forward(
        &self,
        number: usize,
        tokens: &Tensor,
        [rows, columns]: [usize; 2],
    ) -> Result<Tensor> {
        let projected = linear(tokens, &self.projection, &self.projection_bias)?;
        let channels = projected.dim(1)?;
        let image = |rows_of_pixels: &Tensor| {
            let turned = rows_of_pixels.t()?.contiguous()?;
            turned.reshape((1, channels, rows, columns))
        };
        let Some(resize) = &self.resize else { return image(&projected) };
        if number == 3 {
            let window = Window { padding: 1, stride: 2, dilation: 1 };
            return resize.forward(&image(&projected)?, window, false);
        }
        // A transposed convolution whose stride is its side: each token becomes a square of pixels.
        let side = resize.kernel.dim(2)?;
        let squares = channels * side * side;
        let matrix = resize.kernel.reshape((channels, squares))?;
        let bias = resize.bias.reshape((channels, 1))?.broadcast_as((channels, side * side))?;
        let bias = bias.contiguous()?.reshape(squares)?;
        let pixels = linear(&projected, &matrix, &bias)?;
        let pixels = pixels.reshape(&[rows, columns, channels, side, side][..])?;
        let turned = pixels.permute([2, 0, 3, 1, 4])?.contiguous()?;
        turned.reshape((1, channels, rows * side, columns * side))
    }
}

impl Fusion {
    /// Adds a level to the fused coarser ones, and resizes the sum to `size`.
    fn forward(&self, fused: Option<Tensor>, image: &Tensor, size: [usize; 2]) -> Result<Tensor> {
        let sum = match (fused, &self.units[0]) {
            (Some(fused), Some(unit)) => (fused + unit.forward(image)?)?,
            _ => image.clone(),
        };
        let sum = match &self.units[1] {
            Some(unit) => unit.forward(&sum)?,
            None => sum,
        };
        let resized = bilinear_at(&sum, size[0], size[1], Sampling::Aligned)?;
        self.projection.forward(&resized, Window::same(1, 1), false)
    }
}
