//! Chooses the tasks to donate, and the time to lease more.
//!
//! A donor publishes shards, waits for the queue's confirmation, and only then gives them up, so that no shard is lost.
//! Two workers may trace the same shard, which only costs time.

use super::super::costs::Costs;
use super::{Entry, TaskId, TaskState, Tasks};
use std::ops::Range;

/// A task as a candidate for donation.
#[derive(Clone)]
struct Candidate {
    task: TaskId,
    /// True if the task's scene is loaded.
    opened: bool,
    /// Shards at the end of the task that no thread has started.
    unbegun: Range<u32>,
    /// Estimated time for `unbegun`, s.
    unbegun_s: f64,
}

/// Least remaining time of an opened task for a donation of its end, in loads of its scene.
const WORTH_LOADS: f64 = 2.0;

/// Remaining time of the open tasks at which the worker leases the next one, in loads.
const LOADS_AHEAD: f64 = 2.0;

/// Chooses the shards to publish for an idle worker that takes `slowness` times as long and loads a scene in `load_s`:
/// the later half of the unopened tasks, or otherwise the end of the opened task with the longest remaining time, such
/// that both workers finish at about the same time. Returns nothing if a second load of the scene costs too much.
fn choose(candidates: &[Candidate], slowness: f64, load_s: f64) -> Vec<(TaskId, Range<u32>)> {
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

/// Returns the later half, rounded up and scaled to the slowness, or `None` if this worker alone would finish earlier.
fn later_share(from: &Candidate, slowness: f64, load_s: f64) -> Option<Range<u32>> {
    let (shards, count) = (&from.unbegun, from.unbegun.len() as f64);
    let donated = (count / (1.0 + slowness) + 0.5).floor().min(count);
    let shard_s = from.unbegun_s / count;
    // The donor traces another shard meanwhile.
    let worth = slowness <= 1.0 || load_s + donated * shard_s * slowness < from.unbegun_s + shard_s;
    (worth && donated > 0.0).then(|| shards.end - donated as u32..shards.end)
}

impl<P> Tasks<P> {
    /// Returns the tasks to publish for an idle worker that loads a scene in `load_s`.
    pub(super) fn choose(&self, costs: Costs, load_s: Option<f64>) -> Vec<(TaskId, Range<u32>)> {
        let load_or_own_s = load_s.unwrap_or(costs.load_s);
        choose(&self.candidates(costs), costs.slowness(load_s), load_or_own_s)
    }

    /// Returns all queued tasks, and the tasks being traced that have unstarted shards at their ends.
    fn candidates(&self, costs: Costs) -> Vec<Candidate> {
        let of = |(&task, entry): (&TaskId, &Entry<P>)| {
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

    /// True if the worker should lease no more for now: enough tasks wait, or the open ones last long enough. A worker
    /// that leases too early may take back its own donation.
    pub(crate) fn has_enough(&self, ahead: usize, costs: Costs) -> bool {
        let waiting = self.entries.values().filter(|e| e.state.waits()).count();
        let lasts_s = |entry: &Entry<P>| {
            let unbegun = match entry.state {
                TaskState::Queued | TaskState::Pinned => return 0.0,
                // Until the scene is loaded, all shards count as missing.
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
    fn the_later_half_of_the_unopened_tasks_or_of_the_unbegun_shards_is_donated() {
        let open = candidate(0, 6..16, true);
        let queued =
            [(1, 0..1), (2, 0..4), (3, 0..2)].map(|(k, shards)| candidate(k, shards, false));
        let all = [std::slice::from_ref(&open), &queued[..]].concat();
        assert_eq!(chosen(&all, 1.0, LOAD_S), [(2, 0..4), (3, 0..2)]);
        assert_eq!(chosen(&all[..2], 1.0, LOAD_S), [(1, 0..1)]);
        let two = [open.clone(), candidate(1, 5..8, true)];
        assert_eq!(chosen(&two, 1.0, LOAD_S), [(0, 11..16)]);
        assert_eq!(chosen(&[candidate(0, 4..5, true)], 1.0, LOAD_S), [(0, 4..5)]);
        // The remaining shards are not worth a load, or none remain.
        assert_eq!(chosen(&[open], 1.0, 5.0), []);
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
        #[test]
        fn donations_are_whole_unopened_tasks_or_the_unbegun_end_of_an_opened_one(
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
