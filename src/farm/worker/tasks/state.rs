//! The states of a leased task, and the one table that says what may follow on what.

/// What a leased task is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::farm) enum TaskState {
    /// Leased, its scene not loaded yet: another worker may have it.
    Queued,
    /// The same, but it has failed before: donating it would only pass the trouble around.
    Pinned,
    /// A compute thread loads its scene and what the store has of it.
    Loading,
    /// A child process traces it, since it may kill whatever traces it.
    Sandboxed,
    /// Its shards are traced.
    Tracing,
    /// All shards of its scene are in memory: the tuple is made from them.
    Complete,
    /// Its own shards are in the store, other workers have the rest: is that there, too?
    Partial,
    /// The rest is there, and is fetched.
    Gathering,
}

/// What happens to a task.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::farm) enum TaskEvent {
    /// Records of failed attempts at its scene were found.
    Pinned,
    /// A compute thread takes it.
    LoadBegins,
    /// A child process takes it.
    SandboxBegins,
    /// Its scene is loaded.
    Loaded,
    /// The last shard of the scene is in memory.
    AllHere,
    /// The last of its own shards is in the store, or was donated.
    OwnStored,
    /// The store has all of the scene's shards.
    OthersStored,
    /// It has not.
    OthersMissing,
    /// The other workers' shards are in memory, too.
    Gathered,
    /// Some of them turned out to be damaged, or gone.
    Damaged,
    /// The scene's tuple is in the store.
    TupleStored,
    /// Another worker has put it there.
    DoneElsewhere,
    /// The scene cannot be done.
    Failed,
    /// Another worker has all of it.
    Donated,
    /// Its scene is done, or set aside, or a child has done it.
    NothingToDo,
    /// Its scene has cost too many attempts.
    SetAside,
    /// It failed here; other workers are to try.
    Retry,
    Requeue,
    /// The run is cancelled.
    Cancel,
}

/// How a task leaves a worker.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::farm) enum End {
    /// Nothing is left to do.
    Done,
    /// Its scene's tuple is in the store.
    Merged,
    /// Its shards are in the store, and another worker will find them there.
    DoneInPart,
    /// Some of the scene's shards have to be traced again, by whichever worker gets them.
    Damaged,
    /// Another worker has it.
    Donated,
    /// Its scene goes into quarantine because it failed here.
    Failed,
    /// Its scene goes into quarantine because of its attempts, whose records stay.
    SetAside,
    /// Into the queue again; the record of the attempt stays.
    Retried,
    /// Into the queue again; nothing is wrong with it.
    Requeued,
    /// Left as it is.
    Cancelled,
}

/// What follows on an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::farm) enum Next {
    To(TaskState),
    Ends(End),
}

/// The table. None: the event says nothing to a task in this state, and is ignored.
pub(in crate::farm) fn next(state: TaskState, event: TaskEvent) -> Option<Next> {
    use Next::{Ends, To};
    use TaskEvent as E;
    use TaskState as S;
    Some(match (state, event) {
        (S::Queued | S::Pinned, E::Pinned) => To(S::Pinned),
        (S::Queued | S::Pinned, E::LoadBegins) => To(S::Loading),
        (S::Queued | S::Pinned, E::SandboxBegins) => To(S::Sandboxed),
        // One that is being loaded is not left alone any more: both workers do it.
        (S::Queued, E::Donated) => Ends(End::Donated),
        (S::Queued | S::Pinned | S::Sandboxed, E::NothingToDo) => Ends(End::Done),
        (S::Queued | S::Pinned | S::Sandboxed, E::SetAside) => Ends(End::SetAside),
        (S::Queued | S::Pinned | S::Sandboxed, E::Retry) => Ends(End::Retried),
        (S::Loading, E::Loaded) => To(S::Tracing),
        (S::Tracing, E::AllHere) => To(S::Complete),
        (S::Tracing, E::OwnStored) => To(S::Partial),
        (S::Partial, E::OthersStored) => To(S::Gathering),
        (S::Partial, E::OthersMissing) => Ends(End::DoneInPart),
        (S::Gathering, E::Gathered) => To(S::Complete),
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
    /// Its scene is not loaded, nor being loaded.
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

    /// From a queued task every state is reached, and from every state the work can end without a stop.
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
