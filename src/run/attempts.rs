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
use render::ids::SceneId;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::OnceLock;
use std::time::{Duration, SystemTime};

/// Schema of an [`AttemptRecord`].
pub const ATTEMPT_SCHEMA: &str = "glasshouse.attempt/1";

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
mod tests {
    use super::*;

    const TASK: Task = Task { scene: 0, shards: 0..64 };

    fn scene() -> SceneId {
        SceneId::new("train-00000").unwrap()
    }

    fn record(n: u32, found: u32, kind: Option<EndKind>) -> AttemptRecord {
        let who = WorkerName { worker: format!("w{n}"), host: "h".to_owned() };
        let mut record = AttemptRecord::new(&scene(), &TASK, &who, found);
        record.n = n;
        record.ended = kind.map(|kind| Ending {
            kind,
            reason: "signal 6".to_owned(),
            log_tail: "out of memory".to_owned(),
        });
        record
    }

    const CRASHED: Option<EndKind> = Some(EndKind::Crashed);

    const LOST: Option<EndKind> = Some(EndKind::Lost);
    const TAIL: Task = Task { scene: 0, shards: 32..64 };

    #[test]
    fn only_lost_attempts_count() {
        assert_eq!(poison_check(&[], &TASK, 0), PoisonCheck::Clean);
        // The attempt still runs, or its worker was lost just now: a child process traces the task. However many such
        // records there are, they are no reason for quarantine.
        let open: Vec<AttemptRecord> = (1..20).map(|n| record(n, 0, None)).collect();
        assert_eq!(poison_check(&open[..1], &TASK, 0), PoisonCheck::Suspect);
        assert_eq!(poison_check(&open, &TASK, 0), PoisonCheck::Suspect);
        assert_eq!(poison_check(&open, &TAIL, 0), PoisonCheck::Clean);
        assert_eq!(poison_check(&[record(1, 0, LOST)], &TASK, 0), PoisonCheck::Suspect);
        // A part that was donated before is not suspect, but may contain the shard that killed a child process.
        assert_eq!(poison_check(&[record(1, 0, LOST)], &TAIL, 0), PoisonCheck::Clean);
        assert_eq!(poison_check(&[record(1, 0, CRASHED)], &TAIL, 0), PoisonCheck::Suspect);
        let unreadable = [record(1, 0, Some(EndKind::Unreadable))];
        assert_eq!(poison_check(&unreadable, &TASK, 0), PoisonCheck::Clean);
    }

    #[test]
    fn a_task_without_a_sign_of_life_was_lost() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::local(dir.path()).unwrap();
        let mut running = record(1, 0, None);
        running.begin(&store, &[]).unwrap();
        let silence = Duration::from_secs(4);
        let marked = |task, after_s| {
            let there = attempts_with_times(&store, &scene()).unwrap();
            let now = there[0].last() + Duration::from_secs(after_s);
            mark_lost(&store, there, task, now, silence).unwrap()
        };
        assert_eq!(marked(&TAIL, 9), [running.clone()]);
        assert_eq!(marked(&TASK, 3), [running.clone()]);
        // A sign of life is later than the record.
        let last = || attempts_with_times(&store, &scene()).unwrap()[0].last();
        let put = last();
        std::thread::sleep(Duration::from_millis(20));
        sign(&store, &scene(), &TASK, 1, "w1");
        assert!(last() > put);
        let lost = marked(&TASK, 4);
        assert_eq!(lost[0].ended.as_ref().unwrap().kind, EndKind::Lost);
        assert_eq!(attempts(&store, &scene()).unwrap(), lost);
        // Nothing but a new sign of life takes the mark back.
        assert_eq!(marked(&TASK, 0), lost);
        std::thread::sleep(Duration::from_millis(20));
        sign(&store, &scene(), &TASK, 1, "w1");
        assert_eq!(marked(&TASK, 3), [running.clone()]);
        assert_eq!(marked(&TASK, 4), lost);
        assert_eq!(marked(&TASK, 0), lost);
        // The worker was only slow, so it removes its record.
        running.forget(&store);
        assert!(store.list("attempts").unwrap().is_empty());
    }

    /// The coordinator sees a scene at work by any change of these.
    #[test]
    fn records_signs_and_partials_are_evidence() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::local(dir.path()).unwrap();
        let mut seen = BTreeSet::from([evidence(&store, &scene()).unwrap()]);
        let mut is_new = || seen.insert(evidence(&store, &scene()).unwrap());
        assert!(!is_new());
        record(1, 0, None).begin(&store, &[]).unwrap();
        assert!(is_new() && !is_new());
        sign(&store, &scene(), &TASK, 1, "w1");
        assert!(is_new() && !is_new());
        std::thread::sleep(Duration::from_millis(20));
        sign(&store, &scene(), &TASK, 1, "w1");
        assert!(is_new() && !is_new());
        store.create(&keys::partial(&scene(), 3), b"x").unwrap();
        assert!(is_new() && !is_new());
        store.create("attempts/another/0-64.1.json", b"x").unwrap();
        assert!(!is_new());
    }

    #[test]
    fn four_losses_without_new_partials_are_poison() {
        let mut lost = vec![record(1, 0, LOST)];
        for n in 2..4 {
            lost.push(record(n, 0, CRASHED));
            assert_eq!(poison_check(&lost, &TASK, 0), PoisonCheck::Suspect);
        }
        lost.push(record(4, 0, CRASHED));
        let PoisonCheck::Poison(reason) = poison_check(&lost, &TASK, 0) else {
            panic!("four losses are not poison");
        };
        let words = "the last one: signal 6; its last lines: out of memory";
        assert!(reason.contains("4 processes") && reason.contains(words), "{reason}");
    }

    /// Processes that are killed from outside and resume each other's work do not make a scene poison.
    #[test]
    fn attempts_that_add_partials_count_once() {
        let steps: Vec<AttemptRecord> = (1..10).map(|n| record(n, n * 4, LOST)).collect();
        assert_eq!(poison_check(&steps, &TASK, 40), PoisonCheck::Suspect);
        // Poison behind forty good shards: each attempt that reached it counts, and so does the first.
        let mut stuck = vec![record(1, 0, LOST)];
        for n in 2..4 {
            stuck.push(record(n, 40, CRASHED));
            assert_eq!(poison_check(&stuck, &TASK, 40), PoisonCheck::Suspect);
        }
        stuck.push(record(4, 40, CRASHED));
        assert!(matches!(poison_check(&stuck, &TASK, 40), PoisonCheck::Poison(_)));
    }

    /// Messages may give many tasks to one slow process.
    #[test]
    fn a_silent_process_counts_once() {
        let mut of_one: Vec<AttemptRecord> = (1..9).map(|n| record(n, 0, LOST)).collect();
        assert!(matches!(poison_check(&of_one, &TASK, 0), PoisonCheck::Poison(_)));
        for record in &mut of_one {
            "w1".clone_into(&mut record.worker);
        }
        assert_eq!(poison_check(&of_one, &TASK, 0), PoisonCheck::Suspect);
        // Processes that a launch file starts again under the same name.
        for (k, record) in of_one.iter_mut().enumerate() {
            record.started_us += k as u64;
        }
        assert!(matches!(poison_check(&of_one, &TASK, 0), PoisonCheck::Poison(_)));
    }

    #[test]
    fn two_machines_or_four_attempts_find_a_file_unreadable() {
        let of = |n: u32, host: &str| {
            let mut record = record(n, 0, Some(EndKind::Unreadable));
            record.host = host.to_owned();
            record
        };
        assert!(!is_unreadable(&[of(1, "a"), of(2, "a"), of(3, "a")]));
        assert!(is_unreadable(&[of(1, "a"), of(2, "b")]));
        assert!(is_unreadable(&[of(1, "a"), of(2, "a"), of(3, "a"), of(4, "a")]));
        assert!(!is_unreadable(&[of(1, "a"), record(2, 0, None)]));
    }

    #[test]
    fn records_are_numbered_and_damaged_ones_count() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::local(dir.path()).unwrap();
        assert!(attempts(&store, &scene()).unwrap().is_empty());
        let mut first = record(9, 3, None);
        let mut second = record(9, 3, None);
        second.worker = "another".to_owned();
        first.begin(&store, &[]).unwrap();
        // The second worker listed the same empty folder.
        second.begin(&store, &[]).unwrap();
        assert_eq!(second.key(), "attempts/train-00000/0-64.2.json");
        let ending = record(1, 0, CRASHED).ended.unwrap();
        let ended = second.end(&store, ending).unwrap();
        assert_eq!(attempts(&store, &scene()).unwrap(), [first.clone(), ended]);
        store.replace(&first.key(), b"{").unwrap();
        let there = attempts(&store, &scene()).unwrap();
        assert_eq!(there.len(), 2);
        assert!(there[0].was_lost(&TASK));
        store.replace("attempts/train-00000/notes.txt", b"?").unwrap();
        assert_eq!(attempts(&store, &scene()).unwrap().len(), 2);
    }
}
