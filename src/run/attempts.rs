//! What is written down before a task is worked on, so that a scene that kills whoever works on it is found out.
//!
//! Whoever takes a task first puts `attempts/<scene>/<start>-<end>.<n>.json`, and removes it when the task ends in order.
//! A record that stands is of work that goes on, or of work that was lost. The queue tells which: a task that it gives
//! out again has lost its holder. What was lost once is tried in a child process, whose death costs nobody else, and what
//! was lost four times is set aside.

use super::keys;
use super::task::Task;
use crate::store::{Store, StoreError};
use render::ids::SceneId;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// The schema name of an attempt's record.
pub const ATTEMPT_SCHEMA: &str = "glasshouse.attempt/1";

/// A scene that was lost so often, without anything new of it in the store, is set aside.
pub const MOST_LOST: u32 = 4;

/// Machines that must find a file unreadable before it counts as that.
const HOSTS_TO_REFUSE: usize = 2;

/// `attempts/<scene>/<start>-<end>.<n>.json`
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AttemptRecord {
    /// Always [`ATTEMPT_SCHEMA`].
    pub schema: String,
    /// The scene.
    pub scene: SceneId,
    /// First shard, and one past the last.
    pub shards: [u32; 2],
    /// From 1, of those with the same shards.
    pub n: u32,
    /// Who tries.
    pub worker: String,
    /// On which machine.
    pub host: String,
    /// Of these shards, those in the store before.
    pub found: u32,
    /// How it ended, if it did not end in order.
    pub ended: Option<Ending>,
}

/// How an attempt ended, told by its worker.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ending {
    /// In which way.
    pub kind: EndKind,
    /// What happened.
    pub reason: String,
    /// Last lines that the child process wrote.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub log_tail: String,
}

/// In which way an attempt ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EndKind {
    /// Its worker gave no sign any more; told by the next one.
    Lost,
    /// The child process died.
    Crashed,
    /// The child process made no progress and was killed.
    Hung,
    /// The scene's files cannot be read on this machine.
    Unreadable,
}

/// Who works.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WorkerName {
    /// Different for each process.
    pub worker: String,
    /// The same for all of a machine.
    pub host: String,
}

/// What earlier attempts say of a task.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// Nothing.
    Fresh,
    /// It may have killed whoever worked on it.
    Suspect,
    /// It is set aside, for this reason.
    SetAside(String),
}

impl AttemptRecord {
    pub(crate) fn new(scene: &SceneId, task: &Task, who: &WorkerName, found: u32) -> Self {
        Self {
            schema: ATTEMPT_SCHEMA.to_owned(),
            scene: scene.clone(),
            shards: [task.shards.start, task.shards.end],
            n: 1,
            worker: who.worker.clone(),
            host: who.host.clone(),
            found,
            ended: None,
        }
    }

    /// The record of a scene under `key`, if that is an attempt's name. One that cannot be read counts as lost.
    pub(crate) fn parse(scene: &SceneId, key: &str, bytes: &[u8]) -> Option<Self> {
        let (shards, n) = keys::attempt_of(key)?;
        let damaged = |e| Self {
            schema: ATTEMPT_SCHEMA.to_owned(),
            scene: scene.clone(),
            shards,
            n,
            worker: "unknown".to_owned(),
            host: "unknown".to_owned(),
            found: 0,
            ended: Some(Ending {
                kind: EndKind::Crashed,
                reason: format!("its record is damaged ({e})"),
                log_tail: String::new(),
            }),
        };
        Some(serde_json::from_slice(bytes).unwrap_or_else(damaged))
    }

    fn key(&self) -> String {
        keys::attempt(&self.scene, self.shards, self.n)
    }

    fn json(&self) -> Vec<u8> {
        let mut json = serde_json::to_vec(self).expect("strings and numbers are JSON");
        json.push(b'\n');
        json
    }

    /// Puts the record under the next number that is free.
    pub(crate) fn begin(&mut self, store: &Store, earlier: &[Self]) -> Result<(), StoreError> {
        let same = earlier.iter().filter(|r| r.shards == self.shards);
        self.n = 1 + same.map(|r| r.n).max().unwrap_or(0);
        loop {
            match store.create(&self.key(), &self.json()) {
                Ok(_) => return Ok(()),
                // Another worker was first: it takes this one for lost, or the queue forgot it.
                Err(StoreError::Differs { .. }) => self.n += 1,
                Err(error) => return Err(error),
            }
        }
    }

    /// Says how it ended.
    pub(crate) fn end(mut self, store: &Store, ending: Ending) -> Result<Self, StoreError> {
        self.ended = Some(ending);
        store.replace(&self.key(), &self.json())?;
        Ok(self)
    }

    /// Its task has ended in order. What cannot be removed counts when the task's next holder is lost, too.
    pub(crate) fn forget(&self, store: &Store) {
        let _ = store.delete(&[self.key()]);
    }

    /// The scene's files could not be read on this machine.
    pub(crate) fn could_not_read(&self, host: &str) -> bool {
        let kind = self.ended.as_ref().map(|ending| ending.kind);
        self.host == host && kind == Some(EndKind::Unreadable)
    }

    fn is_of(&self, task: &Task) -> bool {
        self.shards == [task.shards.start, task.shards.end]
    }

    fn overlaps(&self, task: &Task) -> bool {
        self.shards[0] < task.shards.end && task.shards.start < self.shards[1]
    }

    /// The worker may have died of this task.
    fn was_lost(&self, task: &Task) -> bool {
        match self.ended.as_ref().map(|ending| ending.kind) {
            None | Some(EndKind::Unreadable) => false,
            // Parts of it may have been given away, and are not to blame.
            Some(EndKind::Lost) => self.is_of(task),
            Some(EndKind::Crashed | EndKind::Hung) => self.overlaps(task),
        }
    }
}

/// The records of a scene that stand, the latest last. One that cannot be read counts as lost.
pub fn attempts(store: &Store, scene: &SceneId) -> Result<Vec<AttemptRecord>, StoreError> {
    let mut there = store.list(&keys::attempts(scene))?;
    there.sort();
    let mut records = Vec::new();
    for (key, bytes) in there.iter().zip(store.get_all(&there)?) {
        records.extend(bytes.and_then(|bytes| AttemptRecord::parse(scene, key, &bytes)));
    }
    records.sort_by_key(|record| (record.shards, record.n));
    Ok(records)
}

/// The queue gives a task out again: whoever has tried it has lost its lease. It counts, unless it wakes up and ends in
/// order.
pub(crate) fn mark_lost(
    store: &Store,
    records: Vec<AttemptRecord>,
    task: &Task,
) -> Result<Vec<AttemptRecord>, StoreError> {
    let mark = |record: AttemptRecord| {
        if record.ended.is_some() || !record.is_of(task) {
            return Ok(record);
        }
        let reason = format!("worker {} was lost with it", record.worker);
        record.end(
            store,
            Ending {
                kind: EndKind::Lost,
                reason,
                log_tail: String::new(),
            },
        )
    };
    records.into_iter().map(mark).collect()
}

/// What the records of a scene say of a task of which `found` shards are in the store.
pub(crate) fn verdict(records: &[AttemptRecord], task: &Task, found: u32) -> Verdict {
    let lost: Vec<&AttemptRecord> = records
        .iter()
        .filter(|record| record.was_lost(task))
        .collect();
    let Some(last) = lost.last() else {
        return Verdict::Fresh;
    };
    // Who was lost after adding to what is there was killed at most once by what is left.
    let advanced = |record: &&&AttemptRecord| record.is_of(task) && record.found < found;
    let moved = lost.iter().filter(advanced).count();
    let count = lost.len() - moved + moved.min(1);
    if count < MOST_LOST as usize {
        return Verdict::Suspect;
    }
    let told = match &last.ended {
        Some(ending) if ending.log_tail.is_empty() => ending.reason.clone(),
        Some(ending) => format!(
            "{}; its last lines: {}",
            ending.reason,
            ending.log_tail.trim_end()
        ),
        None => String::new(),
    };
    Verdict::SetAside(format!(
        "{count} processes were lost with shards {} to {}; the last one: {told}",
        task.shards.start,
        task.shards.end - 1
    ))
}

/// Whether enough machines have tried in vain to read the scene's files; with `MOST_LOST` attempts one is enough.
pub(crate) fn is_unreadable(records: &[AttemptRecord]) -> bool {
    let told: Vec<&AttemptRecord> = records
        .iter()
        .filter(|r| {
            let ending = r.ended.as_ref();
            ending.is_some_and(|ending| ending.kind == EndKind::Unreadable)
        })
        .collect();
    let hosts: BTreeSet<&str> = told.iter().map(|record| record.host.as_str()).collect();
    hosts.len() >= HOSTS_TO_REFUSE || told.len() >= MOST_LOST as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    const SPAN: Task = Task {
        scene: 0,
        shards: 0..64,
    };

    fn scene() -> SceneId {
        SceneId::new("train-00000").unwrap()
    }

    fn record(n: u32, found: u32, kind: Option<EndKind>) -> AttemptRecord {
        let who = WorkerName {
            worker: format!("w{n}"),
            host: "h".to_owned(),
        };
        let mut record = AttemptRecord::new(&scene(), &SPAN, &who, found);
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
    const TAIL: Task = Task {
        scene: 0,
        shards: 32..64,
    };

    #[test]
    fn only_lost_attempts_count() {
        assert_eq!(verdict(&[], &SPAN, 0), Verdict::Fresh);
        // It goes on, or the queue forgot it.
        assert_eq!(verdict(&[record(1, 0, None)], &SPAN, 0), Verdict::Fresh);
        assert_eq!(verdict(&[record(1, 0, LOST)], &SPAN, 0), Verdict::Suspect);
        // A part that was given away before is not to blame; but what a child died of may be in it.
        assert_eq!(verdict(&[record(1, 0, LOST)], &TAIL, 0), Verdict::Fresh);
        assert_eq!(
            verdict(&[record(1, 0, CRASHED)], &TAIL, 0),
            Verdict::Suspect
        );
        let unreadable = [record(1, 0, Some(EndKind::Unreadable))];
        assert_eq!(verdict(&unreadable, &SPAN, 0), Verdict::Fresh);
    }

    #[test]
    fn what_the_queue_gives_out_again_was_lost() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::local(dir.path()).unwrap();
        let mut running = record(1, 0, None);
        running.begin(&store, &[]).unwrap();
        let there = attempts(&store, &scene()).unwrap();
        let there = mark_lost(&store, there, &TAIL).unwrap();
        assert_eq!(there, [running.clone()]);
        let marked = mark_lost(&store, there, &SPAN).unwrap();
        assert_eq!(marked[0].ended.as_ref().unwrap().kind, EndKind::Lost);
        assert_eq!(attempts(&store, &scene()).unwrap(), marked);
        // It only slept.
        running.forget(&store);
        assert!(attempts(&store, &scene()).unwrap().is_empty());
    }

    #[test]
    fn four_losses_without_anything_new() {
        let mut lost = vec![record(1, 0, LOST)];
        for n in 2..4 {
            lost.push(record(n, 0, CRASHED));
            assert_eq!(verdict(&lost, &SPAN, 0), Verdict::Suspect);
        }
        lost.push(record(4, 0, CRASHED));
        let Verdict::SetAside(reason) = verdict(&lost, &SPAN, 0) else {
            panic!("it goes on");
        };
        let words = "the last one: signal 6; its last lines: out of memory";
        assert!(
            reason.contains("4 processes") && reason.contains(words),
            "{reason}"
        );
    }

    /// A process killed again and again from outside goes on where the last one was: that is no poison.
    #[test]
    fn who_gets_on_is_not_blamed() {
        let steps: Vec<AttemptRecord> = (1..10).map(|n| record(n, n * 4, LOST)).collect();
        assert_eq!(verdict(&steps, &SPAN, 40), Verdict::Suspect);
        // Poison behind forty good shards: whoever reached it counts, the first one included.
        let mut stuck = vec![record(1, 0, LOST)];
        for n in 2..4 {
            stuck.push(record(n, 40, CRASHED));
            assert_eq!(verdict(&stuck, &SPAN, 40), Verdict::Suspect);
        }
        stuck.push(record(4, 40, CRASHED));
        assert!(matches!(verdict(&stuck, &SPAN, 40), Verdict::SetAside(_)));
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
        assert!(is_unreadable(&[
            of(1, "a"),
            of(2, "a"),
            of(3, "a"),
            of(4, "a")
        ]));
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
        // It saw the same empty folder.
        second.begin(&store, &[]).unwrap();
        assert_eq!(second.key(), "attempts/train-00000/0-64.2.json");
        let ending = record(1, 0, CRASHED).ended.unwrap();
        let ended = second.end(&store, ending).unwrap();
        assert_eq!(attempts(&store, &scene()).unwrap(), [first.clone(), ended]);
        store.replace(&first.key(), b"{").unwrap();
        let there = attempts(&store, &scene()).unwrap();
        assert_eq!(there.len(), 2);
        assert!(there[0].was_lost(&SPAN));
        store
            .replace("attempts/train-00000/notes.txt", b"?")
            .unwrap();
        assert_eq!(attempts(&store, &scene()).unwrap().len(), 2);
    }
}
