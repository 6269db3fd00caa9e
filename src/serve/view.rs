//! The content of the status page, as plain data.
//!
//! Ages are seconds by the coordinator's monotonic clock, so that a worker's wrong clock does no harm.

use crate::run::RunState;
use render::ids::SceneId;
use serde::Serialize;

/// The schema name of a view as JSON.
pub const FARM_SCHEMA: &str = "glasshouse.farm/1";

/// A run as its coordinator sees it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FarmView {
    /// Always [`FARM_SCHEMA`].
    pub schema: &'static str,
    /// Name of the recipe or manifest.
    pub name: String,
    /// Eight hexadecimal digits of the spec's digest, as in the queue's subjects.
    pub run: String,
    /// Version of the coordinator's program.
    pub version: String,
    pub state: RunState,
    /// Scenes with a tuple, and all scenes.
    pub scenes: Count,
    /// Finished shards, and all shards.
    pub shards: Count,
    /// Number of scenes in quarantine.
    pub quarantined: u64,
    /// Finished scenes per second over the last minutes; `null` if unknown.
    pub rate_scenes_per_s: Option<f64>,
    /// Seconds until the last tuple at this rate; `null` if unknown.
    pub eta_s: Option<f64>,
    pub queue: QueueView,
    /// Known workers, in any order.
    pub workers: Vec<WorkerView>,
    /// Scenes in quarantine; may be fewer than `quarantined`.
    pub quarantine: Vec<QuarantinedScene>,
    /// The latest tuples, latest first.
    pub recent: Vec<RecentTuple>,
}

/// Finished items, and all items.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Count {
    pub done: u64,
    pub total: u64,
}

/// The queue as the coordinator sees it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct QueueView {
    /// Whether the coordinator has a connection.
    pub connected: bool,
    /// Why there is no connection.
    pub reason: Option<String>,
    /// Tasks that no worker holds; `null` if unknown.
    pub spans_waiting: Option<u64>,
    /// Tasks that a worker holds; `null` if unknown.
    pub spans_held: Option<u64>,
}

/// A worker's last known state.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WorkerView {
    /// Its name, unique in the run.
    pub name: String,
    pub host: String,
    /// Version of its program; empty if unknown.
    pub version: String,
    pub state: WorkerState,
    /// Seconds since its last progress.
    pub last_progress_s: f64,
    pub scene: Option<SceneId>,
    /// Number of its current shard in that scene.
    pub shard: Option<u32>,
    /// Shards traced since it started.
    pub shards_done: u64,
}

/// Activity of a worker.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum WorkerState {
    /// It made no progress for too long: hung, lost or disconnected.
    Silent,
    /// It requeues its tasks and exits.
    Stopping,
    Working,
    /// It has no task.
    Idle,
}

impl WorkerState {
    /// All states, the most urgent first.
    pub const ALL: [Self; 4] = [Self::Silent, Self::Stopping, Self::Working, Self::Idle];

    /// Its name in JSON, metrics and on the page.
    pub fn name(self) -> &'static str {
        match self {
            Self::Silent => "silent",
            Self::Stopping => "stopping",
            Self::Working => "working",
            Self::Idle => "idle",
        }
    }
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct QuarantinedScene {
    pub scene: SceneId,
    pub reason: String,
    /// Last lines of the log of a crashed process.
    pub log_tail: Option<String>,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RecentTuple {
    pub scene: SceneId,
    /// Seconds since it was finished.
    pub age_s: f64,
    /// The worker that merged it.
    pub worker: Option<String>,
    /// The largest share, among its layers, of paths that missed the photograph; 0 to 1.
    pub miss_share: Option<f64>,
    /// Its layers, names of [`render::layer::Layer::NAMES`].
    pub layers: Vec<String>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_of_the_json() {
        for state in WorkerState::ALL {
            assert_eq!(serde_json::to_value(state).unwrap(), state.name());
        }
    }
}
