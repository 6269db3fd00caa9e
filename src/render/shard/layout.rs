//! Divides a scene into shards: tiles times sample ranges, numbered from 0.

use crate::trace::Tile;
use glasshouse_line::SceneLine;
use glasshouse_line::ids::SceneId;
use std::ops::Range;

/// Returns the samples per pixel of a shard: all if `spp` is at most 256, otherwise a sixteenth, but at least 256. (A
/// shard of an adaptive scene has all samples; see [`ShardLayout::of`].) This number is part of the tracer's
/// definition, because means are rounded to f32 once per range.
pub fn samples_per_range(spp: u32) -> u32 {
    spp.min((spp / 16).max(256))
}

/// Approximate time that one core needs for a camera sample, s. It serves to choose tile sizes and estimate durations.
pub const SECONDS_PER_SAMPLE: f64 = 2.5e-8;

/// Desired minimum duration of a shard, s, which keeps checkpoints cheap.
const SHARD_SECONDS: f64 = 0.2;

/// Available side lengths of a tile, px.
const TILES_PX: [u32; 4] = [64, 96, 128, 256];

/// Chooses the smallest tile with at least 0.2 s per shard on average over the manifest, otherwise 256 px.
pub fn choose_tile_px(lines: &[SceneLine]) -> u32 {
    let seconds = |tile_px: u32| {
        let cost = |line: &SceneLine| {
            let pixels =
                f64::from(line.film.width.min(tile_px)) * f64::from(line.film.height.min(tile_px));
            pixels * f64::from(samples_per_range(line.film.spp)) * SECONDS_PER_SAMPLE
        };
        lines.iter().map(cost).sum::<f64>() / lines.len().max(1) as f64
    };
    let enough = TILES_PX.into_iter().find(|&tile_px| seconds(tile_px) >= SHARD_SECONDS);
    enough.unwrap_or(TILES_PX[TILES_PX.len() - 1])
}

/// Largest number of shards of a scene. The smallest automatic tile gives the largest film 1,048,576.
pub const MAX_SHARDS: u64 = 1 << 20;

/// A scene with more shards than [`MAX_SHARDS`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "tiles of {tile_px} px divide scene {scene} into {shards} shards, more than {MAX_SHARDS}: plan with a larger --tile"
)]
pub struct TooManyShards {
    pub scene: SceneId,
    pub tile_px: u32,
    pub shards: u64,
}

/// A tile and a range of samples: the unit of tracing. Its result is a pure function of the scene and these fields.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shard {
    /// Index of the shard in the scene.
    pub index: u32,
    pub tile: Tile,
    /// Indices of each pixel's samples.
    pub samples: Range<u32>,
}

/// The division of one scene into shards.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ShardLayout {
    width: u32,
    height: u32,
    spp: u32,
    samples_per_range: u32,
    tile_px: u32,
}

impl ShardLayout {
    /// Divides a film of `width` x `height` px with `spp` samples into tiles of `tile_px` and ranges of samples.
    pub fn new(width: u32, height: u32, spp: u32, tile_px: u32) -> Self {
        assert!(width > 0 && height > 0 && spp > 0 && tile_px > 0, "an empty film has no shards");
        Self { width, height, spp, samples_per_range: samples_per_range(spp), tile_px }
    }

    /// Divides the scene of a manifest line. An adaptive scene has one range, because a cell's sample count depends
    /// on all of its earlier samples. The tiles of such a scene consist of whole cells, so `tile_px` is rounded up.
    pub fn of(line: &SceneLine, tile_px: u32) -> Self {
        let (film, cell) = (&line.film, crate::trace::CELL_PX);
        if film.target_error.is_none() {
            return Self::new(film.width, film.height, film.spp, tile_px);
        }
        Self {
            samples_per_range: film.spp,
            ..Self::new(film.width, film.height, film.spp, tile_px.next_multiple_of(cell))
        }
    }

    /// Checks that each scene has at most [`MAX_SHARDS`] shards with tiles of `tile_px`.
    pub fn check(lines: &[SceneLine], tile_px: u32) -> Result<(), TooManyShards> {
        for line in lines {
            let layout = Self::of(line, tile_px);
            let columns = u64::from(layout.width.div_ceil(layout.tile_px));
            let rows = u64::from(layout.height.div_ceil(layout.tile_px));
            let shards = columns * rows * u64::from(layout.ranges());
            if shards > MAX_SHARDS {
                return Err(TooManyShards { scene: line.id.clone(), tile_px, shards });
            }
        }
        Ok(())
    }

    /// Returns the number of sample ranges of each tile.
    pub fn ranges(&self) -> u32 {
        self.spp / self.samples_per_range
    }

    /// Returns the number of shards of the scene.
    pub fn len(&self) -> u32 {
        self.width.div_ceil(self.tile_px) * self.height.div_ceil(self.tile_px) * self.ranges()
    }

    /// Returns false, because every film has a pixel.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns shard `index`. Tiles are numbered row by row, ranges within each tile. Panics if `index` is too large.
    pub fn shard(&self, index: u32) -> Shard {
        assert!(index < self.len(), "shard {index} of {}", self.len());
        let (tile, range) = (index / self.ranges(), index % self.ranges());
        let columns = self.width.div_ceil(self.tile_px);
        let (x, y) = (tile % columns * self.tile_px, tile / columns * self.tile_px);
        let samples = self.samples_per_range;
        Shard {
            index,
            tile: Tile {
                x,
                y,
                width: self.tile_px.min(self.width - x),
                height: self.tile_px.min(self.height - y),
            },
            samples: range * samples..(range + 1) * samples,
        }
    }

    pub fn shards(&self) -> impl Iterator<Item = Shard> + '_ {
        (0..self.len()).map(|index| self.shard(index))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn shards_cover_every_pixel_and_sample_once(
            width in 1u32..200, height in 1u32..200, spp_log2 in 0u32..13, tile_px in 1u32..300
        ) {
            let spp = 1 << spp_log2;
            let layout = ShardLayout::new(width, height, spp, tile_px);
            let mut covered = vec![0u64; (width * height) as usize];
            for (index, shard) in layout.shards().enumerate() {
                prop_assert_eq!(shard.index as usize, index);
                let count = shard.samples.end - shard.samples.start;
                prop_assert!(count.is_power_of_two() && shard.samples.start % count == 0);
                for y in 0..shard.tile.height {
                    for x in 0..shard.tile.width {
                        covered[((shard.tile.y + y) * width + shard.tile.x + x) as usize] += u64::from(count);
                    }
                }
            }
            prop_assert!(covered.iter().all(|&n| n == u64::from(spp)));
        }
    }

    #[test]
    fn ranges_hold_all_or_256_samples_or_a_sixteenth() {
        for (spp, range) in [(1, 1), (256, 256), (1024, 256), (4096, 256), (65536, 4096)] {
            assert_eq!(samples_per_range(spp), range);
        }
    }
}
