//! The spans that a worker holds: their leases, and what it gives away.

use super::open_span::OpenSpan;
use super::queue::{Delivery, Queue, QueueError, Waiting};
use super::span::{HeldSpan, what_to_give};
use crate::run::Span;
use crate::run::attempts::{AttemptRecord, WorkerName};
use crate::run::made_by::MadeBy;
use crate::store::Store;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::{Duration, Instant};

/// Spans by ticket.
#[derive(Default)]
pub(super) struct HeldSpans<'a> {
    spans: Mutex<BTreeMap<u64, Held<'a>>>,
}

struct Held<'a> {
    delivery: Delivery,
    attempt: Option<AttemptRecord>,
    open: Option<Arc<OpenSpan<'a>>>,
    /// Its scene is being loaded.
    opening: bool,
    /// It is not to be given away.
    kept: bool,
    progress: Instant,
}

/// What this worker's work costs, for guessing what is left.
#[derive(Clone, Copy, Debug)]
pub(super) struct Costs {
    /// A thread's seconds for a shard, of all scenes so far.
    pub(super) shard_s: f64,
    /// Threads that share a span's shards.
    pub(super) threads: f64,
    /// Seconds to load a scene.
    pub(super) load_s: f64,
    /// It was measured, not guessed.
    pub(super) load_is_known: bool,
}

impl Costs {
    /// Unless it is guessed.
    pub(super) fn known_load_s(self) -> Option<f64> {
        self.load_is_known.then_some(self.load_s)
    }

    /// How much longer a worker needs for the same that loads a scene in `load_s`; 1 if it is not known, or hardly
    /// different: loads differ, too.
    pub(super) fn slowness(self, load_s: Option<f64>) -> f64 {
        let times = match load_s {
            Some(load_s) if self.load_is_known => load_s / self.load_s.max(1e-6),
            _ => 1.0,
        };
        if (1.0 / ALIKE..ALIKE).contains(&times) {
            1.0
        } else {
            times.clamp(1.0 / MOST_TIMES, MOST_TIMES)
        }
    }
}

/// Workers whose loads differ by less are equally fast.
const ALIKE: f64 = 2.0;
/// No worker is believed to be more often as fast as another one.
const MOST_TIMES: f64 = 8.0;

/// The next span is taken when the open ones last for so many loads at most.
const LOADS_AHEAD: f64 = 2.0;

/// Without what is kept, and what is being loaded.
fn givable(views: &[(u64, HeldSpan)]) -> impl Iterator<Item = &(u64, HeldSpan)> {
    views.iter().filter(|(_, view)| !view.unbegun.is_empty())
}

/// Spans that were given away, as parts of open ones.
pub(super) struct Given<'a> {
    /// Spans that were published.
    pub(super) count: u32,
    /// Ended in part by it.
    pub(super) ended: Vec<Arc<OpenSpan<'a>>>,
    /// Others are to have the rest of these.
    pub(super) shared: Vec<Arc<OpenSpan<'a>>>,
    /// Records of attempts that were never begun: of spans that were given away whole.
    pub(super) unbegun: Vec<AttemptRecord>,
}

/// What is over by giving something away.
enum Left<'a> {
    Nothing,
    /// An open span that goes on.
    Shared(Arc<OpenSpan<'a>>),
    /// An open span, in part.
    Ended(Arc<OpenSpan<'a>>),
    /// A span that was never begun.
    Whole(Option<AttemptRecord>),
}

impl<'a> HeldSpans<'a> {
    fn spans(&self) -> MutexGuard<'_, BTreeMap<u64, Held<'a>>> {
        self.spans.lock().expect("no holder of this lock panics")
    }

    /// Nothing is held.
    pub(super) fn is_empty(&self) -> bool {
        self.spans().is_empty()
    }

    /// A span was taken.
    pub(super) fn add(&self, delivery: &Delivery) {
        let held = Held {
            delivery: delivery.clone(),
            attempt: None,
            open: None,
            opening: false,
            kept: false,
            progress: Instant::now(),
        };
        self.spans().insert(delivery.ticket, held);
    }

    /// Somebody wants to load its scene. False: it was given away.
    pub(super) fn may_open(&self, ticket: u64) -> bool {
        match self.spans().get_mut(&ticket) {
            Some(held) => {
                held.opening = true;
                held.progress = Instant::now();
                true
            }
            None => false,
        }
    }

    /// Its scene is loaded.
    pub(super) fn open(&self, span: &Arc<OpenSpan<'a>>) {
        if let Some(held) = self.spans().get_mut(&span.delivery.ticket) {
            held.open = Some(Arc::clone(span));
            held.progress = Instant::now();
        }
    }

    /// Spans whose scenes are loaded.
    pub(super) fn opened(&self) -> Vec<Arc<OpenSpan<'a>>> {
        let spans = self.spans();
        spans
            .values()
            .filter_map(|held| held.open.clone())
            .collect()
    }

    /// Something of it was done.
    pub(super) fn touch(&self, ticket: u64) {
        if let Some(held) = self.spans().get_mut(&ticket) {
            held.progress = Instant::now();
        }
    }

    /// From now on it is not given away. False: it was.
    pub(super) fn keep(&self, ticket: u64) -> bool {
        let mut spans = self.spans();
        let held = spans.get_mut(&ticket);
        held.map(|held| held.kept = true).is_some()
    }

    /// The attempt at it is recorded. False: it was given away.
    pub(super) fn note(&self, ticket: u64, attempt: AttemptRecord) -> bool {
        let mut spans = self.spans();
        let held = spans.get_mut(&ticket);
        held.map(|held| held.attempt = Some(attempt)).is_some()
    }

    /// The record of the attempt at it.
    pub(super) fn attempt(&self, ticket: u64) -> Option<AttemptRecord> {
        self.spans().get(&ticket)?.attempt.clone()
    }

    /// It is no longer this worker's. The record of the attempt, if there is one.
    pub(super) fn remove(&self, ticket: u64) -> Option<AttemptRecord> {
        self.spans().remove(&ticket)?.attempt
    }

    /// Renews all leases; or says which open span has made no progress for `hang`.
    pub(super) fn renew(&self, queue: &dyn Queue, hang: Duration) -> Result<(), Delivery> {
        let tickets: Vec<u64> = {
            let spans = self.spans();
            let mut active = spans.values().filter(|h| h.opening);
            if let Some(hung) = active.find(|h| h.progress.elapsed() > hang) {
                return Err(hung.delivery.clone());
            }
            spans.keys().copied().collect()
        };
        for ticket in tickets {
            queue.renew(ticket);
        }
        Ok(())
    }

    fn views(&self, costs: Costs) -> Vec<(u64, HeldSpan)> {
        let spans = self.spans();
        let view = |(ticket, held): (&u64, &Held<'a>)| {
            let span = held.delivery.waiting.span.clone();
            let unbegun = match &held.open {
                Some(open) => open.unbegun(),
                None => span.shards.clone(),
            };
            let of_scene = held.open.as_ref().and_then(|open| open.shard_s());
            let shard_s = of_scene.unwrap_or(costs.shard_s) / costs.threads;
            let view = HeldSpan {
                opened: held.opening,
                unbegun_s: f64::from(unbegun.end - unbegun.start) * shard_s,
                // What is being loaded is nobody's yet.
                unbegun: if (held.opening || held.kept) && held.open.is_none() {
                    0..0
                } else {
                    unbegun
                },
                span,
                load_s: costs.load_s,
            };
            (*ticket, view)
        };
        spans.iter().map(view).collect()
    }

    /// Nothing should be taken yet: spans wait here already, or the open ones will last for longer than a load takes. Who
    /// takes too early takes what it has just given away.
    pub(super) fn has_enough(&self, ahead: usize, costs: Costs) -> bool {
        let views = self.views(costs);
        let waiting = views.iter().filter(|(_, v)| !v.opened).count();
        let lasts_s: f64 = views
            .iter()
            .filter(|(_, v)| v.opened)
            .map(|(_, v)| v.unbegun_s)
            .sum();
        waiting >= ahead || lasts_s > LOADS_AHEAD * costs.load_s
    }

    /// There is something that another worker could have.
    pub(super) fn has_something_to_give(&self, costs: Costs) -> bool {
        let views = self.views(costs);
        let held: Vec<HeldSpan> = givable(&views).map(|(_, v)| v.clone()).collect();
        !what_to_give(&held, 1.0).is_empty()
    }

    /// Gives away what another worker should have, which loads a scene in `load_s`: published first, left alone then.
    pub(super) fn give(&self, queue: &dyn Queue, costs: Costs, load_s: Option<f64>) -> Given<'a> {
        let views = self.views(costs);
        let view = |(_, view): &(u64, HeldSpan)| HeldSpan {
            load_s: load_s.unwrap_or(view.load_s),
            ..view.clone()
        };
        let held: Vec<HeldSpan> = givable(&views).map(view).collect();
        let gifts = what_to_give(&held, costs.slowness(load_s));
        let mut given = Given {
            count: 0,
            ended: Vec::new(),
            shared: Vec::new(),
            unbegun: Vec::new(),
        };
        for gift in gifts {
            // By what nobody has begun: a part of a scene that is open here may wait here, too, having come back.
            let from = views.iter().find(|(_, v)| {
                v.span.scene == gift.scene
                    && v.unbegun.start <= gift.shards.start
                    && gift.shards.end <= v.unbegun.end
            });
            let Some((ticket, _)) = from else { continue };
            let Some(handed_on) = self.handed_on(*ticket) else {
                continue;
            };
            let waiting = Waiting {
                span: gift.clone(),
                handed_on: handed_on + 1,
            };
            // A queue that cannot be told: the rest stays here, and what was given before stays given.
            if queue.publish(&[waiting]).is_err() {
                break;
            }
            given.count += 1;
            match self.leave(queue, *ticket, &gift) {
                Left::Nothing => {}
                Left::Shared(span) => given.shared.push(span),
                Left::Ended(span) => given.ended.push(span),
                Left::Whole(attempt) => given.unbegun.extend(attempt),
            }
        }
        given
    }

    fn handed_on(&self, ticket: u64) -> Option<u32> {
        self.spans()
            .get(&ticket)
            .map(|h| h.delivery.waiting.handed_on)
    }

    /// The queue has `gift` for somebody else.
    fn leave(&self, queue: &dyn Queue, ticket: u64, gift: &Span) -> Left<'a> {
        let open = {
            let mut spans = self.spans();
            match spans.get(&ticket) {
                // Being loaded since: both do it.
                None => return Left::Nothing,
                Some(held) if (held.opening || held.kept) && held.open.is_none() => {
                    return Left::Nothing;
                }
                Some(Held {
                    open: Some(open), ..
                }) => Arc::clone(open),
                Some(_) => {
                    let held = spans.remove(&ticket);
                    drop(spans);
                    queue.finish(ticket);
                    return Left::Whole(held.and_then(|held| held.attempt));
                }
            }
        };
        if open.give(gift.shards.clone()) {
            Left::Ended(open)
        } else {
            Left::Shared(open)
        }
    }

    /// Leaves all of it to nobody, in order: of a run that is cancelled.
    pub(super) fn forget(&self, store: &Store) {
        for held in std::mem::take(&mut *self.spans()).into_values() {
            if let Some(attempt) = held.attempt {
                attempt.forget(store);
            }
        }
    }

    /// Publishes what was never begun, and gives it up. For who hangs with something else.
    pub(super) fn leave_unbegun(&self, queue: &dyn Queue, store: &Store) {
        let unbegun: Vec<(u64, Held)> = self.spans().extract_if(.., |_, h| !h.opening).collect();
        for (ticket, held) in unbegun {
            let again = Waiting {
                span: held.delivery.waiting.span,
                handed_on: held.delivery.waiting.handed_on + 1,
            };
            // If the queue cannot be told, the lease ends.
            if queue.publish(&[again]).is_ok() {
                queue.finish(ticket);
                if let Some(attempt) = held.attempt {
                    attempt.forget(store);
                }
            }
        }
    }

    /// Publishes all that is not done, and gives up the rest. For who stops; nothing is lost if it fails.
    pub(super) fn hand_back(
        &self,
        queue: &dyn Queue,
        store: &Store,
        who: &WorkerName,
    ) -> Result<u32, QueueError> {
        let held = std::mem::take(&mut *self.spans());
        for held in held.values() {
            if let Some(attempt) = &held.attempt {
                attempt.forget(store);
            }
            if let Some(open) = held.open.as_ref().filter(|open| open.has_stored()) {
                let span = &held.delivery.waiting.span;
                MadeBy::leave(store, &open.job.line.id, span, who);
            }
        }
        let mut count = 0;
        for (ticket, held) in held {
            let handed_on = held.delivery.waiting.handed_on + 1;
            let rest = match &held.open {
                Some(open) => open.rest(),
                None => vec![held.delivery.waiting.span],
            };
            let waiting: Vec<Waiting> = rest
                .into_iter()
                .map(|span| Waiting { span, handed_on })
                .collect();
            count += waiting.len() as u32;
            queue.publish(&waiting)?;
            queue.finish(ticket);
        }
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::farm::queue::{LocalQueue, Taken};

    #[test]
    fn who_hangs_leaves_what_it_has_not_begun() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::local(folder.path()).unwrap();
        let local = LocalQueue::new(Some(Duration::from_mins(1)));
        let (worker, heir) = (local.worker(), local.worker());
        let (held, mut tickets) = (HeldSpans::default(), Vec::new());
        for scene in 0..2 {
            let span = Span {
                scene,
                shards: 0..4,
            };
            worker.publish(&[Waiting { span, handed_on: 0 }]).unwrap();
            let Taken::Span(delivery) = worker.take(Duration::ZERO) else {
                panic!("it was published");
            };
            held.add(&delivery);
            tickets.push(delivery.ticket);
        }
        assert!(held.may_open(tickets[0]));
        held.leave_unbegun(&worker, &store);
        let Taken::Span(left) = heir.take(Duration::ZERO) else {
            panic!("it was left");
        };
        assert_eq!((left.waiting.span.scene, left.waiting.handed_on), (1, 1));
        assert!(!left.suspect);
        assert!(matches!(heir.take(Duration::ZERO), Taken::Nothing));
    }
}
