//! How a simulated worker looks for work, and what it does for idle ones.

use super::engine::{Event, RECONNECT_S, Sim, WorkerId, us};
use super::tally::Kind;

/// An idle worker's pauses between two requests double from the first to the second, s.
const PAUSE_S: [f64; 2] = [0.02, 10.0];

/// A worker that requested something to do waits so long for an answer, s.
const GIVE_ANSWER_S: f64 = 1.0;

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
                if !self.workers[worker as usize].tasks.is_empty() {
                    self.after(self.way_us(), Event::Renew { worker });
                }
                self.after(self.renew_us(), event);
            }
            _ => {}
        }
    }

    fn is_idle(&self, worker: WorkerId) -> bool {
        self.workers[worker as usize].is_idle()
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

    /// Leases the next task when the machine says so, without waiting at the server: what is donated is for idle workers.
    pub(super) fn prefetch(&mut self, worker: WorkerId) {
        let w = &self.workers[worker as usize];
        if !w.tasks.has_enough(1, w.costs(self.case.work.load_s)) {
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
    pub(super) fn look_for_work(&mut self, worker: WorkerId) {
        self.pull(worker, true);
        self.pause(worker);
    }

    /// Requests again after a while: twice as long as the last time, half to all of it.
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
        // A worker that has just reconnected hears from the queue first.
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

    /// An idle worker requests something.
    fn asked(&mut self, giver: WorkerId, asker: WorkerId) {
        // The request says in which time the asker loads a scene.
        let load_s = self.case.work.load_s * self.workers[asker as usize].slowness;
        let w = &mut self.workers[giver as usize];
        if w.asker.is_some() {
            // One after the other.
            self.after(2 * self.way_us() + 1, Event::Asked { giver, asker });
            return;
        }
        let offers = w.tasks.offers(w.costs(self.case.work.load_s), Some(load_s));
        if offers.is_empty() {
            self.answer(asker, 0);
            return;
        }
        w.asker = Some(asker);
        w.outbox = offers;
        self.after(self.way_us(), Event::Publish { worker: giver });
    }

    pub(super) fn answer(&mut self, asker: WorkerId, count: u32) {
        self.tally.count(Kind::Answer, self.now_us);
        if count == 0 {
            self.counts.asked_in_vain += 1;
        }
        self.after(2 * self.way_us(), Event::Answered { worker: asker });
    }

    pub(super) fn refresh_listening(&mut self, worker: WorkerId) {
        let w = &self.workers[worker as usize];
        // While it publishes it goes on listening: other askers wait for their turn.
        if w.asker.is_some() {
            return;
        }
        let offers = w.tasks.offers(w.costs(self.case.work.load_s), None);
        self.listen(worker, !offers.is_empty());
    }
}
