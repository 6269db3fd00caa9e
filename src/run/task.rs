//! The unit that workers lease.

use std::ops::Range;

/// Shards in a row of one scene.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Task {
    /// Its place in the manifest, from 0.
    pub scene: u32,
    /// Numbers in the scene; not empty.
    pub shards: Range<u32>,
}

impl Task {
    /// Number of shards.
    pub fn shard_count(&self) -> u32 {
        self.shards.end - self.shards.start
    }
}
