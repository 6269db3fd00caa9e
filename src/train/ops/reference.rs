//! References for tests, from candle operations with correct gradients.

use super::absolute;
use candle_core::{Result, Tensor};

pub(crate) fn mean_absolute_difference(a: &Tensor, b: &Tensor) -> Result<Tensor> {
    absolute(&(a - b)?)?.mean_all()
}

/// Doubles `image` (batch, channels, rows, columns) by repeating pixels, and appends the channels of `skip` (batch,
/// any, 2 rows, 2 columns). The gradient of candle's own upsampling overwrites others.
pub(crate) fn double_and_join(image: &Tensor, skip: &Tensor) -> Result<Tensor> {
    let (batch, channels, rows, columns) = image.dims4()?;
    let spread = image.contiguous()?.reshape((batch * channels, rows, 1, columns, 1))?;
    let spread = spread.broadcast_as((batch * channels, rows, 2, columns, 2))?.contiguous()?;
    let doubled = spread.reshape((batch, channels, 2 * rows, 2 * columns))?;
    Tensor::cat(&[&doubled, skip], 1)
}

/// Moves 2 x 2 pixels into four channels, in PyTorch's order (channel, row, column): (batch, channels, rows, columns)
/// with even rows and columns becomes (batch, 4 channels, rows / 2, columns / 2).
pub(crate) fn unshuffle2(image: &Tensor) -> Result<Tensor> {
    let (batch, channels, rows, columns) = image.dims4()?;
    let split = image.contiguous()?.reshape((batch, channels, rows / 2, 2, columns / 2, 2))?;
    let moved = split.permute([0, 1, 3, 5, 2, 4])?.contiguous()?;
    moved.reshape((batch, 4 * channels, rows / 2, columns / 2))
}

/// Inverts [`unshuffle2`]; the number of channels must be a multiple of four.
pub(crate) fn shuffle2(image: &Tensor) -> Result<Tensor> {
    let (batch, channels, rows, columns) = image.dims4()?;
    let split = image.contiguous()?.reshape((batch, channels / 4, 2, 2, rows, columns))?;
    let moved = split.permute([0, 1, 4, 2, 5, 3])?.contiguous()?;
    moved.reshape((batch, channels / 4, 2 * rows, 2 * columns))
}

/// Repeats the last row and column of (batch, channels, rows, columns) until both sizes are multiples of `multiple`.
pub(crate) fn pad_to_multiple(image: &Tensor, multiple: usize) -> Result<Tensor> {
    let (_, _, rows, columns) = image.dims4()?;
    let missing = |length: usize| length.next_multiple_of(multiple) - length;
    image.pad_with_same(2, 0, missing(rows))?.pad_with_same(3, 0, missing(columns))
}
