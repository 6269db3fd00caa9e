//! The spans that one worker holds: a state machine without clock, queue or store.
//!
//! A worker takes a message, opens its scene, begins and finishes shards, and gives spans away in two steps: it
//! [`offer`](Holding::offer)s, publishes what it offered, and when the queue has confirmed all of it calls
//! [`given`](Holding::given), which shrinks; or [`kept`](Holding::kept), which does not. A message comes out of
//! [`acknowledge`](Holding::acknowledge) once every shard of the range that it was taken with is finished or given.
//! The rules are those of a worker's own `held.rs` and `open_span.rs`, without threads and files.

pub(super) use crate::farm::queue::Waiting as Handed;
use crate::farm::{HeldSpan, what_to_give};
use crate::run::Span;
use std::ops::Range;

/// One message and what is left of its span.
#[derive(Clone, Debug)]
struct Held<M> {
    /// Names it inside this worker.
    id: u64,
    message: M,
    handed_on: u32,
    /// As it is now: without what was given.
    span: Span,
    opened: bool,
    /// The first shard that is not begun.
    next: u32,
    /// Begun, not finished.
    in_flight: u32,
}

impl<M> Held<M> {
    fn unbegun(&self) -> Range<u32> {
        self.next..self.span.shards.end
    }

    fn is_settled(&self) -> bool {
        self.unbegun().is_empty() && self.in_flight == 0
    }
}

/// What a worker holds; `M` is what it acknowledges a message with.
#[derive(Clone, Debug)]
pub(super) struct Holding<M> {
    held: Vec<Held<M>>,
    /// What was offered, with the id of the span that it is a part of.
    offered: Vec<(u64, u32)>,
    ids: u64,
}

impl<M> Default for Holding<M> {
    fn default() -> Self {
        Self {
            held: Vec::new(),
            offered: Vec::new(),
            ids: 0,
        }
    }
}

impl<M> Holding<M> {
    /// A message was delivered. Returns the span's id.
    pub(super) fn take(&mut self, message: M, handed: Handed) -> u64 {
        self.ids += 1;
        self.held.push(Held {
            id: self.ids,
            message,
            handed_on: handed.handed_on,
            next: handed.span.shards.start,
            span: handed.span,
            opened: false,
            in_flight: 0,
        });
        self.ids
    }

    /// Number of spans.
    pub(super) fn len(&self) -> usize {
        self.held.len()
    }

    /// It holds nothing.
    pub(super) fn is_empty(&self) -> bool {
        self.held.is_empty()
    }

    /// Ids, in the order in which they were taken.
    pub(super) fn ids(&self) -> impl Iterator<Item = u64> {
        self.held.iter().map(|h| h.id)
    }

    /// What renews the leases.
    pub(super) fn messages(&self) -> impl Iterator<Item = &M> {
        self.held.iter().map(|h| &h.message)
    }

    /// The span as it is now: without what was given.
    pub(super) fn span(&self, id: u64) -> Option<&Span> {
        self.find(id).map(|h| &h.span)
    }

    /// Its shards that nobody has begun.
    pub(super) fn unbegun(&self, id: u64) -> Option<Range<u32>> {
        self.find(id).map(Held::unbegun)
    }

    /// Number of spans that are offered.
    pub(super) fn offered_count(&self) -> u32 {
        self.offered.len() as u32
    }

    /// Its scene is loaded, or being loaded.
    pub(super) fn is_opened(&self, id: u64) -> bool {
        self.find(id).is_some_and(|h| h.opened)
    }

    /// Its scene is being loaded from now on: no longer given whole.
    pub(super) fn open(&mut self, id: u64) {
        if let Some(held) = self.find_mut(id) {
            held.opened = true;
        }
    }

    /// Begins the next shard of an opened span; none if there is none.
    pub(super) fn begin(&mut self, id: u64) -> Option<u32> {
        let held = self.find_mut(id).filter(|h| h.opened)?;
        let shard = held.unbegun().next()?;
        held.next += 1;
        held.in_flight += 1;
        Some(shard)
    }

    /// One of the shards begun is in the store. Without effect on a span that is not held any more.
    pub(super) fn finish(&mut self, id: u64) {
        if let Some(held) = self.find_mut(id) {
            held.in_flight -= 1;
        }
    }

    /// What [`what_to_give`] says; to be published. Nothing while another offer is out.
    ///
    /// `seconds` gives for a span and its shards that nobody has begun: seconds until those are done, and seconds that
    /// another worker needs to load the scene. That worker takes `slowness` times as long for the same.
    pub(super) fn offer(
        &mut self,
        slowness: f64,
        seconds: impl Fn(&Span, Range<u32>) -> (f64, f64),
    ) -> Vec<Handed> {
        if !self.offered.is_empty() {
            return Vec::new();
        }
        let view = self.view(seconds);
        let mut all = Vec::new();
        for span in what_to_give(&view, slowness) {
            // Of two equal spans (its own, delivered again) any one.
            let is_from = |h: &&Held<M>| {
                h.span.scene == span.scene
                    && h.span.shards.end == span.shards.end
                    && h.next <= span.shards.start
                    && self.offered.iter().all(|&(id, _)| id != h.id)
            };
            if let Some(from) = self.held.iter().find(is_from) {
                self.offered.push((from.id, span.shards.start));
                all.push(Handed {
                    span,
                    handed_on: from.handed_on + 1,
                });
            }
        }
        all
    }

    /// Whether it has something to give.
    pub(super) fn could_give(&self, seconds: impl Fn(&Span, Range<u32>) -> (f64, f64)) -> bool {
        self.offered.is_empty() && !what_to_give(&self.view(seconds), 1.0).is_empty()
    }

    /// The queue has all that was offered: those shards are left alone, except the ones begun in the meantime.
    pub(super) fn given(&mut self) {
        for (id, start) in std::mem::take(&mut self.offered) {
            if let Some(held) = self.find_mut(id) {
                held.span.shards.end = start.max(held.next);
            }
        }
    }

    /// The queue did not confirm all that was offered: everything is kept. What the queue has got nevertheless is traced
    /// twice.
    pub(super) fn kept(&mut self) {
        self.offered.clear();
    }

    /// A span of which nothing is left, to be acknowledged: its shards are in the store or given away. With the span as it
    /// is now, empty if it was given whole.
    pub(super) fn acknowledge(&mut self) -> Option<(M, Span)> {
        let k = self.held.iter().position(Held::is_settled)?;
        let held = self.held.remove(k);
        Some((held.message, held.span))
    }

    #[cfg(test)]
    /// Everything that is not begun, to be published before the worker ends; then [`given`](Self::given).
    pub(super) fn hand_back(&mut self) -> Vec<Handed> {
        self.offered.clear();
        let mut all = Vec::new();
        for held in self.held.iter().filter(|h| !h.unbegun().is_empty()) {
            self.offered.push((held.id, held.next));
            all.push(Handed {
                span: Span {
                    scene: held.span.scene,
                    shards: held.unbegun(),
                },
                handed_on: held.handed_on + 1,
            });
        }
        all
    }

    fn view(&self, seconds: impl Fn(&Span, Range<u32>) -> (f64, f64)) -> Vec<HeldSpan> {
        let of = |h: &Held<M>| {
            let (unbegun_s, load_s) = seconds(&h.span, h.unbegun());
            HeldSpan {
                span: h.span.clone(),
                opened: h.opened,
                unbegun: h.unbegun(),
                unbegun_s,
                load_s,
            }
        };
        self.held.iter().map(of).collect()
    }

    fn find(&self, id: u64) -> Option<&Held<M>> {
        self.held.iter().find(|h| h.id == id)
    }

    fn find_mut(&mut self, id: u64) -> Option<&mut Held<M>> {
        self.held.iter_mut().find(|h| h.id == id)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn handed(scene: u32, shards: Range<u32>) -> Handed {
        Handed {
            span: Span { scene, shards },
            handed_on: 0,
        }
    }

    fn a_second_a_shard(_: &Span, unbegun: Range<u32>) -> (f64, f64) {
        (f64::from(unbegun.end - unbegun.start), 0.1)
    }

    #[test]
    fn a_span_is_acknowledged_when_its_rest_is_given_and_the_begun_is_finished() {
        let mut holding = Holding::default();
        let id = holding.take("first", handed(7, 0..4));
        assert_eq!(holding.begin(id), None);
        holding.open(id);
        assert_eq!(holding.begin(id), Some(0));
        let offered = holding.offer(1.0, a_second_a_shard);
        assert_eq!(offered[0].span.shards, 2..4);
        assert_eq!(offered[0].handed_on, 1);
        // While the queue has not confirmed, work goes on, into what is offered.
        assert_eq!(holding.begin(id), Some(1));
        assert_eq!(holding.begin(id), Some(2));
        assert_eq!(holding.offer(1.0, a_second_a_shard), []);
        holding.given();
        assert_eq!(holding.span(id).unwrap().shards, 0..3);
        assert_eq!(holding.begin(id), None);
        holding.finish(id);
        holding.finish(id);
        assert!(holding.acknowledge().is_none());
        holding.finish(id);
        assert_eq!(holding.acknowledge().unwrap().0, "first");
        assert!(holding.is_empty());
    }

    #[test]
    fn what_the_queue_did_not_confirm_is_kept() {
        let mut holding = Holding::default();
        let first = holding.take(1, handed(0, 0..4));
        holding.open(first);
        holding.begin(first);
        holding.take(2, handed(1, 0..4));
        assert_eq!(holding.offer(1.0, a_second_a_shard)[0].span.scene, 1);
        holding.kept();
        assert_eq!(holding.offer(1.0, a_second_a_shard)[0].span.scene, 1);
        holding.given();
        assert_eq!(holding.acknowledge().unwrap().0, 2);
        assert_eq!(holding.span(first).unwrap().shards, 0..4);
    }

    #[test]
    fn who_ends_hands_back_all_that_is_not_begun() {
        let mut holding = Holding::default();
        let first = holding.take(1, handed(0, 0..4));
        holding.open(first);
        holding.begin(first);
        holding.take(2, handed(1, 5..6));
        let back: Vec<Range<u32>> = holding
            .hand_back()
            .into_iter()
            .map(|h| h.span.shards)
            .collect();
        assert_eq!(back, [1..4, 5..6]);
        holding.given();
        assert_eq!(holding.acknowledge().unwrap().0, 2);
        assert!(holding.acknowledge().is_none());
        holding.finish(first);
        assert_eq!(holding.acknowledge().unwrap().0, 1);
    }
}
