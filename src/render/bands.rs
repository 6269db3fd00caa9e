//! A shard in bands of rows: the shard is the unit of checkpoints, the band the unit of work stealing.
//!
//! Pixels do not depend on the tile they are traced in, and paths, misses and samples are whole numbers. A shard joined from
//! bands in any order therefore has the bits of the shard traced in one piece.

use crate::layer::{Layer, PerLayer};
use crate::trace::{CELL_PX, PixelMeans, Tile, TileResult};
use std::sync::Mutex;

/// Rows of a band: whole cells of adaptive scenes, and few, so that no thread waits long for the last band.
pub(crate) const BAND_ROWS: u32 = CELL_PX;

pub(crate) fn bands(tile: Tile) -> u32 {
    tile.height.div_ceil(BAND_ROWS)
}

/// Band `index` of a tile, from the top.
fn band(tile: Tile, index: u32) -> Tile {
    let y = index * BAND_ROWS;
    Tile { y: tile.y + y, height: BAND_ROWS.min(tile.height - y), ..tile }
}

/// A shard in bands, which any free thread may trace.
#[derive(Default)]
pub(crate) struct BandedShard {
    joined: Mutex<Joined>,
}

/// The bands that are done.
#[derive(Default)]
struct Joined {
    result: Option<TileResult>,
    bands: u32,
}

impl BandedShard {
    /// Traces band `index` of the shard's `tile` with `trace`; the last band returns the whole shard's result.
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
        });
        let start = index as usize * BAND_ROWS as usize * tile.width as usize;
        whole.pixels[start..start + result.pixels.len()].copy_from_slice(&result.pixels);
        for layer in Layer::ALL {
            // Adaptive scenes record the maximum; in other scenes all bands agree.
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

    /// Fixed and adaptive scenes, every branch of the tracer; films of 16 x 10 px, so the last band is cut off. Bands come
    /// last first.
    #[test]
    fn bands_make_the_whole_tile() {
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
