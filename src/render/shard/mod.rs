//! Stage 2, *who does what*: a scene becomes tile-level shards, and a run's rules are frozen in its spec.

mod golden;
mod golden_scenes;
mod layout;
mod spec;

pub use golden::{golden, pinned, whole};
pub use golden_scenes::{GoldenScene, golden_scenes};
pub use layout::{SECONDS_PER_SAMPLE, Shard, ShardLayout, choose_tile_px, samples_per_range};
pub use spec::{Golden, SPEC_SCHEMA, Spec, SpecMismatch, manifest_digest, scene_digest};
