//! Events of a worker or coordinator.

use super::control::ControlState;
use glasshouse_line::ids::SceneId;

/// An event, reported by a thread of a worker or coordinator.
#[derive(Clone, Debug)]
pub enum Event {
    Started {
        /// Number of shards of the `scenes`; a coordinator counts each scene as one shard.
        shards: u64,
        /// In a farm, the number of all scenes; on one machine, the number of scenes without a tuple.
        scenes: u64,
    },
    /// A scene is loaded; its shards are traced next.
    SceneOpened { scene: SceneId },
    ShardDone {
        /// True if the shard's result already existed, so that the shard was not traced again.
        resumed: bool,
    },
    /// A partial is damaged or belongs to another plan.
    PartialRejected {
        /// Damage to the partial and its consequence.
        reason: String,
    },
    /// A tuple is durable.
    SceneMerged {
        scene: SceneId,
        /// Largest share of a layer's paths that end beyond a photograph's border; 0 if unknown.
        miss_share: f64,
        /// True if the intrinsics of a photograph are probably wrong.
        has_odd_view: bool,
    },
    /// The queue cannot be reached; work on leased tasks continues.
    QueueLost { reason: String },
    /// A message named no task of this run and was removed from the queue.
    MessageRemoved { reason: String },
    /// The store shows no work at a scene although the queue has messages of it: the coordinator publishes it again.
    SceneStalled {
        scene: SceneId,
        /// Time without progress, s.
        for_s: f64,
    },
    /// The store cannot be reached; the caller repeats the call.
    StoreLost { reason: String },
    /// A child process traces a scene that was lost with an earlier process.
    Sandboxed { scene: SceneId },
    /// The child process of a [`Event::Sandboxed`] scene was lost, too.
    ChildLost { scene: SceneId, reason: String },
    /// This process aborts because of `--fault`.
    Aborts {
        /// Scene of the fault.
        scene: SceneId,
    },
    /// Too many scenes in a row failed on this worker, so the worker ends.
    Drained {
        /// The failed scenes and a remedy.
        reason: String,
    },
    /// The run was paused, cancelled or resumed.
    Controlled {
        state: ControlState,
        /// The user's reason, if any.
        reason: Option<String>,
    },
    /// A scene was put into quarantine.
    SceneQuarantined {
        scene: SceneId,
        reason: String,
        /// Number of its shards, which are not traced.
        shards: u64,
    },
}
