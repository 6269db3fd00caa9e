//! A held span whose scene is loaded: which of its shards are left, and how it ends.

use super::queue::Delivery;
use crate::run::Span;
use render::job::SceneJob;
use std::collections::BTreeSet;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard};
use std::time::{Duration, Instant};

/// A span that is being worked on.
///
/// It ends in one of three ways, once: *whole*, when all shards of the scene are in memory (the tuple is written from
/// them); *in part*, when its own shards are durable and others hold the rest; or by failing.
pub(super) struct OpenSpan<'a> {
    pub(super) job: SceneJob<'a>,
    pub(super) delivery: Delivery,
    state: Mutex<State>,
    /// Bands traced here, and the microseconds that threads spent on them.
    bands: AtomicU64,
    band_us: AtomicU64,
}

struct State {
    /// Shards of the span that are neither traced nor found nor given away.
    left: BTreeSet<u32>,
    /// Partials that are not in the store yet: those that wait in memory, and those on their way.
    unwritten: u32,
    /// Shards that wait in memory, and since when the first of them does.
    in_memory: Vec<u32>,
    since: Option<Instant>,
    /// It has ended in part.
    ended: bool,
    /// Another process has had a part of the scene.
    shared: bool,
    /// Another process has a part of it now, and may wait for this one's.
    awaited: bool,
    /// Some of its partials are in the store.
    stored: bool,
    /// The scene's tuple is in the store.
    merged: bool,
}

impl<'a> OpenSpan<'a> {
    pub(super) fn new(job: SceneJob<'a>, delivery: Delivery) -> Self {
        let shards = delivery.waiting.span.shards.clone();
        let state = State {
            left: (shards.start..shards.end.min(job.layout.len())).collect(),
            unwritten: 0,
            in_memory: Vec::new(),
            since: None,
            ended: false,
            stored: false,
            merged: false,
            shared: shards != (0..job.layout.len()),
            awaited: shards != (0..job.layout.len()),
        };
        Self {
            job,
            delivery,
            state: Mutex::new(state),
            bands: AtomicU64::new(0),
            band_us: AtomicU64::new(0),
        }
    }

    /// A thread traced a band of a shard in this time.
    pub(super) fn spent(&self, time: Duration) {
        self.band_us
            .fetch_add(time.as_micros() as u64, Ordering::Relaxed);
        self.bands.fetch_add(1, Ordering::Relaxed);
    }

    /// A thread's seconds for a shard of this scene, once a band of it was traced. Scenes differ by more than ten times:
    /// what others cost says little of what is left of this one.
    pub(super) fn shard_s(&self) -> Option<f64> {
        let bands = self.bands.load(Ordering::Relaxed);
        let band_s = self.band_us.load(Ordering::Relaxed) as f64 * 1e-6 / bands as f64;
        (bands > 0).then(|| band_s * f64::from(self.job.bands(0)))
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().expect("no holder of this lock panics")
    }

    /// Shards to trace.
    pub(super) fn left(&self) -> BTreeSet<u32> {
        self.state().left.clone()
    }

    /// A shard was found in the store.
    pub(super) fn found(&self, shard: u32) {
        let mut state = self.state();
        state.left.remove(&shard);
        state.shared = true;
        self.job.count_traced();
    }

    /// All of the scene was traced here.
    pub(super) fn is_alone(&self) -> bool {
        let state = self.state();
        !state.shared && !state.ended
    }

    /// A shard is traced, and its result is with the job. Shards whose partials are to be written now: none while all of
    /// the scene is here and `at_most` has not passed since the first that waits, for with luck the tuple comes first.
    pub(super) fn traced(&self, shard: u32, at_most: Duration) -> Vec<u32> {
        let mut state = self.state();
        state.left.remove(&shard);
        if self.job.count_traced() {
            state.in_memory.clear();
            return Vec::new();
        }
        state.unwritten += 1;
        state.in_memory.push(shard);
        let since = *state.since.get_or_insert_with(Instant::now);
        if state.awaited || since.elapsed() >= at_most {
            take_waiting(&mut state)
        } else {
            Vec::new()
        }
    }

    /// Shards that wait in memory, to be written now.
    pub(super) fn unwritten(&self) -> Vec<u32> {
        take_waiting(&mut self.state())
    }

    /// The tuple is in the store: partials are of no more use.
    pub(super) fn merged(&self) {
        self.state().merged = true;
    }

    /// A partial need not be written any more.
    pub(super) fn is_merged(&self) -> bool {
        self.state().merged
    }

    /// A partial is durable. True if the span has ended in part by this.
    pub(super) fn stored(&self) -> bool {
        let mut state = self.state();
        state.unwritten -= 1;
        state.stored = true;
        self.ends_in_part(&mut state)
    }

    /// Something of it is in the store by this worker.
    pub(super) fn has_stored(&self) -> bool {
        self.state().stored
    }

    /// True if nothing is left to do in a span of which something was found. For once all that was found is counted.
    pub(super) fn settle(&self) -> bool {
        self.ends_in_part(&mut self.state())
    }

    /// Shards at the span's end that nobody has begun.
    pub(super) fn unbegun(&self) -> Range<u32> {
        let state = self.state();
        let end = state.left.last().map_or(0, |last| last + 1);
        let mut start = end;
        while start > 0 && state.left.contains(&(start - 1)) && self.job.is_waiting(start - 1) {
            start -= 1;
        }
        start..end
    }

    /// Leaves shards to another worker, which has them already; those that were begun meanwhile are finished here, too.
    /// True if the span has ended in part by this. What waits in memory is to be written then.
    pub(super) fn give(&self, shards: Range<u32>) -> bool {
        let mut state = self.state();
        (state.shared, state.awaited) = (true, true);
        for shard in shards {
            if state.left.contains(&shard) && !self.job.may_trace(shard, true) {
                state.left.remove(&shard);
            }
        }
        self.ends_in_part(&mut state)
    }

    fn ends_in_part(&self, state: &mut State) -> bool {
        let ends = !state.ended
            && state.left.is_empty()
            && state.unwritten == 0
            && !self.job.is_whole()
            && !self.job.has_failed();
        state.ended |= ends;
        ends
    }

    /// What nobody has done of it: shards in a row. For who stops.
    pub(super) fn rest(&self) -> Vec<Span> {
        let mut spans: Vec<Span> = Vec::new();
        for shard in self.left() {
            match spans.last_mut() {
                Some(span) if span.shards.end == shard => span.shards.end += 1,
                _ => spans.push(Span {
                    scene: self.delivery.waiting.span.scene,
                    shards: shard..shard + 1,
                }),
            }
        }
        spans
    }
}

fn take_waiting(state: &mut State) -> Vec<u32> {
    state.since = None;
    std::mem::take(&mut state.in_memory)
}
