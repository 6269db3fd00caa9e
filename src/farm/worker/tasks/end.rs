//! The ways in which a task leaves a worker, and the actions of each.

use super::state::{End, Next, TaskEvent, next};
use super::{Action, Entry, TaskId, Tasks};

impl<P> Tasks<P> {
    pub(crate) fn merged(&mut self, task: TaskId) -> Vec<Action> {
        self.end(task, TaskEvent::TupleStored)
    }

    /// Ends a task after another worker has stored the scene's tuple.
    pub(crate) fn done_elsewhere(&mut self, task: TaskId) -> Vec<Action> {
        self.end(task, TaskEvent::DoneElsewhere)
    }

    /// Ends a task and quarantines its scene, which cannot be rendered.
    pub(crate) fn fail(&mut self, task: TaskId, reason: &str) -> Vec<Action> {
        self.quarantine(task, TaskEvent::Failed, reason)
    }

    /// Ends a task and quarantines its scene, which cost too many attempts.
    pub(crate) fn set_aside(&mut self, task: TaskId, reason: &str) -> Vec<Action> {
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

    pub(crate) fn nothing_to_do(&mut self, task: TaskId) -> Vec<Action> {
        self.end(task, TaskEvent::NothingToDo)
    }

    /// Requeues a task that failed here. The record of the attempt stays.
    pub(crate) fn retry(&mut self, task: TaskId) -> Vec<Action> {
        self.end(task, TaskEvent::Retry)
    }

    /// Requeues a task that has not failed.
    pub(crate) fn requeue(&mut self, task: TaskId) -> Vec<Action> {
        self.end(task, TaskEvent::Requeue)
    }

    /// Requeues all tasks. Attempts are forgotten first, so that no scene is blamed if the queue cannot be reached and
    /// the leases expire.
    pub(crate) fn requeue_all(&mut self) -> Vec<Action> {
        let mut actions = self.end_all(TaskEvent::Requeue, |_| true);
        actions
            .sort_by_key(|action| matches!(action, Action::Replace { .. } | Action::Finish { .. }));
        actions
    }

    /// Requeues the queued and pinned tasks but the one whose intake may hang, because this worker hangs.
    pub(crate) fn requeue_waiting(&mut self) -> Vec<Action> {
        let mut actions =
            self.end_all(TaskEvent::Requeue, |entry| entry.state.waits() && !entry.is_taken_in);
        // The store may hang, so the queue's actions come first.
        actions.sort_by_key(|action| matches!(action, Action::ForgetAttempt { .. }));
        actions
    }

    /// Ends all tasks of a cancelled run without requeuing them.
    pub(crate) fn cancel(&mut self) -> Vec<Action> {
        self.end_all(TaskEvent::Cancel, |_| true)
    }

    fn end_all(&mut self, event: TaskEvent, is: impl Fn(&Entry<P>) -> bool) -> Vec<Action> {
        let chosen = |(task, entry): (&TaskId, &Entry<P>)| is(entry).then_some(*task);
        let tasks: Vec<TaskId> = self.entries.iter().filter_map(chosen).collect();
        tasks.into_iter().flat_map(|task| self.end(task, event)).collect()
    }

    /// Ends a task if the table has an end for the event.
    pub(super) fn end(&mut self, task: TaskId, event: TaskEvent) -> Vec<Action> {
        let Some(entry) = self.entries.get(&task) else {
            return Vec::new();
        };
        let Some(Next::Ends(end)) = next(entry.state, event) else {
            return Vec::new();
        };
        let leased = entry.message.task.clone();
        let forget = entry.attempt.map(|n| Action::ForgetAttempt { task: leased.clone(), n });
        let lease = entry.lease;
        let finish = Action::Finish { lease };
        let replace = || Action::Replace { lease, messages: entry.rest() };
        let remove = Action::RemovePartials { scene: leased.scene };
        let actions = match end {
            End::Merged => vec![Some(remove), forget, Some(finish)],
            End::DoneInPart | End::Done | End::Damaged | End::Donated | End::Failed => {
                vec![forget, Some(finish)]
            }
            End::SetAside => vec![Some(finish)],
            End::Retried => vec![Some(replace())],
            End::Requeued => vec![forget, Some(replace())],
            End::Cancelled => vec![forget],
        };
        self.entries.remove(&task);
        actions.into_iter().flatten().collect()
    }
}
