//! What a busy worker donates, and when it should lease more.
//!
//! One rule keeps everything covered: a donor publishes first, waits until the queue has it, and only then leaves those
//! shards alone. Two workers may then trace the same shard, which costs time and changes nothing; that no worker traces a
//! shard cannot happen.

use super::super::costs::Costs;
use super::{TaskId, TaskState, Tasks};
use std::ops::Range;

/// A task as a candidate for donation.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::farm) struct Candidate {
    pub(in crate::farm) task: TaskId,
    /// Its scene is loaded.
    pub(in crate::farm) opened: bool,
    /// Shards at its end that no thread has begun.
    pub(in crate::farm) unbegun: Range<u32>,
    /// Estimated seconds until those are done.
    pub(in crate::farm) unbegun_s: f64,
}

/// Donating a part of an opened task must save this many times what loading its scene again costs.
const WORTH_LOADS: f64 = 2.0;

/// The next task is leased when the open ones last for so many loads at most.
const LOADS_AHEAD: f64 = 2.0;

/// What to publish when another worker is idle, which needs `slowness` times as long for the same and loads a scene in
/// `load_s`: the later half of the tasks that are not opened, else the end of the longest rest of an opened one, so much
/// that both are done at the same time; nothing if that is not worth loading its scene twice.
pub(in crate::farm) fn choose(
    candidates: &[Candidate],
    slowness: f64,
    load_s: f64,
) -> Vec<(TaskId, Range<u32>)> {
    let waiting: Vec<&Candidate> = candidates.iter().filter(|c| !c.opened).collect();
    if !waiting.is_empty() {
        let later = waiting[waiting.len() / 2..].iter();
        return later.map(|c| (c.task, c.unbegun.clone())).collect();
    }
    let longest = candidates
        .iter()
        .filter(|c| !c.unbegun.is_empty() && c.unbegun_s > WORTH_LOADS * load_s)
        .max_by(|a, b| a.unbegun_s.total_cmp(&b.unbegun_s));
    let share = longest.and_then(|c| Some((c.task, later_share(c, slowness, load_s)?)));
    share.into_iter().collect()
}

/// The later half, the larger one if the count is odd; a smaller part for a slower worker, none if that would take longer
/// there than all of it here.
fn later_share(from: &Candidate, slowness: f64, load_s: f64) -> Option<Range<u32>> {
    let (shards, count) = (&from.unbegun, from.unbegun.len() as f64);
    let donated = (count / (1.0 + slowness) + 0.5).floor().min(count);
    let shard_s = from.unbegun_s / count;
    // The donor traces another shard meanwhile.
    let worth = slowness <= 1.0 || load_s + donated * shard_s * slowness < from.unbegun_s + shard_s;
    (worth && donated > 0.0).then(|| shards.end - donated as u32..shards.end)
}

impl<P> Tasks<P> {
    /// Without what is pinned, and what is being loaded.
    pub(super) fn candidates(&self, costs: Costs) -> Vec<Candidate> {
        let of = |(&task, entry): (&TaskId, &super::Entry<P>)| {
            let unbegun = match entry.state {
                TaskState::Queued => entry.message.task.shards.clone(),
                TaskState::Tracing => entry.shards.unbegun(),
                _ => return None,
            };
            (!unbegun.is_empty()).then(|| Candidate {
                task,
                opened: entry.state == TaskState::Tracing,
                unbegun_s: unbegun.len() as f64 * entry.shard_s(costs),
                unbegun,
            })
        };
        self.entries.iter().filter_map(of).collect()
    }

    /// Nothing should be leased yet: tasks wait here already, or the open ones will last for longer than a load takes. A
    /// worker that leases too early takes what it has just donated.
    pub(in crate::farm) fn has_enough(&self, ahead: usize, costs: Costs) -> bool {
        let waiting = self.entries.values().filter(|e| e.state.waits()).count();
        let lasts_s = |entry: &super::Entry<P>| {
            let unbegun = match entry.state {
                TaskState::Queued | TaskState::Pinned => return 0.0,
                // All of it, as far as is known.
                TaskState::Loading | TaskState::Sandboxed => entry.message.task.shards.len(),
                _ => entry.shards.unbegun().len(),
            };
            unbegun as f64 * entry.shard_s(costs)
        };
        let lasts_s: f64 = self.entries.values().map(lasts_s).sum();
        waiting >= ahead || lasts_s > LOADS_AHEAD * costs.load_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LOAD_S: f64 = 0.2;

    fn candidate(task: u64, shards: Range<u32>, opened: bool) -> Candidate {
        Candidate {
            task: TaskId(task),
            opened,
            unbegun_s: f64::from(shards.end - shards.start),
            unbegun: shards,
        }
    }

    fn chosen(candidates: &[Candidate], slowness: f64, load_s: f64) -> Vec<(u64, Range<u32>)> {
        let chosen = choose(candidates, slowness, load_s).into_iter();
        chosen.map(|(task, shards)| (task.0, shards)).collect()
    }

    #[test]
    fn tasks_that_are_not_open_are_donated_first() {
        let all = [
            candidate(0, 1..16, true),
            candidate(1, 0..1, false),
            candidate(2, 0..4, false),
            candidate(3, 0..2, false),
        ];
        assert_eq!(chosen(&all, 1.0, LOAD_S), [(2, 0..4), (3, 0..2)]);
        assert_eq!(chosen(&all[..2], 1.0, LOAD_S), [(1, 0..1)]);
    }

    #[test]
    fn the_later_half_of_what_is_not_begun_is_donated() {
        let all = [candidate(0, 6..16, true), candidate(1, 5..8, true)];
        assert_eq!(chosen(&all, 1.0, LOAD_S), [(0, 11..16)]);
        assert_eq!(chosen(&[candidate(0, 4..5, true)], 1.0, LOAD_S), [(0, 4..5)]);
    }

    #[test]
    fn what_is_not_worth_a_load_is_kept() {
        assert_eq!(chosen(&[candidate(0, 6..16, true)], 1.0, 5.0), []);
        assert_eq!(chosen(&[candidate(0, 4..4, true)], 1.0, LOAD_S), []);
        assert_eq!(chosen(&[], 1.0, LOAD_S), []);
    }

    #[test]
    fn a_slower_worker_gets_less() {
        let all = [candidate(0, 6..16, true)];
        let count = |slowness| chosen(&all, slowness, LOAD_S).first().map_or(0, |c| c.1.len());
        assert_eq!([count(1.0), count(2.0), count(4.0)], [5, 3, 2]);
        // One shard would take longer there than all ten here.
        assert_eq!(count(12.0), 0);
        assert_eq!(count(0.25), 8);
    }

    proptest! {
        /// What is donated is whole tasks that are not opened, or the end of one.
        #[test]
        fn what_is_donated_is_leased_and_not_begun(
            drawn in prop::collection::vec((0u32..40, 0u32..20, any::<bool>(), 0.0..10.0), 0..6),
            slowness in prop_oneof![Just(1.0), 0.1..10.0],
            load_s in 0.0..10.0,
        ) {
            let of = |(k, &(start, count, opened, unbegun_s)): (usize, &(u32, u32, bool, f64))| {
                Candidate { unbegun_s, ..candidate(k as u64, start..start + count.max(u32::from(!opened)), opened) }
            };
            let all: Vec<Candidate> = drawn.iter().enumerate().map(of).collect();
            let waiting = all.iter().filter(|c| !c.opened).count();
            let donated = chosen(&all, slowness, load_s);
            let (expected, exact) = if waiting > 0 { (waiting.div_ceil(2), true) } else { (1, false) };
            prop_assert!(donated.len() <= expected && (!exact || donated.len() == expected));
            for (task, shards) in donated {
                let from = &all[task as usize];
                prop_assert!(!shards.is_empty() && shards.end == from.unbegun.end);
                prop_assert!(shards.start >= from.unbegun.start);
                prop_assert!(from.opened || shards == from.unbegun);
                prop_assert!(!from.opened || from.unbegun_s > WORTH_LOADS * load_s);
                if from.opened && slowness >= 1.0 {
                    prop_assert!(2 * shards.len() <= from.unbegun.len() + 1);
                }
            }
        }
    }
}
