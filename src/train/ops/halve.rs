//! Changes of size by 2: mean pooling, nearest doubling joined with a skip connection, and the exchange of 2 x 2 pixels
//! with channels.

use super::values;
use candle_core::{CpuStorage, CustomOp1, CustomOp2, Layout, Result, Shape, Tensor, bail};
use rayon::prelude::*;

/// Returns the 2 x 2 px means of a (batch, channels, rows, columns) f32 tensor with even rows and columns.
pub fn mean_pool2(image: &Tensor) -> Result<Tensor> {
    even("mean_pool2", image.dims())?;
    if image.device().is_cpu() {
        return image.contiguous()?.apply_op1(MeanPool2);
    }
    plain_mean_pool2(image)
}

/// Computes [`mean_pool2`] from candle operations. The gradient of candle's own pooling is wrong for odd sizes.
pub(super) fn plain_mean_pool2(image: &Tensor) -> Result<Tensor> {
    let (batch, channels, rows, columns) = image.dims4()?;
    let split = image.contiguous()?.reshape((batch * channels, rows / 2, 2, columns / 2, 2))?;
    split.sum((2, 4))?.affine(0.25, 0.0)?.reshape((batch, channels, rows / 2, columns / 2))
}

/// Doubles `image` (batch, channels, rows, columns) by repeating pixels, and appends the channels of `skip` (batch,
/// any, 2 rows, 2 columns).
pub fn double_and_join(image: &Tensor, skip: &Tensor) -> Result<Tensor> {
    let ((batch, _, rows, columns), of_skip) = (image.dims4()?, skip.dims4()?);
    if (of_skip.0, of_skip.2, of_skip.3) != (batch, 2 * rows, 2 * columns) {
        bail!("double_and_join: {:?} is not twice {:?}", skip.dims(), image.dims());
    }
    if image.device().is_cpu() {
        return image.contiguous()?.apply_op2(&skip.contiguous()?, DoubleAndJoin);
    }
    plain_double_and_join(image, skip)
}

/// Computes [`double_and_join`] from candle operations. The gradient of candle's own upsampling overwrites others.
pub(super) fn plain_double_and_join(image: &Tensor, skip: &Tensor) -> Result<Tensor> {
    let (batch, channels, rows, columns) = image.dims4()?;
    let spread = image.contiguous()?.reshape((batch * channels, rows, 1, columns, 1))?;
    let spread = spread.broadcast_as((batch * channels, rows, 2, columns, 2))?.contiguous()?;
    let doubled = spread.reshape((batch, channels, 2 * rows, 2 * columns))?;
    Tensor::cat(&[&doubled, skip], 1)
}

/// Moves 2 x 2 pixels into four channels, in PyTorch's order (channel, row, column): (batch, channels, rows, columns)
/// with even rows and columns becomes (batch, 4 channels, rows / 2, columns / 2).
pub fn unshuffle2(image: &Tensor) -> Result<Tensor> {
    even("unshuffle2", image.dims())?;
    if image.device().is_cpu() {
        return image.contiguous()?.apply_op1(Unshuffle2);
    }
    let (batch, channels, rows, columns) = image.dims4()?;
    let split = image.contiguous()?.reshape((batch, channels, rows / 2, 2, columns / 2, 2))?;
    let moved = split.permute([0, 1, 3, 5, 2, 4])?.contiguous()?;
    moved.reshape((batch, 4 * channels, rows / 2, columns / 2))
}

/// Inverts [`unshuffle2`]; the number of channels must be a multiple of four.
pub fn shuffle2(image: &Tensor) -> Result<Tensor> {
    let (batch, channels, rows, columns) = image.dims4()?;
    if !channels.is_multiple_of(4) {
        bail!("shuffle2: the channels of {:?} are not a multiple of 4", image.dims());
    }
    if image.device().is_cpu() {
        return image.contiguous()?.apply_op1(Shuffle2);
    }
    let split = image.contiguous()?.reshape((batch, channels / 4, 2, 2, rows, columns))?;
    let moved = split.permute([0, 1, 4, 2, 5, 3])?.contiguous()?;
    moved.reshape((batch, channels / 4, 2 * rows, 2 * columns))
}

/// Repeats the last row and column of (batch, channels, rows, columns) until both sizes are multiples of `multiple`.
pub fn pad_to_multiple(image: &Tensor, multiple: usize) -> Result<Tensor> {
    let (_, _, rows, columns) = image.dims4()?;
    let missing = |length: usize| length.next_multiple_of(multiple) - length;
    image.pad_with_same(2, 0, missing(rows))?.pad_with_same(3, 0, missing(columns))
}

fn even(op: &str, dims: &[usize]) -> Result<()> {
    match dims {
        [_, _, rows, columns] if rows.is_multiple_of(2) && columns.is_multiple_of(2) => Ok(()),
        _ => bail!("{op}: {dims:?} is not (batch, channels, even rows, even columns)"),
    }
}

/// Calls `with` for each row of `small` and the two rows of `large` that it corresponds to. `columns` is the length of
/// a row of `small`, and `large` has rows of twice this length.
fn by_rows(
    small: &mut [f32],
    large: &[f32],
    columns: usize,
    with: impl Fn(&mut [f32], &[f32], &[f32]) + Sync,
) {
    let rows = small.par_chunks_exact_mut(columns.max(1)).with_min_len(64);
    rows.zip(large.par_chunks_exact(4 * columns.max(1))).for_each(|(small, large)| {
        let (upper, lower) = large.split_at(2 * columns);
        with(small, upper, lower);
    });
}

fn sums_of_four(small: &mut [f32], upper: &[f32], lower: &[f32], factor: f32) {
    let pairs = upper.chunks_exact(2).zip(lower.chunks_exact(2));
    for (out, (upper, lower)) in small.iter_mut().zip(pairs) {
        *out = ((upper[0] + upper[1]) + (lower[0] + lower[1])) * factor;
    }
}

/// Writes each row of `small`, doubled and multiplied by `factor`, to two rows of `large`.
fn spread(small: &[f32], columns: usize, factor: f32, large: &mut [f32]) {
    let rows = large.par_chunks_exact_mut(4 * columns.max(1)).with_min_len(64);
    rows.zip(small.par_chunks_exact(columns.max(1))).for_each(|(large, small)| {
        let (upper, lower) = large.split_at_mut(2 * columns);
        for (pair, value) in upper.chunks_exact_mut(2).zip(small) {
            pair.fill(value * factor);
        }
        lower.copy_from_slice(upper);
    });
}

struct MeanPool2;

impl CustomOp1 for MeanPool2 {
    fn name(&self) -> &'static str {
        "mean-pool2"
    }

    fn cpu_fwd(&self, image: &CpuStorage, layout: &Layout) -> Result<(CpuStorage, Shape)> {
        let (batch, channels, rows, columns) = layout.shape().dims4()?;
        let image = values("mean_pool2", image, layout)?;
        let mut out = vec![0.0; image.len() / 4];
        by_rows(&mut out, image, columns / 2, |out, upper, lower| {
            sums_of_four(out, upper, lower, 0.25);
        });
        Ok((CpuStorage::F32(out), (batch, channels, rows / 2, columns / 2).into()))
    }

    fn bwd(&self, _image: &Tensor, _result: &Tensor, gradient: &Tensor) -> Result<Option<Tensor>> {
        Ok(Some(gradient.contiguous()?.apply_op1_no_bwd(&Spread(0.25))?))
    }
}

/// Operation that repeats pixels to twice the size and multiplies them.
struct Spread(f32);

impl CustomOp1 for Spread {
    fn name(&self) -> &'static str {
        "spread"
    }

    fn cpu_fwd(&self, image: &CpuStorage, layout: &Layout) -> Result<(CpuStorage, Shape)> {
        let (batch, channels, rows, columns) = layout.shape().dims4()?;
        let image = values("spread", image, layout)?;
        let mut out = vec![0.0; 4 * image.len()];
        spread(image, columns, self.0, &mut out);
        Ok((CpuStorage::F32(out), (batch, channels, 2 * rows, 2 * columns).into()))
    }
}

struct DoubleAndJoin;

impl CustomOp2 for DoubleAndJoin {
    fn name(&self) -> &'static str {
        "double-and-join"
    }

    fn cpu_fwd(
        &self,
        image: &CpuStorage,
        layout: &Layout,
        skip: &CpuStorage,
        skip_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let (batch, channels, rows, columns) = layout.shape().dims4()?;
        let (_, more, ..) = skip_layout.shape().dims4()?;
        let image = values("double_and_join", image, layout)?;
        let skip = values("double_and_join", skip, skip_layout)?;
        let (of_image, of_skip) = (channels * rows * columns, 4 * more * rows * columns);
        let mut out = Vec::with_capacity(4 * image.len() + skip.len());
        for item in 0..batch {
            let start = out.len();
            out.resize(start + 4 * of_image, 0.0);
            spread(&image[item * of_image..][..of_image], columns, 1.0, &mut out[start..]);
            out.extend_from_slice(&skip[item * of_skip..][..of_skip]);
        }
        Ok((CpuStorage::F32(out), (batch, channels + more, 2 * rows, 2 * columns).into()))
    }

    fn bwd(
        &self,
        image: &Tensor,
        skip: &Tensor,
        _result: &Tensor,
        gradient: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>)> {
        let channels = image.dim(1)?;
        let gradient = gradient.contiguous()?;
        let of_image = image.track_op().then(|| gradient.apply_op1_no_bwd(&SumsOfFour(channels)));
        let of_skip = skip.track_op().then(|| {
            let part = gradient.narrow(1, channels, skip.dim(1)?)?;
            part.contiguous()
        });
        Ok((of_image.transpose()?, of_skip.transpose()?))
    }
}

/// Operation that sums 2 x 2 px of the first channels.
struct SumsOfFour(usize);

impl CustomOp1 for SumsOfFour {
    fn name(&self) -> &'static str {
        "sums-of-four"
    }

    fn cpu_fwd(&self, image: &CpuStorage, layout: &Layout) -> Result<(CpuStorage, Shape)> {
        let (batch, channels, rows, columns) = layout.shape().dims4()?;
        let image = values("sums_of_four", image, layout)?;
        let (len, stride) = (self.0 * rows * columns, channels * rows * columns);
        let mut out = vec![0.0; batch * len / 4];
        for (out, item) in out.chunks_exact_mut((len / 4).max(1)).zip(image.chunks(stride.max(1))) {
            by_rows(out, &item[..len], columns / 2, |out, upper, lower| {
                sums_of_four(out, upper, lower, 1.0);
            });
        }
        Ok((CpuStorage::F32(out), (batch, self.0, rows / 2, columns / 2).into()))
    }
}

struct Unshuffle2;

impl CustomOp1 for Unshuffle2 {
    fn name(&self) -> &'static str {
        "unshuffle2"
    }

    fn cpu_fwd(&self, image: &CpuStorage, layout: &Layout) -> Result<(CpuStorage, Shape)> {
        let (batch, channels, rows, columns) = layout.shape().dims4()?;
        let image = values("unshuffle2", image, layout)?;
        let (plane, across) = (rows * columns, columns / 2);
        let mut out = vec![0.0; image.len()];
        let planes = out.par_chunks_exact_mut(plane.max(1));
        planes.zip(image.par_chunks_exact(plane.max(1))).for_each(|(out, plane)| {
            for (place, out) in out.chunks_exact_mut((plane.len() / 4).max(1)).enumerate() {
                let (row, column) = (place / 2, place % 2);
                let lines = plane.chunks_exact(columns).skip(row).step_by(2);
                for (out, line) in out.chunks_exact_mut(across).zip(lines) {
                    let seen = line[column..].iter().step_by(2);
                    out.iter_mut().zip(seen).for_each(|(out, value)| *out = *value);
                }
            }
        });
        Ok((CpuStorage::F32(out), (batch, 4 * channels, rows / 2, columns / 2).into()))
    }

    fn bwd(&self, _image: &Tensor, _result: &Tensor, gradient: &Tensor) -> Result<Option<Tensor>> {
        Ok(Some(gradient.contiguous()?.apply_op1_no_bwd(&Shuffle2)?))
    }
}

struct Shuffle2;

impl CustomOp1 for Shuffle2 {
    fn name(&self) -> &'static str {
        "shuffle2"
    }

    fn cpu_fwd(&self, image: &CpuStorage, layout: &Layout) -> Result<(CpuStorage, Shape)> {
        let (batch, channels, rows, columns) = layout.shape().dims4()?;
        let image = values("shuffle2", image, layout)?;
        let plane = 4 * rows * columns;
        let mut out = vec![0.0; image.len()];
        let planes = out.par_chunks_exact_mut(plane.max(1));
        planes.zip(image.par_chunks_exact(plane.max(1))).for_each(|(out, planes)| {
            for (place, plane) in planes.chunks_exact((planes.len() / 4).max(1)).enumerate() {
                let (row, column) = (place / 2, place % 2);
                let lines = out.chunks_exact_mut(2 * columns).skip(row).step_by(2);
                for (line, seen) in lines.zip(plane.chunks_exact(columns)) {
                    let out = line[column..].iter_mut().step_by(2);
                    out.zip(seen).for_each(|(out, value)| *out = *value);
                }
            }
        });
        Ok((CpuStorage::F32(out), (batch, channels / 4, 2 * rows, 2 * columns).into()))
    }

    fn bwd(&self, _image: &Tensor, _result: &Tensor, gradient: &Tensor) -> Result<Option<Tensor>> {
        Ok(Some(gradient.contiguous()?.apply_op1_no_bwd(&Unshuffle2)?))
    }
}
