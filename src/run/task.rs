//! The unit of work that a worker leases from the queue.

use std::ops::Range;

/// Consecutive shards of one scene.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Task {
    /// Index of the scene in the manifest.
    pub scene: u32,
    /// Indices of the shards in the scene; not empty.
    pub shards: Range<u32>,
}

impl Task {
    pub fn shard_count(&self) -> u32 {
        self.shards.end - self.shards.start
    }
}
