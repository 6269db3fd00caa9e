//! The ways in which a task leaves a worker, and what has to be done for each.

use super::state::{End, Next, TaskEvent, next};
use super::{Action, Entry, TaskId, Tasks};

impl<P> Tasks<P> {
    /// The scene's tuple is in the store.
    pub(in crate::farm) fn merged(&mut self, task: TaskId) -> Vec<Action> {
        self.end(task, TaskEvent::TupleStored)
    }

    /// Another worker has put the scene's tuple there.
    pub(in crate::farm) fn done_elsewhere(&mut self, task: TaskId) -> Vec<Action> {
        self.end(task, TaskEvent::DoneElsewhere)
    }

    /// The scene cannot be done.
    pub(in crate::farm) fn fail(&mut self, task: TaskId, reason: &str) -> Vec<Action> {
        self.quarantine(task, TaskEvent::Failed, reason)
    }

    /// The scene cost too many attempts.
    pub(in crate::farm) fn set_aside(&mut self, task: TaskId, reason: &str) -> Vec<Action> {
        self.quarantine(task, TaskEvent::SetAside, reason)
    }

    fn quarantine(&mut self, task: TaskId, event: TaskEvent, reason: &str) -> Vec<Action> {
        let Some(scene) = self.entries.get(&task).map(|e| e.message.task.scene) else {
            return Vec::new();
        };
        let mut actions = self.end(task, event);
        if !actions.is_empty() {
            let reason = reason.to_owned();
            actions.insert(0, Action::Quarantine { scene, reason });
        }
        actions
    }

    /// Nothing is left to do of it.
    pub(in crate::farm) fn nothing_to_do(&mut self, task: TaskId) -> Vec<Action> {
        self.end(task, TaskEvent::NothingToDo)
    }

    /// It failed here: other workers are to try. The record of the attempt stays.
    pub(in crate::farm) fn retry(&mut self, task: TaskId) -> Vec<Action> {
        self.end(task, TaskEvent::Retry)
    }

    /// Others are to do it; nothing is wrong with it.
    pub(in crate::farm) fn requeue(&mut self, task: TaskId) -> Vec<Action> {
        self.end(task, TaskEvent::Requeue)
    }

    /// Leaves all tasks to other workers. First all attempts are forgotten: of what the queue cannot be told the leases
    /// end, and no scene is blamed for it.
    pub(in crate::farm) fn requeue_all(&mut self) -> Vec<Action> {
        let tasks: Vec<TaskId> = self.entries.keys().copied().collect();
        let mut actions: Vec<Action> = Vec::new();
        for task in tasks {
            actions.extend(self.end(task, TaskEvent::Requeue));
        }
        actions
            .sort_by_key(|action| matches!(action, Action::Publish { .. } | Action::Finish { .. }));
        actions
    }

    /// Leaves those to other workers whose scenes are not loaded: this one hangs with another.
    pub(in crate::farm) fn requeue_waiting(&mut self) -> Vec<Action> {
        let waits = |(task, entry): (&TaskId, &Entry<P>)| entry.state.waits().then_some(*task);
        let tasks: Vec<TaskId> = self.entries.iter().filter_map(waits).collect();
        let mut actions: Vec<Action> = Vec::new();
        for task in tasks {
            actions.extend(self.end(task, TaskEvent::Requeue));
        }
        // A store that hangs must not keep the queue from being told.
        actions.sort_by_key(|action| matches!(action, Action::ForgetAttempt { .. }));
        actions
    }

    /// Leaves everything as it is: the run is cancelled.
    pub(in crate::farm) fn cancel(&mut self) -> Vec<Action> {
        let tasks: Vec<TaskId> = self.entries.keys().copied().collect();
        let cancel = |task| self.end(task, TaskEvent::Cancel);
        tasks.into_iter().flat_map(cancel).collect()
    }

    /// Ends a task as the table says; nothing if it does not.
    pub(super) fn end(&mut self, task: TaskId, event: TaskEvent) -> Vec<Action> {
        let Some(entry) = self.entries.get(&task) else {
            return Vec::new();
        };
        let Some(Next::Ends(end)) = next(entry.state, event) else {
            return Vec::new();
        };
        let leased = entry.message.task.clone();
        let forget = entry.attempt.map(|n| Action::ForgetAttempt { task: leased.clone(), n });
        let finish = Action::Finish { lease: entry.lease };
        let note = || Action::LeaveNote { task: leased.clone() };
        let mut actions = Vec::new();
        match end {
            End::Merged => {
                actions.push(Action::RemovePartials { scene: leased.scene });
                actions.extend(forget);
                actions.push(finish);
            }
            End::DoneInPart => {
                actions.push(note());
                actions.extend(forget);
                actions.push(finish);
            }
            End::Done | End::Damaged | End::Donated | End::Failed => {
                actions.extend(forget);
                actions.push(finish);
            }
            End::SetAside => actions.push(finish),
            End::Retried => {
                actions.push(Action::Publish { messages: entry.rest() });
                actions.push(finish);
            }
            End::Requeued => {
                actions.extend(forget);
                actions.extend(entry.shards.has_stored().then(note));
                actions.push(Action::Publish { messages: entry.rest() });
                actions.push(finish);
            }
            End::Cancelled => actions.extend(forget),
        }
        self.entries.remove(&task);
        actions
    }
}
