//! A simulated worker's search for work, and its answers to requests of idle workers.

use super::outcome::Kind;
use super::state::{RECONNECT_S, ServerEvent, Sim, WorkerEvent, WorkerId, us};

/// First and longest pause between two requests of an idle worker, s. Pauses double in between.
const PAUSE_S: [f64; 2] = [0.02, 10.0];

/// Time that a requester waits for an answer, s.
const ANSWER_S: f64 = 1.0;

impl Sim<'_> {
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
        self.send(ServerEvent::Pull { worker, waits });
    }

    /// Leases the next task if the worker's tasks do not last long enough. The pull does not wait at the server,
    /// because donations are for idle workers.
    pub(super) fn prefetch(&mut self, worker: WorkerId) {
        let w = &self.workers[worker as usize];
        if !w.tasks.has_enough(1, w.costs()) {
            self.pull(worker, false);
        }
    }

    pub(super) fn empty(&mut self, worker: WorkerId) {
        self.workers[worker as usize].open_pull = None;
        if self.is_idle(worker) {
            self.pull(worker, true);
        }
    }

    /// Starts a pull that waits at the server, and schedules a request meanwhile.
    pub(super) fn look_for_work(&mut self, worker: WorkerId) {
        self.pull(worker, true);
        self.pause(worker);
    }

    /// Schedules a request after a pause, which doubles each time up to the longest one. Half of the pause is random.
    fn pause(&mut self, worker: WorkerId) {
        let [first_s, longest_s] = PAUSE_S;
        let w = &mut self.workers[worker as usize];
        let pause_s = (first_s * f64::from(1 << w.pauses.min(20))).min(longest_s);
        w.pauses += 1;
        w.round += 1;
        let round = w.round;
        let half_us = us(pause_s / 2.0).max(1);
        let delay_us = half_us + self.draw_below(half_us);
        self.at_worker_after(delay_us, worker, WorkerEvent::PauseEnds { round });
    }

    pub(super) fn pause_ends(&mut self, worker: WorkerId, round: u32) {
        if self.workers[worker as usize].round != round || !self.is_idle(worker) {
            return;
        }
        if round == 0 {
            self.look_for_work(worker);
        } else {
            self.request(worker);
        }
    }

    fn request(&mut self, worker: WorkerId) {
        // A worker that has just reconnected waits for the queue first.
        if self.away_until_us > 0 && self.now_us < self.away_until_us + us(RECONNECT_S) {
            return self.pause(worker);
        }
        let w = &mut self.workers[worker as usize];
        w.round += 1;
        let no_answer = WorkerEvent::PauseEnds { round: w.round };
        self.at_worker_after(us(ANSWER_S), worker, no_answer);
        self.send(ServerEvent::Request(worker));
    }

    pub(super) fn no_donor(&mut self, worker: WorkerId) {
        if self.is_idle(worker) {
            self.outcome.requests_in_vain += 1;
            self.pause(worker);
        }
    }

    /// Handles a donor's answer. A donated task arrives through the waiting pull, or another worker gets it.
    pub(super) fn answered(&mut self, worker: WorkerId) {
        if self.is_idle(worker) {
            self.pause(worker);
        }
    }

    pub(super) fn requested(&mut self, donor: WorkerId, by: WorkerId) {
        // The request contains the time that the requester takes to load a scene.
        let load_s = self.workers[by as usize].load_s;
        let w = &mut self.workers[donor as usize];
        if w.requester.is_some() {
            // The donor answers one requester at a time.
            let again = WorkerEvent::Requested { by };
            return self.at_worker_after(2 * self.way_us() + 1, donor, again);
        }
        let offers = w.tasks.offers(w.costs(), Some(load_s));
        if offers.is_empty() {
            return self.answer(by, 0);
        }
        w.requester = Some(by);
        w.outbox = offers;
        self.send(ServerEvent::Publish(donor));
    }

    pub(super) fn answer(&mut self, requester: WorkerId, count: u32) {
        self.tally.count(Kind::Answer, self.now_us);
        self.outcome.requests_in_vain += u64::from(count == 0);
        self.at_worker_after(2 * self.way_us(), requester, WorkerEvent::Answered);
    }

    pub(super) fn refresh_listening(&mut self, worker: WorkerId) {
        let w = &self.workers[worker as usize];
        // A donor listens while it publishes; other requesters wait for their turn.
        if w.requester.is_none() {
            let offers = w.tasks.offers(w.costs(), None);
            self.listen(worker, !offers.is_empty());
        }
    }
}
