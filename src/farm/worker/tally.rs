//! Counts and costs of a worker's work.

use super::costs::Costs;
use super::options::Outcome;
use crate::run::{SceneSeconds, StageSeconds, Stop};
use glasshouse_line::ids::SceneId;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

#[derive(Default)]
pub(super) struct Count(AtomicU64);

impl Count {
    pub(super) fn add(&self, count: u64) {
        self.0.fetch_add(count, Ordering::Relaxed);
    }

    fn get(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}

pub(super) struct Tally {
    pub(super) merged: Count,
    pub(super) traced: Count,
    pub(super) resumed: Count,
    pub(super) donated: Count,
    pub(super) loads: Count,
    /// Number of loads in child processes, which cost this process no time.
    pub(super) sandboxed_loads: Count,
    pub(super) quarantined: Mutex<Vec<(SceneId, String)>>,
    pub(super) seconds: StageSeconds,
    pub(super) scene_seconds: SceneSeconds,
}

impl Tally {
    pub(super) fn begin() -> Self {
        Self {
            merged: Count::default(),
            traced: Count::default(),
            resumed: Count::default(),
            donated: Count::default(),
            loads: Count::default(),
            sandboxed_loads: Count::default(),
            quarantined: Mutex::default(),
            seconds: StageSeconds::begin(),
            scene_seconds: SceneSeconds::default(),
        }
    }

    /// Returns the mean costs of a shard and of a load so far; a guess replaces each unknown one.
    pub(super) fn costs(&self, threads: usize) -> Costs {
        let seconds = self.seconds.all();
        let of = |stage: &str| {
            let found = seconds.iter().find(|(name, _)| *name == stage);
            found.map_or(0.0, |(_, s)| *s)
        };
        let mean = |sum: f64, count: &Count, guess: f64| match count.get() {
            0 => guess,
            n => sum / n as f64,
        };
        Costs {
            shard_s: mean(of("trace"), &self.traced, 0.4),
            threads: threads.max(1) as f64,
            load_s: mean(of("read") + of("decode"), &self.loads, 0.1),
            load_is_known: self.loads.get() > 0,
        }
    }

    pub(super) fn outcome(self, stopped: Option<Stop>) -> Outcome {
        let quarantined = self.quarantined.into_inner();
        let mut quarantined = quarantined.expect("no holder of this lock panics");
        quarantined.sort();
        Outcome {
            merged: self.merged.get(),
            already_merged: 0,
            traced: self.traced.get(),
            resumed: self.resumed.get(),
            loaded: self.loads.get() + self.sandboxed_loads.get(),
            donated: self.donated.get(),
            quarantined,
            stopped,
            seconds: self.seconds,
        }
    }
}
