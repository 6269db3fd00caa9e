//! What a coordinator does after a look at the queue and the store: a function of what it found.

use super::queue::QueueState;
use crate::run::ControlState;
use std::collections::BTreeSet;

/// What one look at the queue found.
pub(super) struct QueueLook {
    pub(super) state: QueueState,
    /// It is another queue than at the last look.
    pub(super) other: bool,
    /// Scenes in it, if it was a look at everything.
    pub(super) scenes: BTreeSet<u32>,
}

/// What a round found.
pub(super) struct Round<'a> {
    /// It looked at everything, not only at what changes.
    pub(super) everything: bool,
    /// None if the queue is away.
    pub(super) queue: Option<&'a QueueLook>,
    /// Scenes that are neither done nor in quarantine.
    pub(super) missing: &'a [usize],
    /// Something done or set aside was taken back.
    pub(super) taken_back: bool,
    pub(super) control: ControlState,
}

/// What the next round has to know of this one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Carried {
    /// The next look is at everything.
    pub(super) due: bool,
    /// The queue was quiet. A message on its way from one of its counts to the other is in neither for a moment.
    pub(super) was_quiet: bool,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Decision {
    /// At once: nothing seems to be left to do.
    LookAtEverything,
    /// Nothing is left to do.
    Finish,
    /// The run is cancelled.
    Cancel,
    Wait,
    /// Put these scenes into the queue, `purge` it first.
    Publish {
        purge: bool,
        scenes: Vec<usize>,
    },
}

/// Everything is looked at, and what is missing published, at the start, when nothing is in the queue, when it is another
/// one, when something done or set aside was taken back, before the end, and now and then.
pub(super) fn decide(round: &Round, before: Carried) -> (Decision, Carried) {
    let due = before.due || round.taken_back;
    let carried = |due| Carried { due, ..before };
    if round.missing.is_empty() {
        return if round.everything {
            (Decision::Finish, before)
        } else {
            (Decision::LookAtEverything, carried(true))
        };
    }
    if round.control == ControlState::Cancelled {
        return (Decision::Cancel, before);
    }
    let Some(queue) = round.queue else {
        return (Decision::Wait, carried(true));
    };
    if round.control == ControlState::Paused {
        return (Decision::Wait, carried(true));
    }
    let quiet = queue.state.is_quiet();
    if !round.everything {
        let after = Carried { due: due || queue.other || quiet, was_quiet: quiet };
        return (Decision::Wait, after);
    }
    // No worker will get what is left in a quiet queue: leftovers of a server that was killed.
    let purge = quiet && before.was_quiet && !queue.scenes.is_empty();
    let is_absent = |scene: &&usize| purge || !queue.scenes.contains(&(**scene as u32));
    let scenes = round.missing.iter().filter(is_absent).copied().collect();
    let after = Carried { due: quiet, was_quiet: quiet };
    (Decision::Publish { purge, scenes }, after)
}

#[cfg(test)]
mod tests {
    use super::*;

    const BEFORE: Carried = Carried { due: false, was_quiet: false };

    fn queue(waiting: u64, held: u64, scenes: &[u32]) -> QueueLook {
        QueueLook {
            state: QueueState { waiting, held },
            other: false,
            scenes: scenes.iter().copied().collect(),
        }
    }

    fn round<'a>(queue: &'a QueueLook, missing: &'a [usize], everything: bool) -> Round<'a> {
        Round {
            everything,
            queue: Some(queue),
            missing,
            taken_back: false,
            control: ControlState::Running,
        }
    }

    fn publish(purge: bool, scenes: &[usize]) -> Decision {
        let scenes = scenes.to_vec();
        Decision::Publish { purge, scenes }
    }

    #[test]
    fn what_is_missing_and_not_in_the_queue_is_published() {
        let busy = queue(1, 1, &[1, 4]);
        let (decision, after) = decide(&round(&busy, &[0, 1, 4, 7], true), BEFORE);
        assert_eq!((decision, after), (publish(false, &[0, 7]), BEFORE));
        let (decision, after) = decide(&round(&busy, &[0, 1], false), BEFORE);
        assert_eq!((decision, after), (Decision::Wait, BEFORE));
    }

    #[test]
    fn a_queue_that_is_quiet_twice_holds_leftovers() {
        let quiet = queue(0, 0, &[1]);
        let (decision, once) = decide(&round(&quiet, &[0, 1], true), BEFORE);
        assert_eq!(decision, publish(false, &[0]));
        assert_eq!((once.due, once.was_quiet), (true, true));
        let (decision, _) = decide(&round(&quiet, &[0, 1], true), once);
        assert_eq!(decision, publish(true, &[0, 1]));
        let empty = queue(0, 0, &[]);
        let (decision, _) = decide(&round(&empty, &[1], true), once);
        assert_eq!(decision, publish(false, &[1]));
    }

    #[test]
    fn everything_is_looked_at_before_the_end() {
        let empty = queue(0, 0, &[]);
        let (decision, after) = decide(&round(&empty, &[], false), BEFORE);
        assert_eq!((decision, after.due), (Decision::LookAtEverything, true));
        assert_eq!(decide(&round(&empty, &[], true), after).0, Decision::Finish);
    }

    #[test]
    fn a_look_at_everything_becomes_due() {
        let busy = queue(1, 1, &[0]);
        let due = |round: &Round| decide(round, BEFORE).1.due;
        assert!(!due(&round(&busy, &[0], false)));
        let taken_back = Round { taken_back: true, ..round(&busy, &[0], false) };
        assert!(due(&taken_back));
        let away = Round { queue: None, ..round(&busy, &[0], true) };
        assert!(due(&away));
        let other = QueueLook { other: true, ..queue(1, 1, &[]) };
        assert!(due(&round(&other, &[0], false)));
        assert!(due(&round(&queue(0, 0, &[]), &[0], false)));
    }

    #[test]
    fn a_run_that_is_held_publishes_nothing() {
        let empty = queue(0, 0, &[]);
        let told = |control| {
            let held = Round { control, ..round(&empty, &[0], true) };
            decide(&held, BEFORE)
        };
        let (decision, after) = told(ControlState::Paused);
        assert_eq!((decision, after.due), (Decision::Wait, true));
        assert_eq!(told(ControlState::Cancelled).0, Decision::Cancel);
    }
}
