//! The ways in which a task leaves a worker, and the actions of each.

use super::state::{End, Next, TaskEvent, next};
use super::{Action, Entry, TaskId, Tasks};

impl<P> Tasks<P> {
    pub(crate) fn merged(&mut self, task: TaskId) -> Vec<Action> {
        self.end(task, TaskEvent::TupleStored)
    }

    /// Another worker has stored the scene's tuple.
    pub(crate) fn done_elsewhere(&mut self, task: TaskId) -> Vec<Action> {
        self.end(task, TaskEvent::DoneElsewhere)
    }

    /// The scene cannot be done.
    pub(crate) fn fail(&mut self, task: TaskId, reason: &str) -> Vec<Action> {
        self.quarantine(task, TaskEvent::Failed, reason)
    }

    /// The scene cost too many attempts.
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

    /// The task failed here; other workers try again. The record of the attempt stays.
    pub(crate) fn retry(&mut self, task: TaskId) -> Vec<Action> {
        self.end(task, TaskEvent::Retry)
    }

    /// Leaves the task, which has not failed, to other workers.
    pub(crate) fn requeue(&mut self, task: TaskId) -> Vec<Action> {
        self.end(task, TaskEvent::Requeue)
    }

    /// Leaves all tasks to other workers. Attempts are forgotten first: if the queue is away and leases end by themselves, no
    /// scene is blamed.
    pub(crate) fn requeue_all(&mut self) -> Vec<Action> {
        let mut actions = self.end_all(TaskEvent::Requeue, |_| true);
        actions
            .sort_by_key(|action| matches!(action, Action::Replace { .. } | Action::Finish { .. }));
        actions
    }

    /// Leaves the tasks without a loaded scene to other workers: this worker hangs.
    pub(crate) fn requeue_waiting(&mut self) -> Vec<Action> {
        let mut actions = self.end_all(TaskEvent::Requeue, |entry| entry.state.waits());
        // The store may hang, so the queue comes first.
        actions.sort_by_key(|action| matches!(action, Action::ForgetAttempt { .. }));
        actions
    }

    /// The run is cancelled: leaves everything as it is.
    pub(crate) fn cancel(&mut self) -> Vec<Action> {
        self.end_all(TaskEvent::Cancel, |_| true)
    }

    fn end_all(&mut self, event: TaskEvent, is: impl Fn(&Entry<P>) -> bool) -> Vec<Action> {
        let chosen = |(task, entry): (&TaskId, &Entry<P>)| is(entry).then_some(*task);
        let tasks: Vec<TaskId> = self.entries.iter().filter_map(chosen).collect();
        tasks.into_iter().flat_map(|task| self.end(task, event)).collect()
    }

    /// Ends a task if the table says so.
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
        let note = || Action::LeaveNote { task: leased.clone() };
        let replace = || Action::Replace { lease, messages: entry.rest() };
        let remove = Action::RemovePartials { scene: leased.scene };
        let actions = match end {
            End::Merged => vec![Some(remove), forget, Some(finish)],
            End::DoneInPart => vec![Some(note()), forget, Some(finish)],
            End::Done | End::Damaged | End::Donated | End::Failed => vec![forget, Some(finish)],
            End::SetAside => vec![Some(finish)],
            End::Retried => vec![Some(replace())],
            End::Requeued => {
                let note = entry.shards.has_stored().then(note);
                vec![forget, note, Some(replace())]
            }
            End::Cancelled => vec![forget],
        };
        self.entries.remove(&task);
        actions.into_iter().flatten().collect()
    }
}
