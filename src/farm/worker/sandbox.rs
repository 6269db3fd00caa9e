//! Traces tasks in a child process if they may kill the process that traces them.

use super::core::Worker;
use super::options::{Sandbox, SandboxEnd};
use super::tasks::TaskId;
use crate::farm::FarmError;
use crate::run::{AttemptRecord, Ending, Event, PoisonCheck, Task};
use glasshouse_line::SceneLine;

impl Worker<'_> {
    pub(super) fn trace_in(
        &self,
        sandbox: &dyn Sandbox,
        line: &SceneLine,
        (id, task): (TaskId, &Task),
        record: AttemptRecord,
    ) -> Result<(), FarmError> {
        let now = self.now();
        if !self.tasks().sandbox(id, now) {
            // The task was donated meanwhile.
            return Ok(());
        }
        (self.on_event)(Event::Sandboxed { scene: line.id.clone() });
        let on_sign = || self.progress(id);
        let end = sandbox.trace(&line.id, task, &on_sign, &|| self.must_stop());
        let actions = match end {
            SandboxEnd::Done { merged, traced, resumed, loaded, quarantined } => {
                self.tally.sandboxed_loads.add(loaded);
                self.count(line, [merged, traced, resumed], quarantined);
                self.tasks().nothing_to_do(id)
            }
            SandboxEnd::Stopped => self.tasks().requeue(id),
            SandboxEnd::Lost(ending) => return self.lost(line, (id, task), record, ending),
            SandboxEnd::Failed(reason) => return Err(FarmError::Sandbox(reason)),
        };
        self.perform(actions)
    }

    /// Adds a child's counts to those of this process.
    fn count(&self, line: &SceneLine, counts: [u64; 3], quarantined: Option<String>) {
        let [merged, traced, resumed] = counts;
        self.tally.merged.add(merged);
        self.tally.traced.add(traced);
        self.tally.resumed.add(resumed);
        for shard in 0..traced + resumed {
            (self.on_event)(Event::ShardDone { resumed: shard >= traced });
        }
        if merged > 0 {
            (self.on_event)(Event::SceneMerged {
                scene: line.id.clone(),
                miss_share: 0.0,
                has_odd_view: false,
            });
        }
        match quarantined {
            Some(reason) => self.tell_quarantine(line, &reason),
            None => self.stop.went_well(),
        }
    }

    /// Handles a child that was lost with a task: requeues the task, or sets its scene aside after too many losses.
    fn lost(
        &self,
        line: &SceneLine,
        (id, task): (TaskId, &Task),
        record: AttemptRecord,
        ending: Ending,
    ) -> Result<(), FarmError> {
        (self.on_event)(Event::ChildLost { scene: line.id.clone(), reason: ending.reason.clone() });
        let record = record.end(self.store, ending)?;
        let actions = match self.judge(id, task, &record)? {
            PoisonCheck::Poison(reason) => self.tasks().set_aside(id, &reason),
            PoisonCheck::Clean | PoisonCheck::Suspect => self.tasks().retry(id),
        };
        self.perform(actions)?;
        self.went_wrong(line);
        Ok(())
    }
}
