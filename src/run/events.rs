//! Events of a worker or coordinator.

use super::control::ControlState;
use render::ids::SceneId;

/// An event; reported from worker threads.
#[derive(Clone, Debug)]
pub enum Event {
    Started {
        /// Shards of all scenes without a tuple.
        shards: u64,
        /// Scenes without a tuple.
        scenes: u64,
    },
    /// A scene is loaded; its shards will be traced.
    SceneOpened { scene: SceneId },
    ShardDone {
        /// An intact partial was found, so it was not traced again.
        resumed: bool,
    },
    /// A partial on disk is damaged or of another plan.
    PartialRejected {
        /// The damage, and what happens next.
        reason: String,
    },
    /// A tuple is durable.
    SceneMerged {
        scene: SceneId,
        /// The largest share, among its layers, of paths that ended beyond a photograph's border.
        miss_share: f64,
    },
    /// The queue cannot be reached; leased tasks continue.
    QueueLost { reason: String },
    /// The store cannot be reached; the call is repeated.
    StoreLost { reason: String },
    /// A scene that was lost with an earlier process is traced in a child process.
    Sandboxed { scene: SceneId },
    /// That child process was lost, too.
    ChildLost { scene: SceneId, reason: String },
    /// This process aborts, as `--fault` asked.
    Aborts {
        /// The scene at which it aborts.
        scene: SceneId,
    },
    /// Too many scenes failed on this worker, so it ends.
    Drained {
        /// Which scenes, and what to do.
        reason: String,
    },
    /// The run was paused, cancelled or resumed.
    Controlled {
        state: ControlState,
        /// Why, if the user gave a reason.
        reason: Option<String>,
    },
    /// A scene was put into quarantine.
    SceneQuarantined {
        scene: SceneId,
        reason: String,
        /// Its shards, which are not traced.
        shards: u64,
    },
}
