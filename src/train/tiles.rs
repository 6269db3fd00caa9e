//! Division of large images into tiles whose outputs, put together, are those of the whole image.
//!
//! A network reads more pixels of a tile than it keeps of its output: kept pixels are at least the network's reach away
//! from every cut.

use candle_core::{Device, Result, Tensor};
use examples::Picture;
use examples::Planes;
use std::ops::Range;

/// Tiles of a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(clippy::struct_field_names, reason = "lengths end with their unit")]
pub(super) struct Tiling {
    /// Longest side of the part that a network reads, px; smaller values are raised to [`Tiling::least_px`].
    pub(super) tile_px: usize,
    /// Largest distance between an output pixel and the input pixels that change it, px.
    pub(super) reach_px: usize,
    /// Tiles begin at multiples of this distance, so that their pixels are pooled like those of the whole image.
    pub(super) period_px: usize,
}

impl Tiling {
    /// Returns the least useful side of a tile, px.
    pub(super) fn least_px(&self) -> usize {
        2 * self.margin_px() + self.period_px.max(64)
    }

    /// Returns the reach as a multiple of the period.
    fn margin_px(&self) -> usize {
        self.reach_px.next_multiple_of(self.period_px)
    }

    /// True if an image needs more than one tile.
    pub(super) fn divides(&self, image: &Picture) -> bool {
        let tile = self.tile_px.max(self.least_px());
        image.rows > tile || image.columns > tile
    }

    /// Returns the tiles along a side.
    fn spans(&self, length: usize) -> Vec<Span> {
        let tile = self.tile_px.max(self.least_px());
        if length <= tile {
            return vec![Span { read: 0..length, kept: 0..length }];
        }
        let margin = self.margin_px();
        let kept = (tile - 2 * margin) / self.period_px * self.period_px;
        let span = |start: usize| {
            let end = (start + kept).min(length);
            let read = start.saturating_sub(margin)..(end + margin).min(length);
            Span { read, kept: start..end }
        };
        (0..length).step_by(kept).map(span).collect()
    }
}

/// One tile along a side.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Span {
    /// Pixels that the network reads.
    read: Range<usize>,
    /// Pixels that are kept of its output.
    kept: Range<usize>,
}

/// Computes `outputs` channels of an image by tiles, clamped to [0, 1]. Fails if the network makes values that are not
/// finite.
pub(super) fn by_tiles(
    image: &Picture,
    tiling: Tiling,
    outputs: usize,
    forward: impl Fn(&Tensor) -> Result<Tensor>,
) -> Result<Planes> {
    let pixels = image.rows * image.columns;
    let mut planes = vec![0.0; outputs * pixels];
    for down in tiling.spans(image.rows) {
        for across in tiling.spans(image.columns) {
            let made = forward(&tensor_of(image, &down.read, &across.read)?)?;
            let made: Vec<f32> = made.flatten_all()?.to_vec1()?;
            // Clamping would turn them into black.
            if let Some(value) = made.iter().find(|value| !value.is_finite()) {
                candle_core::bail!("the network makes values that are not finite ({value})");
            }
            let (rows, columns) = (down.read.len(), across.read.len());
            let first = across.kept.start - across.read.start;
            for c in 0..outputs {
                for y in down.kept.clone() {
                    let from = (c * rows + y - down.read.start) * columns + first;
                    let to = c * pixels + y * image.columns + across.kept.start;
                    let line = &made[from..][..across.kept.len()];
                    for (out, value) in planes[to..][..line.len()].iter_mut().zip(line) {
                        *out = value.clamp(0.0, 1.0);
                    }
                }
            }
        }
    }
    Ok(planes)
}

/// Copies a part of an image to a tensor (1, 3, rows, columns).
pub(super) fn tensor_of(
    image: &Picture,
    rows: &Range<usize>,
    columns: &Range<usize>,
) -> Result<Tensor> {
    let mut values = Vec::with_capacity(3 * rows.len() * columns.len());
    for plane in image.planes.chunks_exact(image.rows * image.columns) {
        for y in rows.clone() {
            values.extend_from_slice(&plane[y * image.columns..][columns.clone()]);
        }
    }
    Tensor::from_vec(values, (1, 3, rows.len(), columns.len()), &Device::Cpu)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_keep_every_pixel_once_and_read_the_reach_around_it() {
        for (reach_px, period_px) in [(128, 1), (217, 32)] {
            let tiling = Tiling { tile_px: 600, reach_px, period_px };
            for length in [16, 600, 601, 640, 1000, 5000] {
                let spans = tiling.spans(length);
                let kept: Vec<usize> = spans.iter().flat_map(|span| span.kept.clone()).collect();
                assert!(kept.into_iter().eq(0..length));
                for Span { read, kept } in spans {
                    assert!(read.len() <= 600 && read.start.is_multiple_of(period_px));
                    assert!(read.start == 0 || kept.start - read.start >= reach_px);
                    assert!(read.end == length || read.end - kept.end >= reach_px);
                    assert!(read.end == length || read.len().is_multiple_of(period_px));
                }
            }
        }
    }
}
