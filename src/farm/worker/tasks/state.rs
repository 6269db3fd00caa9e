//! The states of a leased task, and the table of all transitions.

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TaskState {
    /// Leased, and its scene not loaded yet: it may be donated.
    Queued,
    /// Queued, but it has failed before: a donation would only pass the trouble on.
    Pinned,
    /// A compute thread loads its scene and the partials in the store.
    Loading,
    /// A child process traces it, since it may kill the process that traces it.
    Sandboxed,
    Tracing,
    /// All shards of its scene are in memory, and the tuple is made from them.
    Complete,
    /// Its own shards are in the store; the worker checks whether those of other workers are, too.
    Partial,
    /// The shards of other workers are fetched from the store.
    Gathering,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TaskEvent {
    /// Records of failed attempts at its scene were found.
    Pinned,
    LoadBegins,
    SandboxBegins,
    Loaded,
    /// The last shard of the scene is in memory.
    AllHere,
    /// The last of its own shards is in the store, or was donated.
    OwnStored,
    /// The store has all of the scene's shards.
    OthersStored,
    OthersMissing,
    /// The shards of other workers are in memory, too.
    Gathered,
    /// Some of them are damaged or gone.
    Damaged,
    TupleStored,
    /// Another worker has stored the tuple.
    DoneElsewhere,
    Failed,
    /// Another worker has the whole task.
    Donated,
    /// Its scene is done or in quarantine, or a child process has done the task.
    NothingToDo,
    /// Its scene has cost too many attempts.
    SetAside,
    /// It failed here; other workers try again.
    Retry,
    Requeue,
    /// The run is cancelled.
    Cancel,
}

/// How a task leaves a worker.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum End {
    Done,
    /// Its scene's tuple is in the store.
    Merged,
    /// Its shards are in the store, where another worker finds them.
    DoneInPart,
    /// Some of the scene's shards must be traced again.
    Damaged,
    Donated,
    /// Its scene goes into quarantine because it failed here.
    Failed,
    /// Its scene goes into quarantine because of its attempts, whose records stay.
    SetAside,
    /// Back to the queue; the record of the attempt stays.
    Retried,
    /// Back to the queue, without a failure.
    Requeued,
    Cancelled,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Next {
    To(TaskState),
    Ends(End),
}

/// The table of transitions. None if a task in this state ignores the event.
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
    /// Its scene is neither loaded nor being loaded.
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

    /// Every state is reached from `Queued`, and left by some event of the work itself.
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
