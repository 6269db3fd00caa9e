//! Tasks that may kill the process that traces them are traced by a child process.

use super::core::Worker;
use super::tasks::TaskId;
use crate::farm::FarmError;
use crate::run::{AttemptRecord, Ending, Event, PoisonCheck, Task, attempts, poison_check};
use render::ids::SceneId;
use render::line::SceneLine;

/// Traces tasks in another process, since they may kill it.
pub trait Sandbox: Sync {
    /// Traces shards of a scene and writes what comes of it to the run's store. `on_sign` is called while there is
    /// progress; when `must_stop` says so the process is ended.
    fn trace(
        &self,
        scene: &SceneId,
        task: &Task,
        on_sign: &dyn Fn(),
        must_stop: &dyn Fn() -> bool,
    ) -> SandboxEnd;
}

#[derive(Clone, Debug)]
pub enum SandboxEnd {
    /// All of it is durable, or its scene is in quarantine.
    Done {
        /// Tuples written: one or none.
        merged: u64,
        traced: u64,
        resumed: u64,
        /// Scenes loaded: one, if it got so far.
        loaded: u64,
        /// Why the scene is in quarantine, if it is.
        quarantined: Option<String>,
    },
    /// It was told to end before its end.
    Stopped,
    /// It died, or made no progress.
    Lost(Ending),
    /// It could not work, which is not the scene's fault.
    Failed(String),
}

impl Worker<'_> {
    /// Has a task traced by a child.
    pub(super) fn trace_in(
        &self,
        sandbox: &dyn Sandbox,
        line: &SceneLine,
        (id, task): (TaskId, &Task),
        record: AttemptRecord,
    ) -> Result<(), FarmError> {
        let now = self.now();
        if !self.tasks().sandbox(id, now) {
            // Donated meanwhile.
            return Ok(());
        }
        (self.on_event)(Event::Isolated { scene: line.id.clone() });
        let on_sign = || self.progress(id);
        let end = sandbox.trace(&line.id, task, &on_sign, &|| self.must_stop());
        let actions = match end {
            SandboxEnd::Done { merged, traced, resumed, loaded, quarantined } => {
                self.tally.add_sandboxed_loads(loaded);
                self.count(line, [merged, traced, resumed], quarantined);
                self.tasks().nothing_to_do(id)
            }
            SandboxEnd::Stopped => self.tasks().requeue(id),
            SandboxEnd::Lost(ending) => return self.lost(line, (id, task), record, ending),
            SandboxEnd::Failed(reason) => return Err(FarmError::Isolated(reason)),
        };
        self.perform(actions)
    }

    /// Adds what a child did to what this process did.
    fn count(&self, line: &SceneLine, counts: [u64; 3], quarantined: Option<String>) {
        let [merged, traced, resumed] = counts;
        self.tally.add_merged(merged);
        self.tally.add_traced(traced);
        self.tally.add_resumed(resumed);
        for shard in 0..traced + resumed {
            (self.on_event)(Event::ShardDone { resumed: shard >= traced });
        }
        if merged > 0 {
            (self.on_event)(Event::SceneMerged { scene: line.id.clone(), miss_share: 0.0 });
        }
        match quarantined {
            Some(reason) => self.tell_quarantine(line, &reason),
            None => self.stop.went_well(),
        }
    }

    /// A child was lost with a task: other workers try, unless that happened too often.
    fn lost(
        &self,
        line: &SceneLine,
        (id, task): (TaskId, &Task),
        record: AttemptRecord,
        ending: Ending,
    ) -> Result<(), FarmError> {
        (self.on_event)(Event::ChildLost { scene: line.id.clone(), reason: ending.reason.clone() });
        let found = record.found;
        record.end(self.store, ending)?;
        let actions = match poison_check(&attempts(self.store, &line.id)?, task, found) {
            PoisonCheck::Poison(reason) => self.tasks().set_aside(id, &reason),
            PoisonCheck::Clean | PoisonCheck::Suspect => self.tasks().retry(id),
        };
        self.perform(actions)?;
        self.went_wrong(line);
        Ok(())
    }
}
