//! Divides shards into bands of rows: the shard is the unit of checkpoints, the band the unit of work stealing.
//!
//! Pixels do not depend on their tile, and paths, misses and samples are whole numbers. Bands therefore join, in any
//! order, to the same bits as a shard traced in one piece.

use crate::trace::{CELL_PX, PixelMeans, Tile, TileResult};
use glasshouse_line::label::LabelImages;
use glasshouse_line::layer::{Layer, PerLayer};
use std::sync::Mutex;

/// Largest height of a band, px: one row of an adaptive scene's cells, so small that threads wait little at the end.
pub(crate) const BAND_ROWS: u32 = CELL_PX;

pub(crate) fn bands(tile: Tile) -> u32 {
    tile.height.div_ceil(BAND_ROWS)
}

/// Returns band `index` of a tile, counted from the top.
fn band(tile: Tile, index: u32) -> Tile {
    let y = index * BAND_ROWS;
    Tile { y: tile.y + y, height: BAND_ROWS.min(tile.height - y), ..tile }
}

/// A shard divided into bands, so that several threads can trace it.
#[derive(Default)]
pub(crate) struct BandedShard {
    joined: Mutex<Joined>,
}

/// The joined result and the number of the finished bands.
#[derive(Default)]
struct Joined {
    result: Option<TileResult>,
    bands: u32,
}

impl BandedShard {
    /// Traces band `index` of the shard's `tile` with `trace`. Returns the shard's result once all bands are finished.
    pub(crate) fn trace(
        &self,
        tile: Tile,
        index: u32,
        trace: impl FnOnce(Tile) -> TileResult,
    ) -> Option<TileResult> {
        let result = trace(band(tile, index));
        let mut joined = self.joined.lock().expect("no holder of this lock panics");
        joined.bands += 1;
        if bands(tile) == 1 {
            return Some(result);
        }
        let whole = joined.result.get_or_insert_with(|| TileResult {
            pixels: vec![PixelMeans::default(); tile.width as usize * tile.height as usize],
            samples: PerLayer::default(),
            sample_sums: result.sample_sums.map(|_| PerLayer::default()),
            paths: PerLayer::default(),
            misses: PerLayer::default(),
            labels: LabelImages::new(),
        });
        let start = index as usize * BAND_ROWS as usize * tile.width as usize;
        whole.pixels[start..start + result.pixels.len()].copy_from_slice(&result.pixels);
        for (label, values) in result.labels {
            let channels = label.channels().len();
            let image = whole
                .labels
                .entry(label)
                .or_insert_with(|| vec![0.0; channels * whole.pixels.len()]);
            image[channels * start..channels * start + values.len()].copy_from_slice(&values);
        }
        for layer in Layer::ALL {
            // Adaptive scenes record the maximum. In other scenes, all bands agree.
            whole.samples[layer] = whole.samples[layer].max(result.samples[layer]);
            whole.paths[layer] += result.paths[layer];
            whole.misses[layer] += result.misses[layer];
            if let (Some(sums), Some(of_band)) = (&mut whole.sample_sums, &result.sample_sums) {
                sums[layer] += of_band[layer];
            }
        }
        if joined.bands == bands(tile) { joined.result.take() } else { None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shard::golden_scenes;
    use crate::trace::{Isa, trace_tile};

    /// Bands joined in reverse order equal the whole tile, in fixed and adaptive scenes and in most branches of
    /// the tracer. Films of 16 x 10 px cut the last band short.
    #[test]
    fn bands_join_to_the_whole_tile() {
        let isa = Isa::detect();
        let mut adaptive = 0;
        for golden in golden_scenes() {
            let scene = &golden.scene;
            let (width, height) = (scene.film.width, scene.film.height);
            let cell = if scene.target_error.is_some() { 8 } else { 1 };
            adaptive += u32::from(cell == 8);
            for (x, y) in [(0, 0), (cell, 0), (8, cell)] {
                let tile = Tile { x, y, width: width - x, height: height - y };
                let range = if cell == 8 { 0..scene.spp } else { 0..scene.spp.min(256) };
                let shard = BandedShard::default();
                let mut found = None;
                for index in (0..bands(tile)).rev() {
                    assert!(found.is_none(), "{}", golden.name);
                    let trace = |tile| trace_tile(scene, tile, range.clone(), isa);
                    found = shard.trace(tile, index, trace);
                }
                let whole = trace_tile(scene, tile, range.clone(), isa);
                assert!(found == Some(whole), "{} at ({x}, {y})", golden.name);
            }
        }
        assert!(adaptive > 0);
    }

    #[test]
    fn bands_cover_a_tile() {
        for height in 1..40 {
            let tile = Tile { x: 3, y: 8, width: 5, height };
            let mut next = 8;
            for index in 0..bands(tile) {
                let band = band(tile, index);
                assert_eq!((band.x, band.y, band.width), (3, next, 5));
                assert!(band.height > 0);
                next += band.height;
            }
            assert_eq!(next, 8 + height);
        }
    }
}
