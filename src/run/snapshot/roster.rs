//! The workers of a run, as their attempts, signs of life and tuples show them.
//!
//! A worker that holds a task puts a sign of life once in a lease. A killed one leaves its task behind: its record stays
//! open, or another worker marks it, or finishes the task and removes it. So the roster remembers the task, until the worker
//! gives a later sign of life.

use super::{SeenAttempt, Snapshot};
use crate::run::attempts::{AttemptRecord, EndKind};
use glasshouse_line::ids::SceneId;
use std::collections::BTreeMap;
use std::time::{Duration, Instant, SystemTime};

/// A worker that has held a task, or has made a tuple since this process started.
#[derive(Clone, Debug)]
pub struct SeenWorker {
    pub host: String,
    /// Time when this process last saw a sign of life: a new attempt, a new sign or a tuple.
    pub last: Instant,
    /// The task in hand, or the one with which the worker was lost: scene and first shard.
    pub task: Option<(SceneId, u32)>,
    /// True if another worker has that task, too.
    is_relieved: bool,
}

impl SeenAttempt {
    /// True if the worker may still hold the task. Another worker that marks a record as lost removes its sign, so a sign
    /// beside a marked record is later.
    pub fn is_open(&self) -> bool {
        match self.end_kind() {
            None => true,
            Some(kind) => kind == EndKind::Lost && self.sign.is_some(),
        }
    }

    /// True if the worker holds the task, or was lost with it. Other endings show that the worker lived.
    fn stands(&self) -> bool {
        self.end_kind().is_none_or(|kind| kind == EndKind::Lost)
    }

    fn end_kind(&self) -> Option<EndKind> {
        self.record.ended.as_ref().map(|ending| ending.kind)
    }

    /// Returns the time of the last sign of life, by the store's clock.
    pub(super) fn last(&self) -> SystemTime {
        self.sign.map_or(self.put, |sign| sign.max(self.put))
    }
}

impl Snapshot {
    /// Returns the workers by name.
    pub fn workers_seen(&self) -> &BTreeMap<String, SeenWorker> {
        &self.roster
    }

    /// True if the worker holds a task and gave no sign of life in the time `silence` before the last refresh. Time since
    /// then does not count: signs that came meanwhile were not read yet.
    pub fn is_lost(&self, worker: &SeenWorker, silence: Duration) -> bool {
        worker.task.is_some() && self.listed.is_some_and(|at| at - worker.last > silence)
    }

    /// Brings the roster up to date after the other lists.
    pub(super) fn refresh_roster(&mut self) {
        if !self.scope.workers {
            return;
        }
        let mut roster = std::mem::take(&mut self.roster);
        let mut held: BTreeMap<&str, Vec<&SeenAttempt>> = BTreeMap::new();
        for attempt in self.attempts.values().filter(|attempt| attempt.stands()) {
            held.entry(&attempt.record.worker).or_default().push(attempt);
        }
        let mut sign = |name: &str, host: &str, at: Instant, is_own: bool| {
            let new =
                || SeenWorker { host: host.to_owned(), last: at, task: None, is_relieved: false };
            let worker = roster.entry(name.to_owned()).or_insert_with(new);
            if is_own && at > worker.last {
                (worker.last, worker.task, worker.is_relieved) = (at, None, false);
            }
        };
        for attempt in held.values().flatten() {
            let SeenAttempt { record, signed, .. } = attempt;
            sign(&record.worker, &record.host, *signed, attempt.is_open());
        }
        for tuple in &self.tuples {
            if let (Some(seen), Some(made)) = (tuple.seen, self.provenance(tuple.scene))
                && let Some(worker) = &made.worker
            {
                sign(worker, made.host.as_deref().unwrap_or_default(), seen, true);
            }
        }
        for (name, worker) in &mut roster {
            if let Some(attempts) = held.get(&**name) {
                // Workers trace the oldest of their tasks, and fetch the others ahead.
                let oldest = attempts.iter().min_by_key(|attempt| attempt.put);
                worker.task = oldest.map(|oldest| {
                    let AttemptRecord { scene, shards: [first, _], .. } = &oldest.record;
                    (scene.clone(), *first)
                });
                worker.is_relieved |= attempts.iter().any(|attempt| self.has_follower(attempt));
            } else if let Some((scene, _)) = &worker.task {
                // The record is gone: the worker has ended its task, or another one has finished the scene.
                let made = self.plan.index(scene.as_str()).and_then(|scene| self.provenance(scene));
                let is_without = made.is_some_and(|made| made.workers().all(|maker| maker != name));
                worker.is_relieved |= is_without;
                if !worker.is_relieved {
                    worker.task = None;
                }
            }
        }
        self.roster = roster;
    }

    /// True if another worker has taken the same task later.
    fn has_follower(&self, attempt: &SeenAttempt) -> bool {
        let mine = &attempt.record;
        self.attempts.values().any(|SeenAttempt { record, .. }| {
            record.scene == mine.scene
                && record.shards == mine.shards
                && record.n > mine.n
                && record.worker != mine.worker
        })
    }
}
