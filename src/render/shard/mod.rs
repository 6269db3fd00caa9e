//! Divides scenes into shards (tiles times sample ranges), and defines a run's spec and the golden scenes.
//!
//! ```
//! use render::shard::ShardLayout;
//!
//! // 100 x 50 px make two tiles of 64 px, side by side; 1024 samples make four ranges of 256.
//! let layout = ShardLayout::new(100, 50, 1024, 64);
//! assert_eq!(layout.len(), 8);
//! let last = layout.shard(7);
//! assert_eq!((last.tile.x, last.tile.width, last.samples), (64, 36, 768..1024));
//! ```

mod golden;
mod golden_scenes;
mod layout;
mod spec;
#[cfg(test)]
mod sweep_tests;

pub use golden::{golden, golden_of, pinned, pinned_of, whole};
pub use golden_scenes::{GoldenScene, golden_scenes};
pub use layout::{
    MAX_SHARDS, SECONDS_PER_SAMPLE, Shard, ShardLayout, TooManyShards, choose_tile_px,
    samples_per_range,
};
pub use spec::{
    Golden, MAX_TILE_PX, SPEC_SCHEMA, Spec, SpecMismatch, manifest_digest, scene_digest,
};
