//! Checks a leased task for remaining work and for earlier processes that were lost with it (the poison check), and
//! handles files that cannot be read.

use super::core::Worker;
use super::tasks::TaskId;
use crate::farm::FarmError;
use crate::farm::queue::Lease;
use crate::run::{
    AttemptRecord, EndKind, Ending, PoisonCheck, QuarantineRecord, attempts, is_done,
    is_unreadable, keys, mark_lost, poison_check,
};
use render::line::SceneLine;
use std::time::Duration;

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
            && (is_done(store, line)? || QuarantineRecord::get(store, &line.id)?.is_some())
        {
            let actions = self.tasks().nothing_to_do(task);
            self.perform(actions)?;
            return Ok(Finding::Over);
        }
        if self.shared_queue.is_some_and(|shared| shared.is_child) {
            return Ok(Finding::Fresh(None));
        }
        let mut records = attempts(store, &line.id)?;
        if lease.redelivered {
            records = mark_lost(store, records, leased)?;
        }
        let found = self.found(line, lease)?;
        let check = poison_check(&records, leased, found);
        if let PoisonCheck::Poison(reason) = check {
            let actions = self.tasks().set_aside(task, &reason);
            self.perform(actions)?;
            return Ok(Finding::Over);
        }
        if !records.is_empty() && !self.tasks().pin(task) {
            return Ok(Finding::Over);
        }
        let host = &self.options.who.host;
        let tried_here = records.iter().filter(|r| r.could_not_read(host));
        self.pause(READ_AGAIN * tried_here.count() as u32);
        let mut record = AttemptRecord::new(&line.id, leased, &self.options.who, found);
        record.begin(store, &records)?;
        if !self.tasks().attempted(task, record.n) {
            record.forget(store);
            return Ok(Finding::Over);
        }
        Ok(match check {
            PoisonCheck::Suspect => Finding::Suspect(record),
            PoisonCheck::Clean | PoisonCheck::Poison(_) => Finding::Fresh(Some(record)),
        })
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
