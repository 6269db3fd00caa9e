//! The states of a leased task, and the table of all transitions.

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TaskState {
    /// Leased, but the scene is not loaded yet; the task may be donated.
    Queued,
    /// Queued, but the scene may fail; a donation would only move the problem.
    Pinned,
    /// A compute thread loads the scene and its partials in the store.
    Loading,
    /// A child process traces the task, because the task may kill the process that traces it.
    Sandboxed,
    Tracing,
    /// All shards of the scene are in memory, and the worker makes the tuple from them.
    Complete,
    /// The task's own shards are in the store; the worker checks whether those of other workers are, too.
    Partial,
    /// The worker fetches the shards of other workers from the store.
    Gathering,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TaskEvent {
    /// The store has records of attempts at the scene, or this machine cannot read the scene's files.
    Pinned,
    LoadBegins,
    SandboxBegins,
    Loaded,
    /// The last shard of the scene is in memory.
    AllHere,
    /// The last of the task's own shards is in the store, or was donated.
    OwnStored,
    /// The store has all of the scene's shards.
    OthersStored,
    OthersMissing,
    /// The shards of other workers are in memory, too.
    Gathered,
    /// Some shards of other workers are damaged or gone.
    Damaged,
    TupleStored,
    /// Another worker has stored the tuple.
    DoneElsewhere,
    Failed,
    /// Another worker has the whole task.
    Donated,
    /// The scene is done or in quarantine, or a child process has done the task.
    NothingToDo,
    /// The scene has cost too many attempts.
    SetAside,
    /// The task failed here; other workers try again.
    Retry,
    Requeue,
    /// The run is cancelled.
    Cancel,
}

/// The way in which a task leaves a worker.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum End {
    Done,
    /// The scene's tuple is in the store.
    Merged,
    /// The task's shards are in the store, where another worker finds them.
    DoneInPart,
    /// Some of the scene's shards must be traced again.
    Damaged,
    Donated,
    /// The scene goes into quarantine because it failed here.
    Failed,
    /// The scene goes into quarantine after too many attempts; the records of the attempts stay.
    SetAside,
    /// The task is requeued after a failure; the record of the attempt stays.
    Retried,
    /// The task is requeued without a failure.
    Requeued,
    Cancelled,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Next {
    To(TaskState),
    Ends(End),
}

/// Returns the transition of a task, or `None` if a task in this state ignores the event.
pub(super) fn next(state: TaskState, event: TaskEvent) -> Option<Next> {
    use Next::{Ends, To};
    use TaskEvent as E;
    use TaskState as S;
    Some(match (state, event) {
        (S::Queued | S::Pinned, E::Pinned) => To(S::Pinned),
        (S::Queued | S::Pinned, E::LoadBegins) => To(S::Loading),
        (S::Queued | S::Pinned, E::SandboxBegins) => To(S::Sandboxed),
        // A donation confirmed after loading began is ignored: both workers do the task.
        (S::Queued, E::Donated) => Ends(End::Donated),
        (S::Queued | S::Pinned | S::Sandboxed, E::NothingToDo) => Ends(End::Done),
        (S::Queued | S::Pinned | S::Sandboxed, E::SetAside) => Ends(End::SetAside),
        (S::Queued | S::Pinned | S::Sandboxed, E::Retry) => Ends(End::Retried),
        (S::Loading, E::Loaded) => To(S::Tracing),
        (S::Tracing, E::AllHere) | (S::Gathering, E::Gathered) => To(S::Complete),
        (S::Tracing, E::OwnStored) => To(S::Partial),
        (S::Partial, E::OthersStored) => To(S::Gathering),
        (S::Partial, E::OthersMissing) => Ends(End::DoneInPart),
        (S::Gathering, E::Damaged) => Ends(End::Damaged),
        (S::Complete, E::TupleStored)
        | (S::Tracing | S::Complete | S::Partial | S::Gathering, E::DoneElsewhere) => {
            Ends(End::Merged)
        }
        (S::Loading | S::Tracing | S::Complete | S::Partial | S::Gathering, E::Failed) => {
            Ends(End::Failed)
        }
        (_, E::Requeue) => Ends(End::Requeued),
        (_, E::Cancel) => Ends(End::Cancelled),
        _ => return None,
    })
}

impl TaskState {
    /// True if the scene is neither loaded nor being loaded.
    pub(super) fn waits(self) -> bool {
        matches!(self, Self::Queued | Self::Pinned)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use TaskEvent as E;
    use TaskState as S;

    const STATES: [S; 8] = [
        S::Queued,
        S::Pinned,
        S::Loading,
        S::Sandboxed,
        S::Tracing,
        S::Complete,
        S::Partial,
        S::Gathering,
    ];

    const EVENTS: [E; 19] = [
        E::Pinned,
        E::LoadBegins,
        E::SandboxBegins,
        E::Loaded,
        E::AllHere,
        E::OwnStored,
        E::OthersStored,
        E::OthersMissing,
        E::Gathered,
        E::Damaged,
        E::TupleStored,
        E::DoneElsewhere,
        E::Failed,
        E::Donated,
        E::NothingToDo,
        E::SetAside,
        E::Retry,
        E::Requeue,
        E::Cancel,
    ];

    /// Every state can be reached from `Queued` and left by an event of the work itself.
    #[test]
    fn every_state_is_reached_and_left() {
        let mut reached = vec![S::Queued];
        let mut k = 0;
        while let Some(&state) = reached.get(k) {
            let after = EVENTS.iter().filter_map(|&event| next(state, event));
            for next in after {
                if let Next::To(state) = next
                    && !reached.contains(&state)
                {
                    reached.push(state);
                }
            }
            k += 1;
        }
        assert!(STATES.iter().all(|state| reached.contains(state)));
        for state in STATES {
            let in_order = EVENTS.iter().filter(|event| !matches!(event, E::Requeue | E::Cancel));
            assert!(in_order.filter_map(|&event| next(state, event)).count() > 0);
        }
    }

    #[test]
    fn only_a_queued_task_is_donated_whole_and_only_a_complete_one_makes_a_tuple() {
        for state in STATES {
            assert_eq!(next(state, E::Donated).is_some(), state == S::Queued);
            assert_eq!(next(state, E::TupleStored).is_some(), state == S::Complete);
            assert_eq!(next(state, E::Requeue), Some(Next::Ends(End::Requeued)));
        }
    }
}
