//! What the farm tells whoever watches it.

use super::control::ControlState;
use crate::ids::SceneId;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Something happened. Told from worker threads.
#[derive(Clone, Debug)]
pub enum Event {
    /// Work begins.
    Started {
        /// Shards of all scenes that have no tuple yet.
        shards: u64,
        /// Scenes without a tuple.
        scenes: u64,
    },
    /// A scene is loaded; its shards will be traced.
    SceneOpened {
        /// Which.
        scene: SceneId,
    },
    /// A shard is done.
    ShardDone {
        /// Its partial was found and is intact, so it was not traced again.
        resumed: bool,
    },
    /// A partial on disk was no use.
    PartialRejected {
        /// Why, and what happens.
        reason: String,
    },
    /// A tuple is durable.
    SceneMerged {
        /// Which.
        scene: SceneId,
        /// Of its layers, the largest share of paths that ended on the continuation of a photograph's border.
        miss_share: f64,
    },
    /// The queue cannot be reached; what is held goes on.
    QueueLost {
        /// Why.
        reason: String,
    },
    /// The store is away; it is looked at again.
    StoreLost {
        /// Why.
        reason: String,
    },
    /// A scene that was lost with an earlier process is traced in one of its own.
    Isolated {
        /// Which.
        scene: SceneId,
    },
    /// That process was lost, too.
    ChildLost {
        /// With which scene.
        scene: SceneId,
        /// How.
        reason: String,
    },
    /// Too many scenes failed on this worker: it ends.
    Drained {
        /// Which, and what to do.
        reason: String,
    },
    /// The run was told to pause, to end, or to go on.
    Controlled {
        /// What it was told.
        state: ControlState,
        /// Why, if that was said.
        reason: Option<String>,
    },
    /// A scene cannot be done.
    SceneQuarantined {
        /// Which.
        scene: SceneId,
        /// Why.
        reason: String,
        /// Its shards, which will not be traced.
        shards: u64,
    },
}

/// Where the threads' seconds went, summed over threads.
#[derive(Debug, Default)]
pub struct StageSeconds {
    read: AtomicU64,
    decode: AtomicU64,
    trace: AtomicU64,
    checkpoint: AtomicU64,
    merge: AtomicU64,
}

impl StageSeconds {
    fn add(counter: &AtomicU64, time: Duration) {
        counter.fetch_add(time.as_nanos() as u64, Ordering::Relaxed);
    }

    pub(super) fn add_read(&self, time: Duration) {
        Self::add(&self.read, time);
    }

    pub(super) fn add_decode(&self, time: Duration) {
        Self::add(&self.decode, time);
    }

    pub(super) fn add_trace(&self, time: Duration) {
        Self::add(&self.trace, time);
    }

    pub(super) fn add_checkpoint(&self, time: Duration) {
        Self::add(&self.checkpoint, time);
    }

    pub(super) fn add_merge(&self, time: Duration) {
        Self::add(&self.merge, time);
    }

    /// Stage names and seconds, in pipeline order.
    pub fn all(&self) -> [(&'static str, f64); 5] {
        let seconds = |counter: &AtomicU64| counter.load(Ordering::Relaxed) as f64 * 1e-9;
        [
            ("read", seconds(&self.read)),
            ("decode", seconds(&self.decode)),
            ("trace", seconds(&self.trace)),
            ("checkpoint", seconds(&self.checkpoint)),
            ("merge", seconds(&self.merge)),
        ]
    }
}
