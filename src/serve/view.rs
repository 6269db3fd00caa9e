//! What the status page shows of a run, as plain data.
//!
//! Ages are seconds by the coordinator's monotonic clock, so that a worker's wrong clock shows nowhere.

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
    /// What the run is doing.
    pub state: RunState,
    /// Scenes with a tuple, of all.
    pub scenes: Count,
    /// Shards done, of all.
    pub shards: Count,
    /// Scenes in quarantine, all of them.
    pub quarantined: u64,
    /// Scenes finished a second, over the last minutes; `null` until something can be said.
    pub rate_scenes_per_s: Option<f64>,
    /// Seconds until the last tuple at this rate; `null` if unknown.
    pub eta_s: Option<f64>,
    pub queue: QueueView,
    /// Workers heard of, in any order.
    pub workers: Vec<WorkerView>,
    /// Scenes in quarantine, latest first; may be fewer than `quarantined`.
    pub quarantine: Vec<QuarantinedScene>,
    /// Tuples made last, latest first; a dozen is plenty.
    pub recent: Vec<RecentTuple>,
}

/// A count of finished things, of all.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Count {
    pub done: u64,
    pub total: u64,
}

/// The queue as the coordinator sees it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct QueueView {
    /// The coordinator has a connection.
    pub connected: bool,
    /// Why not, in a sentence.
    pub reason: Option<String>,
    /// Spans that no worker holds; `null` if unknown.
    pub spans_waiting: Option<u64>,
    /// Spans that a worker holds; `null` if unknown.
    pub spans_held: Option<u64>,
}

/// A worker as the coordinator last heard of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WorkerView {
    /// Its name, unique in the run.
    pub name: String,
    /// The machine that it runs on.
    pub host: String,
    /// Version of its program; empty if it is not known yet.
    pub version: String,
    /// What it is doing.
    pub state: WorkerState,
    /// Seconds since its last progress.
    pub last_progress_s: f64,
    /// The scene it works on.
    pub scene: Option<SceneId>,
    /// Number of the shard it works on, in that scene.
    pub shard: Option<u32>,
    /// Shards that it has traced since it started.
    pub shards_done: u64,
}

/// What a worker is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum WorkerState {
    /// It made no progress for too long: hung, lost or cut off.
    Silent,
    /// It requeues its spans and ends.
    Stopping,
    Working,
    /// It has nothing to do.
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
    /// The last lines of the crashed process's log, if one crashed.
    pub log_tail: Option<String>,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RecentTuple {
    pub scene: SceneId,
    /// Seconds since it was finished.
    pub age_s: f64,
    /// The worker that finished it.
    pub worker: Option<String>,
    /// The largest share, among its layers, of paths that met nothing or ended on a border's continuation; 0 to 1.
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
