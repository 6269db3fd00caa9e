//! What the store tells of a run: what is done, by whom, who is at it, and how fast it goes.
//!
//! Objects are counted by their names; that a tuple is of this plan and version is checked where that costs nothing, in
//! a folder. Times are the store's own, and are shown, nothing else.

use super::attempts::AttemptRecord;
use super::control::{Control, ControlState};
use super::keys;
use super::quarantine::QuarantineRecord;
use super::receipt::Receipt;
use super::run_dir::Run;
use super::status::{Found, RunStatus, count};
use crate::store::{Store, StoreError};
use render::ids::SceneId;
use render::line::SceneLine;
use render::merge::{is_written, tuple_files};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::time::{Duration, Instant, SystemTime};

/// Over so long a time the rate is taken.
const RATE_OVER: Duration = Duration::from_mins(5);

/// What a run is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FarmState {
    /// Work is handed out.
    Running,
    /// Workers finish what they have opened and start nothing new until someone resumes.
    Paused,
    /// The rest was given up; what is done stays.
    Cancelled,
    /// Every scene has a tuple or is in quarantine.
    Finished,
}

impl FarmState {
    /// All states.
    pub const ALL: [Self; 4] = [Self::Running, Self::Paused, Self::Cancelled, Self::Finished];

    /// A finished run stays finished, whatever its control record says.
    pub fn new(finished: bool, control: ControlState) -> Self {
        match control {
            _ if finished => Self::Finished,
            ControlState::Running => Self::Running,
            ControlState::Paused => Self::Paused,
            ControlState::Cancelled => Self::Cancelled,
        }
    }

    /// Its name in JSON, metrics and on the page.
    pub fn name(self) -> &'static str {
        match self {
            Self::Running => "running",
            Self::Paused => "paused",
            Self::Cancelled => "cancelled",
            Self::Finished => "finished",
        }
    }
}

/// A run at one moment.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Overview {
    /// What is done.
    #[serde(flatten)]
    pub counts: RunStatus,
    /// What the run is doing, as far as a store can tell.
    pub state: FarmState,
    /// Why it was paused or cancelled, if that was said.
    pub reason: Option<String>,
    /// Spans that workers have in hand, or were lost with.
    pub attempts: Vec<StandingAttempt>,
    /// Who made tuples, by their receipts; the busiest first.
    pub workers: Vec<WorkerTuples>,
    /// Seconds since the newest tuple was put.
    pub last_tuple_s: Option<f64>,
    /// Scenes a second over the last minutes.
    pub rate_scenes_per_s: Option<f64>,
    /// Seconds until the last tuple: at the rate of shards, once there were two looks, else at that of scenes.
    pub eta_s: Option<f64>,
}

/// An attempt that stands.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StandingAttempt {
    /// What its worker wrote.
    #[serde(flatten)]
    pub note: AttemptRecord,
    /// Seconds since that.
    pub age_s: f64,
}

/// A worker by its receipts.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WorkerTuples {
    /// Its name; receipts that tell none are of `unknown`.
    pub worker: String,
    /// Version of its program, that of the newest receipt.
    pub version: Option<String>,
    /// Tuples that it made.
    pub tuples: u64,
    /// Seconds since its last.
    pub last_tuple_s: f64,
}

/// Looks at a run's store, and at the next look reads again only what may have changed.
pub struct Observer<'a> {
    run: &'a Run,
    store: &'a Store,
    done: BTreeSet<&'a SceneId>,
    receipts: BTreeMap<SceneId, Receipt>,
    attempts: BTreeMap<String, (SystemTime, AttemptRecord)>,
    /// Shards done at earlier looks.
    looks: VecDeque<(Instant, u64)>,
}

impl<'a> Observer<'a> {
    /// Of a run whose objects are in `store`.
    pub fn new(run: &'a Run, store: &'a Store) -> Self {
        Self {
            run,
            store,
            done: BTreeSet::new(),
            receipts: BTreeMap::new(),
            attempts: BTreeMap::new(),
            looks: VecDeque::new(),
        }
    }

    /// Looks.
    pub fn look(&mut self) -> Result<Overview, StoreError> {
        let control = Control::get(self.store)?;
        // Before the tuples: an attempt whose tuple is put in between is seen once too often, not never.
        let attempts = self.look_at_attempts()?;
        let receipts = self.look_at_receipts()?;
        let tuples: BTreeMap<String, SystemTime> =
            self.store.list_times(keys::TUPLES)?.into_iter().collect();
        for line in &self.run.lines {
            if !self.done.contains(&line.id) && self.is_there(line, &tuples) {
                self.done.insert(&line.id);
            }
        }
        let reasons = self.reasons()?;
        let mut partials: BTreeMap<String, BTreeSet<u32>> = BTreeMap::new();
        for key in self.store.list(keys::PARTIALS)? {
            if let (Some(scene), Some(shard)) = (scene_of(&key), keys::shard_of(&key)) {
                partials.entry(scene.to_owned()).or_default().insert(shard);
            }
        }
        let counts = count(self.run, |line| {
            if self.done.contains(&line.id) {
                return Found::Tuple;
            }
            if let Some(reason) = reasons.get(&line.id) {
                return Found::Quarantine(reason.clone());
            }
            let shards = self.run.layout(line).len();
            let there = partials.get(line.id.as_str());
            Found::Partials(there.map_or(0, |there| there.range(..shards).count() as u64))
        });
        let is_record = |line: &&SceneLine| self.done.contains(&line.id);
        let lines = self.run.lines.iter().filter(is_record);
        let times: Vec<SystemTime> = lines
            .filter_map(|line| tuples.get(&keys::tuple(&line.id, "tuple.json")).copied())
            .collect();
        let now = now(&times);
        let age = |at: SystemTime| now.duration_since(at).unwrap_or_default();
        let state = FarmState::new(counts.is_finished(), control.state);
        let ages: Vec<Duration> = times.iter().map(|&at| age(at)).collect();
        let rate = rate(&ages).filter(|_| state == FarmState::Running);
        let left = counts.started + counts.waiting;
        let by_scenes = rate.map(|rate| left as f64 / rate);
        let by_shards = self.shard_rate(counts.shards_done).map(|rate| {
            let out = self.run.lines.iter().filter(|l| !self.done.contains(&l.id));
            let out = out.filter(|l| reasons.contains_key(&l.id));
            let out: u64 = out.map(|l| u64::from(self.run.layout(l).len())).sum();
            counts.shards.saturating_sub(counts.shards_done + out) as f64 / rate
        });
        Ok(Overview {
            state,
            reason: control.reason,
            attempts: attempts
                .into_iter()
                .filter(|(_, note)| !self.done.contains(&note.scene))
                .map(|(at, note)| StandingAttempt {
                    note,
                    age_s: age(at).as_secs_f64(),
                })
                .collect(),
            workers: self.workers(&receipts, &age),
            last_tuple_s: ages.iter().min().map(Duration::as_secs_f64),
            rate_scenes_per_s: rate,
            eta_s: by_shards
                .filter(|_| state == FarmState::Running)
                .or(by_scenes),
            counts,
        })
    }

    /// Shards a second since the first of the last minutes' looks.
    fn shard_rate(&mut self, done: u64) -> Option<f64> {
        while self
            .looks
            .front()
            .is_some_and(|(at, _)| at.elapsed() > RATE_OVER)
        {
            self.looks.pop_front();
        }
        self.looks.push_back((Instant::now(), done));
        let (at, first) = *self.looks.front()?;
        let (seconds, shards) = (at.elapsed().as_secs_f64(), done.saturating_sub(first));
        (shards > 0 && seconds > 0.0).then(|| shards as f64 / seconds)
    }

    /// All files of the scene's tuple are there.
    fn is_there(&self, line: &SceneLine, listed: &BTreeMap<String, SystemTime>) -> bool {
        let is_listed = |file: &String| listed.contains_key(&keys::tuple(&line.id, file));
        let local = self.store.local_root();
        tuple_files(line).iter().all(is_listed)
            && local.is_none_or(|root| {
                is_written(&root.join(keys::TUPLES).join(line.id.as_str()), line)
            })
    }

    fn reasons(&self) -> Result<BTreeMap<SceneId, String>, StoreError> {
        let listed: BTreeSet<String> = self.store.list(keys::QUARANTINE)?.into_iter().collect();
        let mut reasons = BTreeMap::new();
        for line in &self.run.lines {
            if listed.contains(&keys::quarantine(&line.id))
                && let Some(record) = QuarantineRecord::get(self.store, &line.id)?
            {
                reasons.insert(line.id.clone(), record.reason);
            }
        }
        Ok(reasons)
    }

    fn look_at_attempts(&mut self) -> Result<Vec<(SystemTime, AttemptRecord)>, StoreError> {
        let listed: BTreeMap<String, SystemTime> =
            self.store.list_times(keys::ATTEMPTS)?.into_iter().collect();
        self.attempts
            .retain(|key, (at, _)| listed.get(key) == Some(at));
        let is_new = |key: &&String| !self.attempts.contains_key(*key);
        let new: Vec<String> = listed.keys().filter(is_new).cloned().collect();
        for (key, bytes) in new.iter().zip(self.store.get_all(&new)?) {
            if let Some(note) = bytes.and_then(|bytes| {
                let scene = SceneId::new(scene_of(key)?).ok()?;
                AttemptRecord::parse(&scene, key, &bytes)
            }) {
                self.attempts.insert(key.clone(), (listed[key], note));
            }
        }
        Ok(self.attempts.values().cloned().collect())
    }

    /// When each receipt was put.
    fn look_at_receipts(&mut self) -> Result<BTreeMap<SceneId, SystemTime>, StoreError> {
        let listed = self.store.list_times(keys::RECEIPTS)?;
        let scene = |key: &str| {
            let name = key.rsplit('/').next()?.strip_suffix(".json")?;
            SceneId::new(name).ok()
        };
        let times: BTreeMap<SceneId, SystemTime> = listed
            .iter()
            .filter_map(|(key, at)| Some((scene(key)?, *at)))
            .collect();
        let is_new = |scene: &&SceneId| !self.receipts.contains_key(*scene);
        let new: Vec<SceneId> = times.keys().filter(is_new).cloned().collect();
        let names: Vec<String> = new.iter().map(keys::receipt).collect();
        for (scene, bytes) in new.into_iter().zip(self.store.get_all(&names)?) {
            if let Some(bytes) = bytes {
                self.receipts.insert(scene, Receipt::parse(&bytes));
            }
        }
        Ok(times)
    }

    fn workers(
        &self,
        put: &BTreeMap<SceneId, SystemTime>,
        age: &dyn Fn(SystemTime) -> Duration,
    ) -> Vec<WorkerTuples> {
        let mut workers: BTreeMap<&str, WorkerTuples> = BTreeMap::new();
        for (scene, receipt) in &self.receipts {
            let name = receipt.worker.as_deref().unwrap_or("unknown");
            let age_s = put.get(scene).map_or(0.0, |&at| age(at).as_secs_f64());
            let worker = workers.entry(name).or_insert_with(|| WorkerTuples {
                worker: name.to_owned(),
                version: None,
                tuples: 0,
                last_tuple_s: f64::MAX,
            });
            worker.tuples += 1;
            if age_s < worker.last_tuple_s {
                worker.last_tuple_s = age_s;
                worker.version.clone_from(&receipt.version);
            }
        }
        let mut workers: Vec<WorkerTuples> = workers.into_values().collect();
        workers.sort_by(|a, b| {
            let busiest = b.tuples.cmp(&a.tuples);
            busiest.then_with(|| a.worker.cmp(&b.worker))
        });
        workers
    }
}

/// `partials/<scene>/…`
fn scene_of(key: &str) -> Option<&str> {
    key.split('/').nth(1)
}

/// This machine's time, or the store's newest if that is ahead: no age is below nothing.
fn now(times: &[SystemTime]) -> SystemTime {
    let newest = times.iter().max().copied();
    SystemTime::now().max(newest.unwrap_or(SystemTime::UNIX_EPOCH))
}

/// Tuples a second, from the ages of all tuples: those of the last minutes that followed the first of them.
fn rate(ages: &[Duration]) -> Option<f64> {
    let recent: Vec<f64> = ages
        .iter()
        .filter(|age| **age < RATE_OVER)
        .map(Duration::as_secs_f64)
        .collect();
    let oldest = recent.iter().copied().fold(0.0, f64::max);
    (recent.len() > 1 && oldest > 0.0).then(|| (recent.len() - 1) as f64 / oldest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rate_is_that_of_the_last_minutes() {
        let ages = |seconds: &[u64]| {
            let ages: Vec<Duration> = seconds.iter().map(|&s| Duration::from_secs(s)).collect();
            rate(&ages)
        };
        assert_eq!(ages(&[]), None);
        assert_eq!(ages(&[4]), None);
        assert_eq!(ages(&[400, 500]), None);
        assert_eq!(ages(&[0, 0]), None);
        assert_eq!(ages(&[10, 0, 5]), Some(0.2));
        // Nothing came for long: slower.
        assert_eq!(ages(&[110, 100, 105, 9999]), Some(2.0 / 110.0));
    }
}
