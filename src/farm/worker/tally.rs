//! What a worker has done, and what it cost.

use super::costs::Costs;
use super::options::Outcome;
use crate::run::{SceneSeconds, StageSeconds, Stop};
use render::ids::SceneId;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

/// Counts, and seconds by stage and by scene.
pub(super) struct Tally {
    merged: AtomicU64,
    traced: AtomicU64,
    resumed: AtomicU64,
    donated: AtomicU64,
    loads: AtomicU64,
    /// Those of children, which did not cost this process anything.
    sandboxed_loads: AtomicU64,
    quarantined: Mutex<Vec<(SceneId, String)>>,
    pub(super) seconds: StageSeconds,
    /// What tracing cost here, by scene.
    pub(super) scene_seconds: SceneSeconds,
}

impl Tally {
    pub(super) fn begin() -> Self {
        Self {
            merged: AtomicU64::new(0),
            traced: AtomicU64::new(0),
            resumed: AtomicU64::new(0),
            donated: AtomicU64::new(0),
            loads: AtomicU64::new(0),
            sandboxed_loads: AtomicU64::new(0),
            quarantined: Mutex::default(),
            seconds: StageSeconds::begin(),
            scene_seconds: SceneSeconds::default(),
        }
    }

    pub(super) fn add_merged(&self, count: u64) {
        self.merged.fetch_add(count, Ordering::Relaxed);
    }

    pub(super) fn add_traced(&self, count: u64) {
        self.traced.fetch_add(count, Ordering::Relaxed);
    }

    pub(super) fn add_resumed(&self, count: u64) {
        self.resumed.fetch_add(count, Ordering::Relaxed);
    }

    pub(super) fn add_donated(&self, count: u64) {
        self.donated.fetch_add(count, Ordering::Relaxed);
    }

    pub(super) fn add_load(&self) {
        self.loads.fetch_add(1, Ordering::Relaxed);
    }

    pub(super) fn add_sandboxed_loads(&self, count: u64) {
        self.sandboxed_loads.fetch_add(count, Ordering::Relaxed);
    }

    pub(super) fn add_quarantined(&self, scene: &SceneId, reason: &str) {
        let mut quarantined = self.quarantined.lock().expect("no holder of this lock panics");
        quarantined.push((scene.clone(), reason.to_owned()));
    }

    /// What a shard and a scene cost on `threads` threads so far.
    pub(super) fn costs(&self, threads: usize) -> Costs {
        let seconds = self.seconds.all();
        let of = |stage: &str| {
            let found = seconds.iter().find(|(name, _)| *name == stage);
            found.map_or(0.0, |(_, s)| *s)
        };
        let mean = |sum: f64, count: &AtomicU64, guess: f64| match count.load(Ordering::Relaxed) {
            0 => guess,
            n => sum / n as f64,
        };
        Costs {
            shard_s: mean(of("trace"), &self.traced, 0.4),
            threads: threads.max(1) as f64,
            load_s: mean(of("read") + of("decode"), &self.loads, 0.1),
            load_is_known: self.loads.load(Ordering::Relaxed) > 0,
        }
    }

    pub(super) fn outcome(self, stopped: Option<Stop>) -> Outcome {
        let quarantined = self.quarantined.into_inner();
        let mut quarantined = quarantined.expect("no holder of this lock panics");
        quarantined.sort();
        Outcome {
            merged: self.merged.into_inner(),
            already_merged: 0,
            traced: self.traced.into_inner(),
            resumed: self.resumed.into_inner(),
            loaded: self.loads.into_inner() + self.sandboxed_loads.into_inner(),
            donated: self.donated.into_inner(),
            quarantined,
            stopped,
            seconds: self.seconds,
        }
    }
}
