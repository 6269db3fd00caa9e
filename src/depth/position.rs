//! The position embedding at another size: bicubic, as PyTorch's `interpolate` without antialiasing.

use train::candle_core::{Device, Result, Tensor};

/// Coefficient of the cubic kernel (Keys, 1981), that of PyTorch.
const A: f64 = -0.75;

/// Returns the weights of the four neighbours of a position with the fraction `t`.
fn cubic(t: f64) -> [f64; 4] {
    let near = |x: f64| ((A + 2.0) * x - (A + 3.0)) * x * x + 1.0;
    let far = |x: f64| ((A * x - 5.0 * A) * x + 8.0 * A) * x - 4.0 * A;
    [far(t + 1.0), near(t), near(1.0 - t), far(2.0 - t)]
}

/// Returns the matrix (to, from) that resizes a line with pixel centres at halves; neighbours beyond the ends repeat them.
fn resizing(from: usize, to: usize) -> Vec<f32> {
    let mut matrix = vec![0.0f32; to * from];
    let scale = from as f64 / to as f64;
    for (place, row) in matrix.chunks_exact_mut(from).enumerate() {
        let at = (place as f64 + 0.5) * scale - 0.5;
        let first = at.floor();
        for (k, weight) in cubic(at - first).into_iter().enumerate() {
            let neighbour = (first as isize - 1 + k as isize).clamp(0, from as isize - 1);
            row[neighbour as usize] += weight as f32;
        }
    }
    matrix
}

/// Resizes an embedding (side x side, width) to (rows x columns, width).
pub(crate) fn resized(
    embedding: &Tensor,
    side: usize,
    [rows, columns]: [usize; 2],
) -> Result<Tensor> {
    if [rows, columns] == [side, side] {
        return Ok(embedding.clone());
    }
    let width = embedding.dim(1)?;
    let down = Tensor::from_vec(resizing(side, rows), (rows, side), &Device::Cpu)?;
    let across = Tensor::from_vec(resizing(side, columns), (columns, side), &Device::Cpu)?;
    let high = down.matmul(&embedding.reshape((side, side * width))?)?;
    let turned = high.reshape((rows, side, width))?.transpose(0, 1)?.contiguous()?;
    let wide = across.matmul(&turned.reshape((side, rows * width))?)?;
    let back = wide.reshape((columns, rows, width))?.transpose(0, 1)?.contiguous()?;
    back.reshape((rows * columns, width))
}
