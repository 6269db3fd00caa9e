//! Finds scenes that stand still although the queue has messages of them.
//!
//! A message in the queue proves nothing once a client holds it: a holder that only renews its lease, or that left a
//! forged message of a part of a scene, would keep the scene from everybody for ever. Only the store proves work: the
//! number of partials, and the attempts of workers with their signs of life. A scene of which the queue does not have
//! every shard waiting for its first delivery, and of which the store shows nothing new for two leases, is published
//! again. Together with the lists of the queue, of which there are four in a lease, that takes less than three leases.

use super::queue::{Listed, Message};
use super::worker::tasks::Time;
use std::collections::{BTreeMap, BTreeSet};

/// Lists of the queue in one lease.
pub(crate) const LISTS_PER_LEASE: u32 = 4;
/// Leases without progress after which a scene is published again.
const STANDS_LEASES: u32 = 2;

/// The scenes that wait for a client of the queue, and the time since which the store shows nothing new.
#[derive(Clone, Debug, Default)]
pub(crate) struct StallWatch {
    standing: BTreeMap<u32, Standing>,
}

#[derive(Clone, Copy, Debug)]
struct Standing {
    since: Time,
    /// The store's state at the last look.
    evidence: Option<u64>,
}

impl StallWatch {
    /// Takes a list of the queue's messages of each missing scene, with the scene's number of shards. Returns the scenes
    /// for which [`judge`](Self::judge) needs the store's state.
    pub(crate) fn observe<'l>(
        &mut self,
        now: Time,
        lease: Time,
        scenes: impl Iterator<Item = (u32, u32, &'l [Listed])>,
    ) -> Vec<u32> {
        let held: BTreeSet<u32> =
            scenes.filter(|(_, shards, of)| !all_wait(*shards, of)).map(|(s, ..)| s).collect();
        self.standing.retain(|scene, _| held.contains(scene));
        for scene in held {
            self.standing.entry(scene).or_insert(Standing { since: now, evidence: None });
        }
        let is_due = |standing: &Standing| {
            standing.evidence.is_some() || now.saturating_sub(standing.since) >= lease
        };
        self.standing.iter().filter(|(_, s)| is_due(s)).map(|(scene, _)| *scene).collect()
    }

    /// Takes the store's state of a scene. Returns true if the scene must be published again.
    pub(crate) fn judge(&mut self, now: Time, lease: Time, scene: u32, evidence: u64) -> bool {
        let Some(standing) = self.standing.get_mut(&scene) else {
            return false;
        };
        let before = standing.evidence.replace(evidence);
        if before.is_some_and(|before| before != evidence) {
            standing.since = now;
            return false;
        }
        let stalled =
            before.is_some() && now.saturating_sub(standing.since) >= lease * STANDS_LEASES;
        if stalled {
            standing.since = now;
        }
        stalled
    }
}

/// True if messages that wait for their first delivery have all shards of a scene.
fn all_wait(shards: u32, listed: &[Listed]) -> bool {
    let waiting = listed.iter().filter(|listed| listed.waits && listed.is_readable);
    let mut ranges: Vec<_> = waiting.map(|listed| listed.message.task.shards.clone()).collect();
    ranges.sort_by_key(|range| range.start);
    let reach = ranges
        .iter()
        .fold(0, |reach, range| if range.start <= reach { range.end.max(reach) } else { reach });
    reach >= shards
}

/// Returns the scenes with readable messages.
pub(crate) fn queued(listed: &BTreeMap<u32, Vec<Listed>>) -> BTreeSet<u32> {
    let has_any = |(_, of): &(&u32, &Vec<Listed>)| of.iter().any(|listed| listed.is_readable);
    listed.iter().filter(has_any).map(|(scene, _)| *scene).collect()
}

/// Returns a message of the same task with a subject that no message in the queue has, readable or not: the server
/// refuses a second one.
pub(crate) fn unlisted(mut message: Message, there: &[Listed]) -> Message {
    while there.iter().any(|listed| listed.message == message) {
        message.hops += 1;
    }
    message
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::Task;
    use std::ops::Range;

    const LEASE: Time = Time::from_secs(4);

    fn listed(shards: Range<u32>, waits: bool) -> Listed {
        let message = Message { task: Task { scene: 0, shards }, hops: 0 };
        Listed { message, waits, is_readable: true }
    }

    #[test]
    fn only_waiting_messages_of_all_shards_stand_for_a_scene() {
        assert!(all_wait(8, &[listed(0..8, true)]));
        assert!(all_wait(8, &[listed(4..8, true), listed(0..5, true)]));
        assert!(!all_wait(8, &[listed(0..4, true), listed(5..8, true)]));
        assert!(!all_wait(8, &[listed(0..8, false), listed(3..4, true)]));
        assert!(!all_wait(8, &[]));
    }

    /// Returns the times at which a scene is published again, s, if the store's state at time t is `evidence(t)`.
    fn published(message: &Listed, evidence: impl Fn(u64) -> u64) -> Vec<u64> {
        let mut watch = StallWatch::default();
        let mut times = Vec::new();
        for second in 0..40 {
            let now = Time::from_secs(second);
            let scenes = [(0, 8, std::slice::from_ref(message))];
            for scene in watch.observe(now, LEASE, scenes.into_iter()) {
                if watch.judge(now, LEASE, scene, evidence(second)) {
                    times.push(second);
                }
            }
        }
        times
    }

    #[test]
    fn a_scene_without_progress_is_published_again_within_three_leases() {
        let held = listed(0..8, false);
        assert_eq!(published(&held, |_| 0), [8, 16, 24, 32]);
        // The store changes once in a lease, or no more after 10 s.
        assert_eq!(published(&held, |second| second / 4), [0; 0]);
        assert_eq!(published(&held, |second| second.min(10) / 4), [16, 24, 32]);
        assert_eq!(published(&listed(0..8, true), |_| 0), [0; 0]);
        assert_eq!(published(&listed(2..3, true), |_| 0), [8, 16, 24, 32]);
    }
}
