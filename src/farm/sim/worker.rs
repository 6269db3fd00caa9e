//! A worker: takes, loads, traces, acknowledges, gives; asks when it has nothing.

use super::engine::{Event, RECONNECT_S, Sim, WorkerId, us};
use super::holding::{Handed, Holding};
use super::queue::{Delivery, Sequence};
use super::tally::Kind;
use crate::run::Span;
use std::ops::Range;

/// A busy worker takes its next span when the rest of its span is worth less, s.
const PREFETCH_S: f64 = 0.5;

/// An idle worker's pauses between two requests double from the first to the second, s.
const PAUSE_S: [f64; 2] = [0.02, 10.0];

/// A worker that asked for something to do waits so long for an answer, s.
const GIVE_ANSWER_S: f64 = 1.0;

/// What it computes.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Doing {
    Nothing,
    /// Loads the scene for that shard.
    Loads(u64, Shard),
    /// Traces since that time, in microseconds.
    Traces(u64, Shard, u64),
}

/// Scene and shard.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Shard {
    scene: u32,
    shard: u32,
}

/// A worker's state.
#[derive(Clone, Debug)]
pub(super) struct Worker {
    pub(super) is_alive: bool,
    pub(super) stopped_until_us: u64,
    /// What it could not compute while it was stopped.
    pub(super) owed_us: u64,
    /// 1, or more.
    pub(super) slowness: f64,
    pub(super) holding: Holding<(Sequence, u32)>,
    doing: Doing,
    /// Of the open span, the shards that were in the store when it was opened.
    known: Vec<u32>,
    /// Seconds of a shard: of the open scene, count and sum; of all, a moving mean.
    scene_shards: u32,
    scene_s: f64,
    mean_s: f64,
    /// Number of the pull that has no answer yet.
    pub(super) open_pull: Option<u32>,
    pulls: u32,
    pub(super) inbox: Option<(Delivery, u32)>,
    pub(super) outbox: Vec<Handed>,
    /// Whom to answer when the queue has confirmed.
    asker: Option<WorkerId>,
    /// Its place among those who listen to requests.
    pub(super) listens: Option<u32>,
    /// Number of the round of asking; an older timer says nothing.
    round: u32,
    /// How often it asked in vain.
    pauses: u32,
}

impl Default for Worker {
    fn default() -> Self {
        Self {
            is_alive: true,
            stopped_until_us: 0,
            owed_us: 0,
            slowness: 1.0,
            holding: Holding::default(),
            doing: Doing::Nothing,
            known: Vec::new(),
            scene_shards: 0,
            scene_s: 0.0,
            mean_s: 0.0,
            open_pull: None,
            pulls: 0,
            inbox: None,
            outbox: Vec::new(),
            asker: None,
            listens: None,
            round: 0,
            pauses: 0,
        }
    }
}

impl Worker {
    pub(super) fn is_computing(&self) -> bool {
        self.doing != Doing::Nothing
    }

    /// Its estimate of a shard, s: of this scene, else of all that it traced, else a second.
    fn shard_s(&self) -> f64 {
        if self.scene_shards > 0 {
            self.scene_s / f64::from(self.scene_shards)
        } else if self.mean_s > 0.0 {
            self.mean_s
        } else {
            1.0
        }
    }

    /// For [`Holding::offer`].
    fn seconds(&self, load_s: f64) -> impl Fn(&Span, Range<u32>) -> (f64, f64) + 'static {
        let (shard_s, load_s) = (self.shard_s(), load_s * self.slowness);
        move |_, unbegun| (unbegun.len() as f64 * shard_s, load_s)
    }
}

impl Sim<'_> {
    pub(super) fn at_worker(&mut self, event: Event) {
        match event {
            Event::Delivered { worker } => self.delivered(worker),
            Event::Empty { worker } => self.empty(worker),
            Event::Confirmed { worker } => self.confirmed(worker, true),
            Event::NotConfirmed { worker } => self.confirmed(worker, false),
            Event::Asked { giver, asker } => self.asked(giver, asker),
            Event::NoGiver { worker } => self.no_giver(worker),
            Event::Answered { worker } => self.answered(worker),
            Event::Computed { worker } => self.computed(worker),
            Event::PauseEnds { worker, round } => self.pause_ends(worker, round),
            Event::RenewTimer { worker } => {
                if !self.workers[worker as usize].holding.is_empty() {
                    self.after(self.way_us(), Event::Renew { worker });
                }
                self.after(self.renew_us(), event);
            }
            _ => {}
        }
    }

    fn is_idle(&self, worker: WorkerId) -> bool {
        let w = &self.workers[worker as usize];
        !w.is_computing() && w.holding.is_empty() && w.inbox.is_none()
    }

    fn delivered(&mut self, worker: WorkerId) {
        let w = &mut self.workers[worker as usize];
        let Some((delivery, stream)) = w.inbox.take() else {
            return;
        };
        w.holding.take((delivery.sequence, stream), delivery.handed);
        w.round += 1;
        self.go_on(worker);
    }

    /// Acknowledges what is settled, begins the next thing, or looks for work.
    fn go_on(&mut self, worker: WorkerId) {
        self.acknowledge(worker);
        while !self.workers[worker as usize].is_computing() {
            let w = &self.workers[worker as usize];
            let Some(id) = w.holding.ids().next() else {
                break;
            };
            if w.holding.is_opened(id) {
                self.next_shard(worker, id, false);
            } else {
                self.open(worker, id);
            }
            self.acknowledge(worker);
        }
        let w = &self.workers[worker as usize];
        if w.is_computing() {
            self.prefetch(worker);
        } else if self.is_idle(worker) {
            self.look_for_work(worker);
        }
        self.refresh_listening(worker);
    }

    fn open(&mut self, worker: WorkerId, id: u64) {
        let w = &mut self.workers[worker as usize];
        w.holding.open(id);
        let Some(span) = w.holding.span(id).cloned() else {
            return;
        };
        self.counts.worker_listings += 1;
        w.known = self.store.finished_of(span.scene, span.shards);
        w.scene_shards = 0;
        w.scene_s = 0.0;
        self.next_shard(worker, id, true);
    }

    /// Begins the next shard that is not known to be in the store, after loading its scene if that is new.
    fn next_shard(&mut self, worker: WorkerId, id: u64, load: bool) {
        let w = &mut self.workers[worker as usize];
        let Some(scene) = w.holding.span(id).map(|s| s.scene) else {
            return;
        };
        while let Some(shard) = w.holding.begin(id) {
            if w.known.contains(&shard) {
                w.holding.finish(id);
                continue;
            }
            let what = Shard { scene, shard };
            if load {
                self.counts.loads += 1;
                w.doing = Doing::Loads(id, what);
                // Work is there: not a span that somebody finished long ago, nor one that went to another who waited.
                w.pauses = 0;
                let load_us = us(self.case.work.load_s * w.slowness);
                self.after(load_us, Event::Computed { worker });
            } else {
                self.trace(worker, id, what);
            }
            return;
        }
    }

    fn trace(&mut self, worker: WorkerId, id: u64, what: Shard) {
        let w = &mut self.workers[worker as usize];
        w.doing = Doing::Traces(id, what, self.now_us);
        let shard_us = self.case.work.shard_us(what.scene, what.shard) as f64 * w.slowness;
        self.after(shard_us as u64, Event::Computed { worker });
    }

    fn computed(&mut self, worker: WorkerId) {
        let w = &mut self.workers[worker as usize];
        if w.owed_us > 0 {
            let owed_us = std::mem::take(&mut w.owed_us);
            self.after(owed_us, Event::Computed { worker });
            return;
        }
        match std::mem::replace(&mut w.doing, Doing::Nothing) {
            Doing::Nothing => {}
            Doing::Loads(id, what) => {
                self.trace(worker, id, what);
                self.refresh_listening(worker);
            }
            Doing::Traces(id, what, since_us) => {
                let took_s = (self.now_us - since_us) as f64 * 1e-6;
                w.scene_shards += 1;
                w.scene_s += took_s;
                w.mean_s = if w.mean_s > 0.0 {
                    0.9 * w.mean_s + 0.1 * took_s
                } else {
                    took_s
                };
                w.holding.finish(id);
                self.counts.shards_traced += 1;
                if !self.store.put_shard(what.scene, what.shard) {
                    self.counts.shards_traced_again += 1;
                }
                self.go_on(worker);
            }
        }
    }

    /// Merges scenes that are complete now, and acknowledges what is settled.
    fn acknowledge(&mut self, worker: WorkerId) {
        while let Some((message, span)) = self.workers[worker as usize].holding.acknowledge() {
            let (sequence, stream) = message;
            if (1..self.case.work.shards).contains(&span.shard_count()) {
                // Is the rest of the scene there?
                self.counts.worker_listings += 1;
            }
            if self.store.is_complete(span.scene) && !self.store.has_tuple(span.scene) {
                self.store.put_tuple(span.scene);
                self.counts.last_tuple_us = self.now_us + us(self.case.fleet.store_s);
            }
            let delay_us = us(self.case.fleet.store_s) + self.way_us();
            self.after(delay_us, Event::Acknowledge { sequence, stream });
        }
    }

    fn pull(&mut self, worker: WorkerId, waits: bool) {
        let w = &mut self.workers[worker as usize];
        if w.open_pull.is_some() || w.inbox.is_some() {
            return;
        }
        w.pulls += 1;
        w.open_pull = Some(w.pulls);
        self.after(self.way_us(), Event::Pull { worker, waits });
    }

    /// Takes the next span near the end of its own, without waiting at the server: what is given away is for those who are
    /// idle.
    fn prefetch(&mut self, worker: WorkerId) {
        let w = &self.workers[worker as usize];
        if w.holding.len() > 1 {
            return;
        }
        let open = w.holding.ids().next().and_then(|id| w.holding.unbegun(id));
        let is_time = open.is_some_and(|unbegun| {
            (unbegun.len() + 1) as f64 * w.shard_s() <= PREFETCH_S || unbegun.is_empty()
        });
        if is_time {
            self.pull(worker, false);
        }
    }

    /// The pull had no answer.
    fn empty(&mut self, worker: WorkerId) {
        self.workers[worker as usize].open_pull = None;
        if self.is_idle(worker) {
            self.pull(worker, true);
        }
    }

    /// A pull waits at the server; requests to give are sent beside it.
    fn look_for_work(&mut self, worker: WorkerId) {
        self.pull(worker, true);
        self.pause(worker);
    }

    /// Asks again after a while: twice as long as the last time, half to all of it.
    fn pause(&mut self, worker: WorkerId) {
        let [first_s, longest_s] = PAUSE_S;
        let w = &mut self.workers[worker as usize];
        let pause_s = (first_s * f64::from(1 << w.pauses.min(20))).min(longest_s);
        w.pauses += 1;
        w.round += 1;
        let round = w.round;
        let half_us = us(pause_s / 2.0).max(1);
        let delay_us = half_us + self.draw_below(half_us);
        self.after(delay_us, Event::PauseEnds { worker, round });
    }

    fn pause_ends(&mut self, worker: WorkerId, round: u32) {
        if self.workers[worker as usize].round != round || !self.is_idle(worker) {
            return;
        }
        if round == 0 {
            self.look_for_work(worker);
        } else {
            self.ask(worker);
        }
    }

    fn ask(&mut self, worker: WorkerId) {
        // Who has just reconnected hears from the queue first.
        let is_new_connection =
            self.away_until_us > 0 && self.now_us < self.away_until_us + us(RECONNECT_S);
        if is_new_connection {
            self.pause(worker);
            return;
        }
        let w = &mut self.workers[worker as usize];
        w.round += 1;
        let round = w.round;
        let wait_us = us(GIVE_ANSWER_S);
        self.after(wait_us, Event::PauseEnds { worker, round });
        self.after(self.way_us(), Event::Ask { worker });
    }

    fn no_giver(&mut self, worker: WorkerId) {
        if self.is_idle(worker) {
            self.counts.asked_in_vain += 1;
            self.pause(worker);
        }
    }

    /// Whether something was given or not: what was given comes by the pull that waits, or went to another one.
    fn answered(&mut self, worker: WorkerId) {
        if self.is_idle(worker) {
            self.pause(worker);
        }
    }

    /// An idle worker asks for something.
    fn asked(&mut self, giver: WorkerId, asker: WorkerId) {
        let slowness = self.workers[asker as usize].slowness;
        // The one who asks says in which time it loads a scene.
        let load_s = self.case.work.load_s * slowness;
        let w = &mut self.workers[giver as usize];
        if w.asker.is_some() {
            // One after the other.
            self.after(2 * self.way_us() + 1, Event::Asked { giver, asker });
            return;
        }
        let shard_s = w.shard_s();
        let seconds = move |_: &Span, unbegun: Range<u32>| (unbegun.len() as f64 * shard_s, load_s);
        let offered = w.holding.offer(slowness / w.slowness, seconds);
        if offered.is_empty() {
            self.answer(asker, 0);
            return;
        }
        w.asker = Some(asker);
        w.outbox = offered;
        self.after(self.way_us(), Event::Publish { worker: giver });
    }

    fn answer(&mut self, asker: WorkerId, spans: u32) {
        self.tally.count(Kind::Answer, self.now_us);
        if spans == 0 {
            self.counts.asked_in_vain += 1;
        }
        self.after(2 * self.way_us(), Event::Answered { worker: asker });
    }

    fn confirmed(&mut self, worker: WorkerId, all: bool) {
        let w = &mut self.workers[worker as usize];
        let asker = w.asker.take();
        let spans = w.holding.offered_count();
        if all {
            w.holding.given();
            self.counts.gives += 1;
            self.counts.spans_given += u64::from(spans);
        } else {
            w.holding.kept();
        }
        if let Some(asker) = asker {
            self.answer(asker, if all { spans } else { 0 });
        }
        self.go_on(worker);
    }

    fn refresh_listening(&mut self, worker: WorkerId) {
        let w = &self.workers[worker as usize];
        // While it publishes it goes on listening: whoever asks waits for his turn.
        if w.asker.is_some() {
            return;
        }
        let could_give = w.holding.could_give(w.seconds(self.case.work.load_s));
        self.listen(worker, could_give);
    }
}
