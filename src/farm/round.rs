//! The coordinator's decision after a poll, as a pure function of the findings in the queue and the store.

use super::queue::QueueState;
use crate::run::ControlState;
use std::collections::BTreeSet;

pub(super) struct QueuePoll {
    pub(super) state: QueueState,
    /// True in the first poll, and if any process has created the queue since the last poll.
    pub(super) other: bool,
    /// Scenes with messages in the queue, if this round has listed them; a full round always does.
    pub(super) scenes: Option<BTreeSet<u32>>,
}

pub(super) struct Round<'a> {
    /// True if the round lists the whole queue and store instead of only changes.
    pub(super) full: bool,
    /// `None` if the queue cannot be reached.
    pub(super) queue: Option<&'a QueuePoll>,
    /// Scenes that are neither done nor in quarantine.
    pub(super) missing: &'a [usize],
    /// Missing scenes that stand still although the queue has messages of them.
    pub(super) stalled: &'a BTreeSet<usize>,
    /// True if a tuple or a quarantine record was removed.
    pub(super) taken_back: bool,
    pub(super) control: ControlState,
}

/// Findings that the next round needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Carried {
    /// True if the next round must be full.
    pub(super) due: bool,
    /// True if the queue was quiet. One quiet poll proves nothing, because a message may briefly count as neither
    /// waiting nor held.
    pub(super) was_quiet: bool,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Decision {
    /// Start a full round at once, because every scene seems to be done or in quarantine.
    Verify,
    Finish,
    Cancel,
    Wait,
    /// Publish these scenes, after a `purge` if it is set.
    Publish {
        purge: bool,
        scenes: Vec<usize>,
    },
}

/// Returns the decision after a poll, and the findings for the next round. That round must be full if no scene seems to
/// be missing, the run is paused, or the queue is lost or quiet; after a round that was not full, also if the queue is
/// new or a tuple or a quarantine record was removed.
pub(super) fn decide(round: &Round, before: Carried) -> (Decision, Carried) {
    let due = before.due || round.taken_back;
    let carried = |due| Carried { due, ..before };
    if round.missing.is_empty() {
        return if round.full {
            (Decision::Finish, before)
        } else {
            (Decision::Verify, carried(true))
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
    let absent = |purge: bool, scenes: &BTreeSet<u32>| {
        let is_absent = |scene: &&usize| {
            purge || !scenes.contains(&(**scene as u32)) || round.stalled.contains(*scene)
        };
        round.missing.iter().filter(is_absent).copied().collect::<Vec<usize>>()
    };
    let none = BTreeSet::new();
    let scenes = queue.scenes.as_ref();
    if !round.full {
        let after = Carried { due: due || queue.other || quiet, was_quiet: quiet };
        let scenes = scenes.map_or_else(Vec::new, |scenes| absent(false, scenes));
        if scenes.is_empty() {
            return (Decision::Wait, after);
        }
        return (Decision::Publish { purge: false, scenes }, after);
    }
    let scenes = scenes.unwrap_or(&none);
    // A quiet queue delivers nothing, so any messages in it are leftovers of a killed server.
    let purge = quiet && before.was_quiet && !scenes.is_empty();
    let after = Carried { due: quiet, was_quiet: quiet };
    (Decision::Publish { purge, scenes: absent(purge, scenes) }, after)
}

#[cfg(test)]
mod tests {
    use super::*;

    const BEFORE: Carried = Carried { due: false, was_quiet: false };

    fn queue(waiting: u64, held: u64, scenes: &[u32]) -> QueuePoll {
        QueuePoll {
            state: QueueState { waiting, held },
            other: false,
            scenes: Some(scenes.iter().copied().collect()),
        }
    }

    static NONE: BTreeSet<usize> = BTreeSet::new();

    fn round<'a>(queue: &'a QueuePoll, missing: &'a [usize], full: bool) -> Round<'a> {
        Round {
            full,
            queue: Some(queue),
            missing,
            stalled: &NONE,
            taken_back: false,
            control: ControlState::Running,
        }
    }

    fn publish(purge: bool, scenes: &[usize]) -> Decision {
        let scenes = scenes.to_vec();
        Decision::Publish { purge, scenes }
    }

    #[test]
    fn missing_scenes_that_are_not_in_the_queue_are_published() {
        let busy = queue(1, 1, &[1, 4]);
        let (decision, after) = decide(&round(&busy, &[0, 1, 4, 7], true), BEFORE);
        assert_eq!((decision, after), (publish(false, &[0, 7]), BEFORE));
        // A list of the queue between full rounds suffices; without one, the round only waits.
        let (decision, after) = decide(&round(&busy, &[0, 1], false), BEFORE);
        assert_eq!((decision, after), (publish(false, &[0]), BEFORE));
        let unlisted = QueuePoll { scenes: None, ..queue(1, 1, &[]) };
        let (decision, after) = decide(&round(&unlisted, &[0, 1], false), BEFORE);
        assert_eq!((decision, after), (Decision::Wait, BEFORE));
        let stalled = BTreeSet::from([4]);
        let still = Round { stalled: &stalled, ..round(&busy, &[1, 4], false) };
        assert_eq!(decide(&still, BEFORE).0, publish(false, &[4]));
    }

    #[test]
    fn a_queue_that_is_quiet_twice_is_purged() {
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
    fn a_full_round_precedes_the_end() {
        let empty = queue(0, 0, &[]);
        let (decision, after) = decide(&round(&empty, &[], false), BEFORE);
        assert_eq!((decision, after.due), (Decision::Verify, true));
        assert_eq!(decide(&round(&empty, &[], true), after).0, Decision::Finish);
    }

    #[test]
    fn removed_results_and_lost_new_or_quiet_queues_require_a_full_round() {
        let busy = queue(1, 1, &[0]);
        let due = |round: &Round| decide(round, BEFORE).1.due;
        assert!(!due(&round(&busy, &[0], false)));
        let taken_back = Round { taken_back: true, ..round(&busy, &[0], false) };
        assert!(due(&taken_back));
        let away = Round { queue: None, ..round(&busy, &[0], true) };
        assert!(due(&away));
        let other = QueuePoll { other: true, scenes: None, ..queue(1, 1, &[]) };
        assert!(due(&round(&other, &[0], false)));
        assert!(due(&round(&queue(0, 0, &[]), &[0], false)));
    }

    #[test]
    fn a_paused_or_cancelled_run_publishes_nothing() {
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
