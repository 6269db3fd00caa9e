//! Checks a leased task for remaining work and for earlier processes that were lost with it (the poison check), and
//! handles files that cannot be read.

use super::core::Worker;
use super::tasks::TaskId;
use crate::farm::FarmError;
use crate::farm::queue::Lease;
use crate::run::{
    AttemptRecord, EndKind, Ending, PoisonCheck, QuarantineRecord, SILENT_LEASES, Signed, Task,
    are_presumed, attempts, attempts_with_times, is_done, is_unreadable, keys, mark_lost,
    poison_check,
};
use glasshouse_line::SceneLine;
use std::time::{Duration, SystemTime};

pub(super) enum Finding {
    /// The scene is done or set aside, or another worker has the task now.
    Over,
    /// The task can be traced here. The record is absent in a child process, because the parent has it.
    Fresh(Option<AttemptRecord>),
    /// The scene may have killed a process.
    Suspect(AttemptRecord),
}

/// Pause before a machine reads a scene's files again, for each of its earlier failures to read them.
const READ_AGAIN: Duration = Duration::from_secs(1);

impl Worker<'_> {
    /// Checks a leased task, and records the attempt, except in a child process or if nothing is left to do.
    pub(super) fn examine(
        &self,
        line: &SceneLine,
        task: TaskId,
        lease: &Lease,
    ) -> Result<Finding, FarmError> {
        let (store, leased) = (self.store, &lease.message.task);
        if self.shared_queue.is_some()
            && (is_done(self.run, store, line)?
                || QuarantineRecord::get(store, &line.id)?.is_some())
        {
            let actions = self.tasks().nothing_to_do(task);
            self.perform(actions)?;
            return Ok(Finding::Over);
        }
        if self.shared_queue.is_some_and(|shared| shared.is_child) {
            return Ok(Finding::Fresh(None));
        }
        let found = self.found(line, lease)?;
        let earlier = attempts(store, &line.id)?;
        if !earlier.is_empty() && !self.tasks().pin(task) {
            return Ok(Finding::Over);
        }
        let host = &self.options.who.host;
        let tried_here = earlier.iter().filter(|r| r.could_not_read(host));
        self.pause_with(task, READ_AGAIN * tried_here.count() as u32);
        let mut record = AttemptRecord::new(&line.id, leased, &self.options.who, found);
        record.begin(store, &earlier)?;
        if !self.tasks().attempted(task, record.n) {
            record.forget(store);
            return Ok(Finding::Over);
        }
        if earlier.is_empty() {
            return Ok(Finding::Fresh(Some(record)));
        }
        Ok(match self.judge(task, leased, &record)? {
            PoisonCheck::Poison(reason) => {
                record.forget(store);
                let actions = self.tasks().set_aside(task, &reason);
                self.perform(actions)?;
                Finding::Over
            }
            PoisonCheck::Suspect => Finding::Suspect(record),
            PoisonCheck::Clean => Finding::Fresh(Some(record)),
        })
    }

    /// Judges a task by the records in the store. `own` is this worker's record of the attempt, which counts only if it has
    /// ended.
    pub(super) fn judge(
        &self,
        id: TaskId,
        task: &Task,
        own: &AttemptRecord,
    ) -> Result<PoisonCheck, FarmError> {
        let silence =
            self.shared_queue.map_or(Duration::ZERO, |shared| shared.lease * SILENT_LEASES);
        let records = self.records(id, task, own, silence)?;
        let check = poison_check(&records, task, own.found);
        if silence.is_zero() || !are_presumed(&records) || !matches!(check, PoisonCheck::Poison(_))
        {
            return Ok(check);
        }
        // The store or the machines may have been too busy for signs of life. Those that live give one meanwhile.
        self.pause_with(id, silence);
        if self.must_stop() {
            return Ok(PoisonCheck::Suspect);
        }
        Ok(poison_check(&self.records(id, task, own, silence)?, task, own.found))
    }

    /// Returns the records of attempts at the task's scene, the lost ones marked. The worker's own record, which is in the
    /// store, shows the time by the store's clock. Without a shared queue, no other process lives.
    fn records(
        &self,
        id: TaskId,
        task: &Task,
        own: &AttemptRecord,
        silence: Duration,
    ) -> Result<Vec<AttemptRecord>, FarmError> {
        let mut records = attempts_with_times(self.store, &own.scene)?;
        let is_own = |r: &AttemptRecord| (r.shards, r.n) == (own.shards, own.n);
        let now = records.iter().find(|signed| is_own(&signed.record)).map(|signed| signed.put);
        let me = &self.options.who.worker;
        // This worker may hold another message of the same task, but an earlier process may have had its name.
        let holds_another = self.tasks().holds_another(id);
        records.retain(|Signed { record, .. }| {
            let is_of_other_message =
                holds_another && record.ended.is_none() && record.worker == *me;
            (!is_own(record) || own.ended.is_some()) && !is_of_other_message
        });
        let now = now.unwrap_or_else(SystemTime::now);
        Ok(mark_lost(self.store, records, task, now, silence)?)
    }

    fn found(&self, line: &SceneLine, lease: &Lease) -> Result<u32, FarmError> {
        if self.run.layout(line).len() == 1 {
            return Ok(0);
        }
        let there = self.store.list(&keys::partials(&line.id))?;
        let shards = there.iter().filter_map(|key| keys::shard_of(key));
        let own = &lease.message.task.shards;
        Ok(shards.filter(|shard| own.contains(shard)).count() as u32)
    }

    /// Requeues a task with files that this machine cannot read, or sets its scene aside after too many such attempts.
    pub(super) fn could_not_read(
        &self,
        line: &SceneLine,
        task: TaskId,
        record: Option<AttemptRecord>,
        reason: &str,
    ) -> Result<(), FarmError> {
        if !self.tasks().pin(task) {
            // The task was donated meanwhile.
            return Ok(());
        }
        if let Some(record) = record {
            let ending = Ending {
                kind: EndKind::Unreadable,
                reason: reason.to_owned(),
                log_tail: String::new(),
            };
            record.end(self.store, ending)?;
        }
        let actions = if is_unreadable(&attempts(self.store, &line.id)?) {
            self.tasks().set_aside(task, reason)
        } else {
            self.tasks().retry(task)
        };
        self.perform(actions)?;
        self.went_wrong(line);
        Ok(())
    }
}
