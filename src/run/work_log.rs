//! Logs that workers write when they end, `RUN/logs/work-*.json`. Only the report uses them. A killed worker
//! writes none.

use super::json_line;
use super::keys;
use super::open::Run;
use crate::store::{Store, StoreError};
use glasshouse_line::ids::SceneId;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Mutex;
use std::time::{Duration, Instant, SystemTime};

/// Schema of a [`WorkLog`].
pub(crate) const WORK_LOG_SCHEMA: &str = "glasshouse.work_log/1";

/// `logs/work-<milliseconds>-<worker>.json`, one per process. Fields that another version does not write are empty.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct WorkLog {
    pub(crate) schema: String,
    pub(crate) worker: String,
    pub(crate) host: String,
    pub(crate) version: String,
    pub(crate) tracer_version: u32,
    /// True if the process was a worker's child, for a scene that was lost with an earlier process.
    pub(crate) is_child: bool,
    pub(crate) threads: u32,
    /// Start, seconds since 1970 by the worker's clock.
    pub(crate) started_unix_s: f64,
    pub(crate) wall_s: f64,
    /// Reason for an early end, if any: `signal`, `time_limit`, `drained`, `cancelled`.
    pub(crate) stopped: Option<String>,
    pub(crate) merged: u64,
    pub(crate) shards_traced: u64,
    /// Number of shards that already had a partial.
    pub(crate) shards_resumed: u64,
    pub(crate) scenes_loaded: u64,
    /// Wall-clock seconds by stage, summed over threads.
    pub(crate) thread_seconds: BTreeMap<String, f64>,
    /// CPU seconds of the process: before work started, by stage, and the rest.
    pub(crate) cpu_seconds: BTreeMap<String, f64>,
    /// Cost of tracing, by scene.
    pub(crate) scenes: Vec<SceneTrace>,
}

/// A worker's share of a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct SceneTrace {
    pub(crate) scene: SceneId,
    /// Shards that the worker traced.
    pub(crate) shards: u32,
    /// CPU seconds of the tracer.
    pub(crate) cpu_s: f64,
}

/// Start time of a worker.
pub(crate) struct LogTime {
    pub(crate) clock: SystemTime,
    pub(crate) start: Instant,
}

impl LogTime {
    pub(crate) fn now() -> Self {
        Self { clock: SystemTime::now(), start: Instant::now() }
    }
}

/// Shards and CPU time of the tracer, by index of the scene.
#[derive(Default)]
pub(crate) struct SceneSeconds(Mutex<BTreeMap<u32, (u32, Duration)>>);

impl SceneSeconds {
    /// Adds the CPU time of a traced band.
    pub(crate) fn add(&self, scene: u32, cpu: Duration) {
        self.change(scene, |(_, total)| *total += cpu);
    }

    /// Counts a shard when its last band is traced.
    pub(crate) fn add_shard(&self, scene: u32) {
        self.change(scene, |(shards, _)| *shards += 1);
    }

    fn change(&self, scene: u32, change: impl FnOnce(&mut (u32, Duration))) {
        let mut scenes = self.0.lock().expect("no holder of this lock panics");
        change(scenes.entry(scene).or_default());
    }

    /// Returns the entries of the log.
    pub(crate) fn of(&self, run: &Run) -> Vec<SceneTrace> {
        let scenes = self.0.lock().expect("no holder of this lock panics");
        let trace = |(&scene, &(shards, cpu)): (&u32, &(u32, Duration))| SceneTrace {
            scene: run.lines[scene as usize].id.clone(),
            shards,
            cpu_s: cpu.as_secs_f64(),
        };
        scenes.iter().map(trace).collect()
    }
}

impl WorkLog {
    /// Puts the log, unless the worker did nothing. Ignores a failure, because the report states the number of tuples
    /// without a log.
    pub(crate) fn leave(&self, store: &Store) {
        if self.merged + self.shards_traced + self.scenes_loaded == 0 {
            return;
        }
        let _ = store.with_patience(Duration::ZERO).create(&self.key(), &json_line(self));
    }

    /// Returns a unique key: two processes with the same worker name do not start in the same millisecond.
    fn key(&self) -> String {
        let safe = |c: char| {
            if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '_' }
        };
        let worker: String = self.worker.chars().map(safe).take(100).collect();
        let milliseconds = (self.started_unix_s * 1e3) as u64;
        format!("{}/work-{milliseconds:013}-{worker}.json", keys::LOGS)
    }

    /// True if the log's times are finite and not negative, so that the report can add them.
    fn is_sound(&self) -> bool {
        let seconds = self.thread_seconds.values().chain(self.cpu_seconds.values());
        let scenes = self.scenes.iter().map(|scene| &scene.cpu_s);
        let mut all = seconds.chain(scenes).chain([&self.wall_s]);
        all.all(|s| s.is_finite() && *s >= 0.0)
    }
}

/// Reads a run's logs, oldest first, and the keys of damaged logs.
pub(crate) fn read_logs(store: &Store) -> Result<(Vec<WorkLog>, Vec<String>), StoreError> {
    let mut keys = store.list(keys::LOGS)?;
    keys.retain(|key| {
        let name = key.rsplit('/').next().unwrap_or_default();
        name.starts_with("work-") && name.strip_suffix(".json").is_some()
    });
    keys.sort();
    let (mut logs, mut damaged) = (Vec::new(), Vec::new());
    store.for_each(&keys, |index, bytes| {
        match bytes.map(|bytes| serde_json::from_slice::<WorkLog>(&bytes)) {
            None => {}
            Some(Ok(log)) if log.is_sound() => logs.push(log),
            Some(_) => damaged.push(keys[index].clone()),
        }
    })?;
    Ok((logs, damaged))
}

/// Reason for an early end of the work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    Asked,
    TimeLimit,
    /// Too many scenes in a row failed on this worker.
    Drained,
    /// The run was cancelled.
    Cancelled,
}

impl Stop {
    /// Returns the reason's name in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Asked => "signal",
            Self::TimeLimit => "time_limit",
            Self::Drained => "drained",
            Self::Cancelled => "cancelled",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn logs_are_read_back_and_damaged_ones_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::local(folder.path()).unwrap();
        let log = |worker: &str, merged, started_unix_s| WorkLog {
            schema: WORK_LOG_SCHEMA.to_owned(),
            worker: worker.to_owned(),
            merged,
            started_unix_s,
            thread_seconds: BTreeMap::from([("trace".to_owned(), 1.5)]),
            ..WorkLog::default()
        };
        let (late, early) = (log("a/../b c", 3, 2000.25), log("x", 1, 1000.0));
        late.leave(&store);
        early.leave(&store);
        // A worker that did nothing leaves no log.
        log("idle", 0, 1.0).leave(&store);
        store.create("logs/work-0.json", b"{").unwrap();
        store.create("logs/other.txt", b"{").unwrap();
        let endless = br#"{"merged":1,"wall_s":-1}"#;
        store.create("logs/work-1.json", endless).unwrap();
        let (logs, damaged) = read_logs(&store).unwrap();
        assert_eq!(logs, [early, late]);
        assert_eq!(damaged, ["logs/work-0.json", "logs/work-1.json"]);
        let keys = store.list("logs").unwrap();
        assert!(keys.contains(&"logs/work-0000002000250-a_.._b_c.json".to_owned()), "{keys:?}");
    }

    #[test]
    fn fields_of_a_later_version_are_ignored() {
        let log: WorkLog =
            serde_json::from_str(r#"{"worker":"w","scenes":[],"new":{"x":1}}"#).unwrap();
        assert_eq!(log.worker, "w");
    }
}
