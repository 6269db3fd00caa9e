//! Records of attempts, which reveal scenes that kill their workers.
//!
//! A worker that takes a task first puts `attempts/<scene>/<start>-<end>.<n>.json` and removes it when the task ends
//! normally. A remaining record belongs to a running or to a failed attempt. As long as the worker holds its lease, it
//! puts a sign of life beside the record, once in a lease (`<start>-<end>.<n>.sign`).
//!
//! The queue's messages prove nothing: any client may publish, repeat or give back any of them. So an attempt counts as
//! lost only by what is in the store: the parent of a child process has recorded the child's death, or neither the record
//! nor its sign was put for more than two leases, by the store's clock. A task with a record of another worker is only
//! *suspect*: a child process traces it. After four losses without new partials, its scene goes into quarantine; an
//! attempt of which it is unknown whether it is lost counts, too, but only one.
//!
//! A death that a parent has seen is certain. Silence is a presumption, because a worker may only be slow: a process
//! counts once, however many tasks it had, a later sign of life takes the presumption back, and a worker that would
//! condemn a scene on presumptions first waits for two more leases and looks again.

use super::json_line;
use super::keys;
use super::task::Task;
use crate::store::{Store, StoreError};
use glasshouse_line::ids::SceneId;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::OnceLock;
use std::time::{Duration, SystemTime};

/// Schema of an [`AttemptRecord`].
pub const ATTEMPT_SCHEMA: &str = "glasshouse.attempt/1";

/// Number of leases without a sign of life after which an attempt counts as lost. A worker gives one sign in a lease.
pub(crate) const SILENT_LEASES: u32 = 2;

/// Number of losses without new partials in between, or of failed reads, that put a scene into quarantine.
pub const MOST_LOST: u32 = 4;

/// Number of machines with failed reads of a scene's files after which the scene goes into quarantine.
const HOSTS_TO_REFUSE: usize = 2;

/// Content of `attempts/<scene>/<start>-<end>.<n>.json`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AttemptRecord {
    /// Always [`ATTEMPT_SCHEMA`].
    pub schema: String,
    pub scene: SceneId,
    /// First shard, and one past the last.
    pub shards: [u32; 2],
    /// Number of the attempt at these shards, from 1.
    pub n: u32,
    pub worker: String,
    /// Time at which the worker's process began, in microseconds since 1970: processes may have the same name.
    pub started_us: u64,
    pub host: String,
    /// Number of the shards that had a partial before the attempt.
    pub found: u32,
    /// Failure of the attempt; `null` while it runs.
    pub ended: Option<Ending>,
}

/// A worker's record of a failure.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ending {
    pub kind: EndKind,
    pub reason: String,
    /// Last lines of the child process's log.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub log_tail: String,
}

/// Kind of an attempt's failure.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EndKind {
    /// The worker's lease expired; the next worker records this.
    Lost,
    /// The child process died, or the record is damaged.
    Crashed,
    /// The child process made no progress and exited or was killed.
    Hung,
    /// The scene's files cannot be read on the worker's machine.
    Unreadable,
}

/// A worker and its machine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WorkerName {
    /// Name of the process, unique.
    pub worker: String,
    /// Name of the machine, shared by all its workers.
    pub host: String,
}

/// Verdict on a task from its earlier attempts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum PoisonCheck {
    /// No attempt was lost.
    Clean,
    /// The task may have killed a worker: only a child process may trace it.
    Suspect,
    /// The task has killed too many processes: its scene goes into quarantine for this reason.
    Poison(String),
}

impl AttemptRecord {
    pub(crate) fn new(scene: &SceneId, task: &Task, worker: &WorkerName, found: u32) -> Self {
        Self {
            schema: ATTEMPT_SCHEMA.to_owned(),
            scene: scene.clone(),
            shards: [task.shards.start, task.shards.end],
            n: 1,
            worker: worker.worker.clone(),
            started_us: started_us(),
            host: worker.host.clone(),
            found,
            ended: None,
        }
    }

    /// Parses the record under `key`; returns `None` for a key of another kind. A damaged record counts as lost.
    pub(crate) fn parse(scene: &SceneId, key: &str, bytes: &[u8]) -> Option<Self> {
        let ([start, end], n) = keys::attempt_of(key)?;
        let damaged = |e| {
            let unknown = WorkerName { worker: "unknown".to_owned(), host: "unknown".to_owned() };
            let ended = Some(Ending {
                kind: EndKind::Crashed,
                reason: format!("the record is damaged ({e})"),
                log_tail: String::new(),
            });
            Self {
                n,
                ended,
                ..Self::new(scene, &Task { scene: 0, shards: start..end }, &unknown, 0)
            }
        };
        Some(serde_json::from_slice(bytes).unwrap_or_else(damaged))
    }

    fn key(&self) -> String {
        keys::attempt(&self.scene, self.shards, self.n)
    }

    /// Puts the record under the next free number.
    pub(crate) fn begin(&mut self, store: &Store, earlier: &[Self]) -> Result<(), StoreError> {
        let same = earlier.iter().filter(|r| r.shards == self.shards);
        self.n = 1 + same.map(|r| r.n).max().unwrap_or(0);
        loop {
            match store.create(&self.key(), &json_line(self)) {
                Ok(_) => return Ok(()),
                // Another worker took the task, too: this worker's lease expired, or the queue was reset.
                Err(StoreError::Differs { .. }) => self.n += 1,
                Err(error) => return Err(error),
            }
        }
    }

    pub(crate) fn end(mut self, store: &Store, ending: Ending) -> Result<Self, StoreError> {
        self.ended = Some(ending);
        store.replace(&self.key(), &json_line(&self))?;
        // An ended attempt needs no sign of life.
        let _ = store.delete(&[keys::sign(&self.scene, self.shards, self.n)]);
        Ok(self)
    }

    /// Removes the record, because the task has ended normally. If that fails, the record counts as a loss once
    /// the queue delivers the task again.
    pub(crate) fn forget(&self, store: &Store) {
        forget(store, &self.scene, self.shards, self.n);
    }

    fn end_kind(&self) -> Option<EndKind> {
        self.ended.as_ref().map(|ending| ending.kind)
    }

    /// True if `host` could not read the scene's files in this attempt.
    pub(crate) fn could_not_read(&self, host: &str) -> bool {
        self.host == host && self.end_kind() == Some(EndKind::Unreadable)
    }

    fn is_of(&self, task: &Task) -> bool {
        self.shards == [task.shards.start, task.shards.end]
    }

    fn overlaps(&self, task: &Task) -> bool {
        self.shards[0] < task.shards.end && task.shards.start < self.shards[1]
    }

    /// True if the attempt was lost and `task` may be the cause.
    fn was_lost(&self, task: &Task) -> bool {
        match self.end_kind() {
            None | Some(EndKind::Unreadable) => false,
            // Parts of the lost task may have been donated before; they are not suspects.
            Some(EndKind::Lost) => self.is_of(task),
            Some(EndKind::Crashed | EndKind::Hung) => self.overlaps(task),
        }
    }
}

/// An attempt's record with the times of its file and of the worker's last sign of life, by the store's clock.
#[derive(Clone, Debug)]
pub(crate) struct Signed {
    pub(crate) record: AttemptRecord,
    pub(crate) put: SystemTime,
    sign: Option<SystemTime>,
}

impl Signed {
    pub(crate) fn last(&self) -> SystemTime {
        self.sign.map_or(self.put, |sign| sign.max(self.put))
    }
}

/// Returns the time of this process's first call, in microseconds since 1970.
fn started_us() -> u64 {
    static STARTED: OnceLock<u64> = OnceLock::new();
    *STARTED.get_or_init(|| {
        let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        since.as_micros() as u64
    })
}

/// Puts the sign of life of an attempt. Ignores a failure: the next sign follows.
pub(crate) fn sign(store: &Store, scene: &SceneId, task: &Task, n: u32, worker: &str) {
    let key = keys::sign(scene, [task.shards.start, task.shards.end], n);
    let _ = store.replace(&key, format!("{worker}\n").as_bytes());
}

/// Removes the record of an attempt and its sign of life.
pub(crate) fn forget(store: &Store, scene: &SceneId, shards: [u32; 2], n: u32) {
    let _ = store.delete(&[keys::attempt(scene, shards, n), keys::sign(scene, shards, n)]);
}

/// Returns a digest of the store's signs of work at a scene without a tuple: partials, attempts and signs of life.
pub(crate) fn evidence(store: &Store, scene: &SceneId) -> Result<u64, StoreError> {
    let mut hasher = blake3::Hasher::new();
    let mut attempts = store.list_times(&keys::attempts(scene))?;
    attempts.sort();
    for (key, time) in attempts {
        let nanos = time.duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default().as_nanos();
        hasher.update(key.as_bytes()).update(&nanos.to_le_bytes());
    }
    let partials = store.list(&keys::partials(scene))?.len() as u64;
    hasher.update(&partials.to_le_bytes());
    let digest = hasher.finalize();
    let first = digest.as_bytes().first_chunk().expect("a digest has 32 bytes");
    Ok(u64::from_le_bytes(*first))
}

/// Returns a scene's records, sorted by shards and number.
pub fn attempts(store: &Store, scene: &SceneId) -> Result<Vec<AttemptRecord>, StoreError> {
    let records = attempts_with_times(store, scene)?.into_iter();
    Ok(records.map(|signed| signed.record).collect())
}

/// Like [`attempts`], with the times of the files.
pub(crate) fn attempts_with_times(
    store: &Store,
    scene: &SceneId,
) -> Result<Vec<Signed>, StoreError> {
    let listed = store.list_times(&keys::attempts(scene))?;
    let is_sign = |key: &str| Path::new(key).extension().is_some_and(|e| e == "sign");
    let signs: BTreeMap<String, SystemTime> =
        listed.iter().filter(|(key, _)| is_sign(key)).cloned().collect();
    let records = listed.into_iter().filter(|(key, _)| keys::attempt_of(key).is_some());
    let (keys, times): (Vec<String>, Vec<SystemTime>) = records.unzip();
    let mut records = Vec::new();
    store.for_each(&keys, |index, bytes| {
        let record = bytes.and_then(|bytes| AttemptRecord::parse(scene, &keys[index], &bytes));
        records.extend(record.map(|record| {
            let sign = signs.get(&keys::sign(scene, record.shards, record.n)).copied();
            Signed { record, put: times[index], sign }
        }));
    })?;
    records.sort_by_key(|signed| (signed.record.shards, signed.record.n));
    Ok(records)
}

/// Marks the attempts at a task as lost whose workers gave no sign of life for more than `silence` before `now`, by the
/// store's clock, and returns all records. An attempt with a mark and a later sign of life counts as open: its worker was
/// only slow, and removes the record when its task ends.
pub(crate) fn mark_lost(
    store: &Store,
    records: Vec<Signed>,
    task: &Task,
    now: SystemTime,
    silence: Duration,
) -> Result<Vec<AttemptRecord>, StoreError> {
    let mark = |signed: Signed| {
        let is_silent = now.duration_since(signed.last()).is_ok_and(|silent| silent >= silence);
        let (mut record, is_signed) = (signed.record, signed.sign.is_some());
        let may_live = match record.end_kind() {
            None => true,
            // Marking removes the sign, so a sign is later than the mark.
            Some(EndKind::Lost) => is_signed,
            Some(_) => false,
        };
        if !may_live {
            return Ok(record);
        }
        if !is_silent || !record.is_of(task) {
            record.ended = None;
            return Ok(record);
        }
        let reason = format!("worker {} was lost with the task", record.worker);
        record.end(store, Ending { kind: EndKind::Lost, reason, log_tail: String::new() })
    };
    records.into_iter().map(mark).collect()
}

/// Judges a task by the records of its scene; `found` shards of the task have partials. The records must not include one
/// of the worker that asks.
pub(crate) fn poison_check(records: &[AttemptRecord], task: &Task, found: u32) -> PoisonCheck {
    let mut silent = BTreeSet::new();
    // A process is lost once, whatever number of tasks messages have given to it.
    let mut lost: Vec<&AttemptRecord> =
        records.iter().filter(|record| record.was_lost(task)).collect();
    lost.retain(|record| {
        record.end_kind() != Some(EndKind::Lost)
            || silent.insert((&record.worker, record.started_us))
    });
    // The workers of open records may live or not, and messages could make any number of them. They count as one, and
    // only beside deaths that parents have seen.
    let is_open = records.iter().any(|record| record.ended.is_none() && record.is_of(task));
    let Some(last) = lost.last() else {
        return if is_open { PoisonCheck::Suspect } else { PoisonCheck::Clean };
    };
    // Attempts that added partials before they were lost count as one: the remaining shards killed at most the last of
    // them.
    let advanced = |record: &&&AttemptRecord| record.is_of(task) && record.found < found;
    let moved = lost.iter().filter(advanced).count();
    let count = lost.len() - moved + moved.min(1);
    let seen = |r: &&&AttemptRecord| matches!(r.end_kind(), Some(EndKind::Crashed | EndKind::Hung));
    let are_seen = lost.iter().filter(seen).count() + 1 >= MOST_LOST as usize;
    let count = count + usize::from(is_open && are_seen);
    if count < MOST_LOST as usize {
        return PoisonCheck::Suspect;
    }
    let reason = match &last.ended {
        Some(ending) if ending.log_tail.is_empty() => ending.reason.clone(),
        Some(ending) => {
            format!("{}; its last lines: {}", ending.reason, ending.log_tail.trim_end())
        }
        None => String::new(),
    };
    PoisonCheck::Poison(format!(
        "{count} processes were lost with shards {} to {}; the last one: {reason}",
        task.shards.start,
        task.shards.end - 1
    ))
}

/// True if some of the attempts only count as lost because their workers were silent.
pub(crate) fn are_presumed(records: &[AttemptRecord]) -> bool {
    records.iter().any(|record| record.end_kind() == Some(EndKind::Lost))
}

/// True if attempts on two machines, or `MOST_LOST` attempts, have failed to read the scene's files.
pub(crate) fn is_unreadable(records: &[AttemptRecord]) -> bool {
    let failed = || records.iter().filter(|r| r.end_kind() == Some(EndKind::Unreadable));
    let hosts: BTreeSet<&str> = failed().map(|record| record.host.as_str()).collect();
    hosts.len() >= HOSTS_TO_REFUSE || failed().count() >= MOST_LOST as usize
}

#[cfg(test)]
mod tests;
