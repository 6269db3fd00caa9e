//! Computes a run's numbers: counts, rate, time left, workers.

use super::state::{Counts, Quarantined, RunState};
use super::{SeenTuple, Snapshot};
use crate::run::attempts::AttemptRecord;
use serde::Serialize;
use std::collections::BTreeMap;
use std::time::{Duration, Instant, SystemTime};

/// Time over which rates are averaged.
const RATE_OVER: Duration = Duration::from_mins(5);

/// A run's numbers at one moment.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Status {
    /// Numbers of scenes and shards, by state.
    #[serde(flatten)]
    pub counts: Counts,
    pub state: RunState,
    /// The user's reason for pausing or cancelling the run.
    pub reason: Option<String>,
    /// Running and failed attempts at scenes without a tuple.
    pub attempts: Vec<StandingAttempt>,
    /// Workers that made tuples, those with the most tuples first.
    pub workers: Vec<WorkerTuples>,
    /// Seconds since the newest tuple was put.
    pub last_tuple_s: Option<f64>,
    /// Scenes per second over the last minutes.
    pub rate_scenes_per_s: Option<f64>,
    /// Seconds until the last tuple, by the rate of shards between refreshes, or else by the rate of scenes.
    pub eta_s: Option<f64>,
}

/// An attempt that is running or has failed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StandingAttempt {
    #[serde(flatten)]
    pub note: AttemptRecord,
    /// Seconds since the worker's last sign of life.
    pub age_s: f64,
}

/// A worker's tuples, by their provenance.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WorkerTuples {
    /// Name of the worker; `unknown` if the provenance has none.
    pub worker: String,
    /// Version of the program that made its newest tuple.
    pub version: Option<String>,
    /// Number of tuples that the worker made.
    pub tuples: u64,
    /// Seconds since its newest tuple.
    pub last_tuple_s: f64,
}

impl Snapshot {
    /// Counts scenes and shards by state.
    pub fn counts(&self) -> Counts {
        let mut counts = Counts { scenes: self.scenes.len() as u64, ..Counts::default() };
        for (index, scene) in self.scenes.iter().enumerate() {
            let shards = u64::from(self.plan.shards[index]);
            counts.shards += shards;
            if scene.is_done {
                counts.merged += 1;
                counts.shards_done += shards;
            } else if let Some(reason) = &scene.reason {
                counts.quarantined.push(Quarantined {
                    scene: self.plan.ids[index].to_string(),
                    reason: reason.to_string(),
                });
            } else {
                counts.shards_done += u64::from(scene.partials);
                counts.started += u64::from(scene.partials > 0);
                counts.waiting += u64::from(scene.partials == 0);
            }
        }
        counts
    }

    /// Computes the run's present numbers.
    pub fn status(&self) -> Status {
        let counts = self.counts();
        let state = RunState::new(counts.is_finished(), self.control.state);
        let now = self.now();
        let age = |put: SystemTime| now.duration_since(put).unwrap_or_default();
        let newest = self.tuples.iter().map(|tuple| age(tuple.put)).min();
        let (mut scene_rate, mut shard_rate) = (None, None);
        if state == RunState::Running {
            // Ages use this process's clock for tuples that it saw appear, and the store's clock for others.
            let age_of = |tuple: &SeenTuple| tuple.seen.map_or(age(tuple.put), |at| at.elapsed());
            scene_rate = rate(self.tuples.iter().map(age_of));
            shard_rate = self.shard_rate();
        }
        let shards_left = self.missing().map(|index| {
            let there = self.scenes[index].partials;
            u64::from(self.plan.shards[index].saturating_sub(there))
        });
        let by_shards = shard_rate.map(|rate| shards_left.sum::<u64>() as f64 / rate);
        let by_scenes = scene_rate.map(|rate| counts.scenes_left() as f64 / rate);
        let attempts = self.attempts().map(|attempt| StandingAttempt {
            note: attempt.record.clone(),
            age_s: age(attempt.last()).as_secs_f64(),
        });
        Status {
            state,
            reason: self.control.reason.clone(),
            attempts: attempts.collect(),
            workers: self.workers(&age),
            last_tuple_s: newest.as_ref().map(Duration::as_secs_f64),
            rate_scenes_per_s: scene_rate,
            eta_s: by_shards.or(by_scenes),
            counts,
        }
    }

    /// Returns this machine's time, or the time of the newest put if that is later, so that tuples have no negative age.
    fn now(&self) -> SystemTime {
        let newest = self.tuples.iter().map(|tuple| tuple.put).max();
        SystemTime::now().max(newest.unwrap_or(SystemTime::UNIX_EPOCH))
    }

    /// Records the progress after a refresh, for the rate.
    pub(super) fn remember(&mut self) {
        let is_old = |at: &Instant| at.elapsed() > RATE_OVER;
        while self.history.front().is_some_and(|(at, _)| is_old(at)) {
            self.history.pop_front();
        }
        let done = self.counts().shards_done;
        self.history.push_back((Instant::now(), done));
    }

    /// Returns the shards per second since the first refresh of the last minutes.
    fn shard_rate(&self) -> Option<f64> {
        let ((at, first), (_, last)) = (self.history.front()?, self.history.back()?);
        let (seconds, shards) = (at.elapsed().as_secs_f64(), last.saturating_sub(*first));
        (shards > 0 && seconds > 0.0).then(|| shards as f64 / seconds)
    }

    fn workers(&self, age: &dyn Fn(SystemTime) -> Duration) -> Vec<WorkerTuples> {
        let mut workers: BTreeMap<&str, WorkerTuples> = BTreeMap::new();
        for scene in &self.scenes {
            let (Some(put), Some(provenance)) = (scene.receipt, &scene.provenance) else {
                continue;
            };
            let name = provenance.worker.as_deref().unwrap_or("unknown");
            let age_s = age(put).as_secs_f64();
            let worker = workers.entry(name).or_insert_with(|| WorkerTuples {
                worker: name.to_owned(),
                version: None,
                tuples: 0,
                last_tuple_s: f64::MAX,
            });
            worker.tuples += 1;
            if age_s < worker.last_tuple_s {
                worker.last_tuple_s = age_s;
                worker.version.clone_from(&provenance.version);
            }
        }
        let mut workers: Vec<WorkerTuples> = workers.into_values().collect();
        // The sort is stable: workers with equal counts stay sorted by name.
        workers.sort_by_key(|worker| std::cmp::Reverse(worker.tuples));
        workers
    }
}

/// Computes recent tuples per second from the ages of all tuples. The oldest recent tuple only marks the start.
fn rate(ages: impl Iterator<Item = Duration>) -> Option<f64> {
    let recent: Vec<Duration> = ages.filter(|age| *age < RATE_OVER).collect();
    let oldest = recent.iter().max()?.as_secs_f64();
    (recent.len() > 1 && oldest > 0.0).then(|| (recent.len() - 1) as f64 / oldest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rate_covers_the_last_minutes() {
        let ages = |seconds: &[u64]| rate(seconds.iter().map(|&s| Duration::from_secs(s)));
        assert_eq!(ages(&[]), None);
        assert_eq!(ages(&[4]), None);
        assert_eq!(ages(&[400, 500]), None);
        assert_eq!(ages(&[0, 0]), None);
        assert_eq!(ages(&[10, 0, 5]), Some(0.2));
        // The rate decreases while no tuple appears.
        assert_eq!(ages(&[110, 100, 105, 9999]), Some(2.0 / 110.0));
    }
}
