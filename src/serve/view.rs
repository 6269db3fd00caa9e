//! Content of the status page, as plain data.
//!
//! Ages are seconds by the coordinator's monotonic clock, so that a worker's wrong clock does no harm.

use crate::run::RunState;
use glasshouse_line::ids::SceneId;
use serde::Serialize;

/// Schema name of a view as JSON.
pub const FARM_SCHEMA: &str = "glasshouse.farm/1";

/// A run, from its coordinator's observations.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FarmView {
    /// Always [`FARM_SCHEMA`].
    pub schema: &'static str,
    /// Name of the run's folder.
    pub name: String,
    /// First 16 hexadecimal digits of the spec's digest; the queue's subjects contain eight of them.
    pub run: String,
    /// Version of the coordinator's program.
    pub version: String,
    pub state: RunState,
    /// Number of scenes with a tuple, and of all scenes.
    pub scenes: Count,
    /// Number of finished shards, and of all shards.
    pub shards: Count,
    /// Number of scenes in quarantine.
    pub quarantined: u64,
    /// Finished scenes per second over the last minutes; `null` if unknown.
    pub rate_scenes_per_s: Option<f64>,
    /// Seconds until the last tuple, by the rate of shards, or else by the rate of scenes; `null` if unknown.
    pub eta_s: Option<f64>,
    pub queue: QueueView,
    /// Known workers, in no particular order.
    pub workers: Vec<WorkerView>,
    /// Scenes in quarantine; the list may be shorter than `quarantined`.
    pub quarantine: Vec<QuarantinedScene>,
    /// Latest tuples, newest first.
    pub recent: Vec<RecentTuple>,
}

/// Number of finished items, and of all items.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Count {
    pub done: u64,
    pub total: u64,
}

/// The queue, from the coordinator's observations.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct QueueView {
    /// True if the coordinator has a connection.
    pub connected: bool,
    /// Reason for a missing connection.
    pub reason: Option<String>,
    /// Number of tasks that no worker holds; `null` if unknown.
    pub spans_waiting: Option<u64>,
    /// Number of tasks that workers hold; `null` if unknown.
    pub spans_held: Option<u64>,
}

/// A worker's last known state.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WorkerView {
    /// Name, unique in the run.
    pub name: String,
    pub host: String,
    /// Version of the worker's program; empty if unknown.
    pub version: String,
    pub state: WorkerState,
    /// Seconds since the last sign of life: a new task, a tuple, or the sign that a worker with a task puts once in a lease.
    pub last_progress_s: f64,
    pub scene: Option<SceneId>,
    /// Index of the task's first shard in the scene.
    pub shard: Option<u32>,
    /// Number of shards of the tuples that the worker has made since the coordinator started.
    pub shards_done: u64,
}

/// Activity of a worker.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum WorkerState {
    /// The worker has a task and gave no sign of life for two leases: it is killed, hung or disconnected.
    Lost,
    /// The worker requeues its tasks and exits.
    Stopping,
    Working,
    /// The worker has no task.
    Idle,
}

impl WorkerState {
    /// All states, the most urgent first.
    pub const ALL: [Self; 4] = [Self::Lost, Self::Stopping, Self::Working, Self::Idle];

    /// Returns the name of the state in JSON, in metrics and on the page.
    pub fn name(self) -> &'static str {
        match self {
            Self::Lost => "lost",
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
    /// Seconds since the coordinator found the tuple; 0 if the tuple is older than the coordinator.
    pub age_s: f64,
    /// Worker that merged the tuple, if known.
    pub worker: Option<String>,
    /// Largest share of paths that missed the photograph, among the layers, 0 to 1.
    pub miss_share: Option<f64>,
    /// Names of the layers in the tuple, from [`glasshouse_line::layer::Layer::NAMES`].
    pub layers: Vec<String>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_equal_the_json_values() {
        for state in WorkerState::ALL {
            assert_eq!(serde_json::to_value(state).unwrap(), state.name());
        }
    }
}
