//! The states of a scene's shards, from the view of one of its tasks.

use std::ops::Range;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shard {
    /// In another worker's task.
    Elsewhere,
    Waiting,
    /// Waiting when the worker stopped, so no thread starts it.
    Dropped,
    Tracing,
    /// Traced, and only in memory.
    InMemory,
    /// On its way into the store.
    Writing,
    /// This worker has put it into the store.
    Stored,
    /// In the store before the scene was loaded.
    Found,
}

/// All shards of a scene; empty before the scene is loaded.
#[derive(Clone, Debug, Default)]
pub(super) struct Shards(Vec<Shard>);

impl Shards {
    /// Returns the shards of a scene: `own` belong to the task, and the store has `found`.
    pub(super) fn new(count: u32, own: &Range<u32>, found: &[u32]) -> Self {
        let of = |shard: u32| {
            if found.contains(&shard) {
                Shard::Found
            } else if own.contains(&shard) {
                Shard::Waiting
            } else {
                Shard::Elsewhere
            }
        };
        Self((0..count).map(of).collect())
    }

    fn with(&self, is: impl Fn(Shard) -> bool) -> impl Iterator<Item = u32> {
        let all = (0..).zip(&self.0);
        all.filter(move |(_, shard)| is(**shard)).map(|(k, _)| k)
    }

    fn change(&mut self, shard: u32, from: &[Shard], to: Shard) -> bool {
        match self.0.get_mut(shard as usize) {
            Some(shard) if from.contains(shard) => {
                *shard = to;
                true
            }
            _ => false,
        }
    }

    /// True if the caller must trace a band of the shard. A stopping worker finishes started shards but starts none.
    pub(super) fn begin(&mut self, shard: u32, stopping: bool) -> bool {
        let to = if stopping { Shard::Dropped } else { Shard::Tracing };
        self.change(shard, &[Shard::Waiting], to);
        self.0.get(shard as usize) == Some(&Shard::Tracing)
    }

    /// Marks a shard as traced. Returns false if no thread was tracing it.
    pub(super) fn traced(&mut self, shard: u32) -> bool {
        self.change(shard, &[Shard::Tracing], Shard::InMemory)
    }

    /// Returns the shards that are only in memory, and marks them as being written.
    pub(super) fn write(&mut self) -> Vec<u32> {
        let shards: Vec<u32> = self.with(|s| s == Shard::InMemory).collect();
        for &shard in &shards {
            self.change(shard, &[Shard::InMemory], Shard::Writing);
        }
        shards
    }

    pub(super) fn stored(&mut self, shard: u32) {
        self.change(shard, &[Shard::Writing], Shard::Stored);
    }

    /// Gives up shards that no thread has started. This worker finishes the others.
    pub(super) fn leave(&mut self, shards: Range<u32>) {
        for shard in shards {
            self.change(shard, &[Shard::Waiting, Shard::Dropped], Shard::Elsewhere);
        }
    }

    pub(super) fn waiting(&self) -> Vec<u32> {
        self.with(|s| s == Shard::Waiting).collect()
    }

    /// Returns the consecutive waiting shards at the end of the unfinished ones.
    pub(super) fn unbegun(&self) -> Range<u32> {
        let left = |s| matches!(s, Shard::Waiting | Shard::Dropped | Shard::Tracing);
        let end = self.with(left).last().map_or(0, |last| last + 1);
        let waits = |&k: &u32| self.0[k as usize] == Shard::Waiting;
        let count = (0..end).rev().take_while(waits).count() as u32;
        end - count..end
    }

    /// True if every shard of the scene is in this worker's memory.
    pub(super) fn are_all_here(&self) -> bool {
        let here = |s: &Shard| {
            matches!(s, Shard::InMemory | Shard::Writing | Shard::Stored | Shard::Found)
        };
        !self.0.is_empty() && self.0.iter().all(here)
    }

    /// Returns the task's shards that are not in the store.
    pub(super) fn undone(&self) -> impl Iterator<Item = u32> {
        self.with(|s| !matches!(s, Shard::Elsewhere | Shard::Stored | Shard::Found))
    }
}

pub(super) fn rows(shards: impl Iterator<Item = u32>) -> Vec<Range<u32>> {
    let mut rows: Vec<Range<u32>> = Vec::new();
    for shard in shards {
        match rows.last_mut() {
            Some(row) if row.end == shard => row.end += 1,
            _ => rows.push(shard..shard + 1),
        }
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_threads_start_or_drop_the_same_shards() {
        let mut shards = Shards::new(3, &(0..3), &[]);
        assert!(shards.begin(0, false) && shards.begin(0, true) && shards.begin(0, false));
        assert!(!shards.begin(1, true) && !shards.begin(1, false));
        assert!(!shards.begin(7, false));
        assert_eq!(shards.undone().collect::<Vec<_>>(), [0, 1, 2]);
        assert_eq!(shards.waiting(), [2]);
    }

    #[test]
    fn found_and_begun_shards_are_not_donated() {
        let mut shards = Shards::new(8, &(2..8), &[0, 5]);
        assert!(shards.begin(6, false));
        assert_eq!(shards.unbegun(), 7..8);
        shards.leave(2..8);
        assert_eq!(shards.undone().collect::<Vec<_>>(), [6]);
        assert!(shards.traced(6) && !shards.traced(6) && !shards.traced(7));
        assert_eq!(shards.write(), [6]);
        assert_eq!(shards.write(), [0; 0]);
        assert_eq!(shards.undone().count(), 1);
        shards.stored(6);
        assert_eq!(shards.undone().count(), 0);
        assert!(!shards.are_all_here());
    }

    #[test]
    fn consecutive_shards_form_rows() {
        assert_eq!(rows([1, 2, 5, 7, 8].into_iter()), [1..3, 5..6, 7..9]);
        assert_eq!(rows([].into_iter()), []);
    }
}
