//! Runs the events in virtual time and injects the faults.

use super::bound::lower_bound_s;
use super::case::{Case, Fault};
use super::coordinator::POLL_S;
use super::outcome::Outcome;
use super::state::{Event, RECONNECT_S, ServerEvent, Sim, Worker, WorkerEvent, WorkerId, us};
use std::cmp::Reverse;

/// Simulates a case until its coordinator has found every scene done. Returns `None` if that takes more than 100 times
/// the sum of the lower bound and the reconciliation interval, or if the workers never finish.
pub fn simulate(case: &Case) -> Option<Outcome> {
    let bound_s = lower_bound_s(case)?;
    let mut sim = Sim::new(case, bound_s);
    sim.begin();
    let limit_us = us(100.0 * bound_s + 100.0 * case.rules.reconcile_s);
    while !sim.coordinator.is_finished {
        let Reverse((at_us, _, event)) = sim.events.pop()?;
        if at_us > limit_us {
            return None;
        }
        sim.now_us = at_us;
        sim.outcome.events += 1;
        sim.handle(event);
    }
    sim.outcome.finish(&sim.tally, case.work.scenes);
    Some(sim.outcome)
}

impl Sim<'_> {
    fn begin(&mut self) {
        for (k, fault) in self.case.faults.iter().enumerate() {
            let at_s = match *fault {
                Fault::Slow { worker, times } => {
                    self.workers[worker as usize].slowness *= times;
                    self.workers[worker as usize].load_s *= times;
                    continue;
                }
                Fault::Kill { at_s, .. }
                | Fault::Stop { at_s, .. }
                | Fault::Wipe { at_s }
                | Fault::Away { at_s, .. } => at_s,
            };
            self.after(us(at_s), Event::FaultBegins(k as u32));
        }
        self.reconcile();
        self.after(us(POLL_S), Event::Poll);
        for worker in 0..self.case.fleet.workers {
            // A thousand machines do not start at the same instant.
            let start_us = self.draw_below(us(0.1).max(1));
            self.at_worker_after(start_us, worker, WorkerEvent::PauseEnds { round: 0 });
            let renew_us = self.draw_below(self.renew_us());
            self.at_worker_after(renew_us, worker, WorkerEvent::RenewTimer);
        }
    }

    fn handle(&mut self, event: Event) {
        match event {
            Event::AtServer(of) if self.now_us < self.away_until_us => {
                // Clients repeat their requests at random times after the server's return.
                let jitter_us = match of {
                    ServerEvent::LeaseEnds { .. } => 0,
                    _ => self.draw_below(us(RECONNECT_S)),
                };
                self.after(self.away_until_us - self.now_us + jitter_us, event);
            }
            Event::AtServer(event) => self.at_server(event),
            Event::AtWorker(worker, of) => {
                let Worker { is_dead, stopped_until_us, .. } = self.workers[worker as usize];
                if is_dead {
                } else if self.now_us < stopped_until_us && of != WorkerEvent::Computed {
                    self.after(stopped_until_us - self.now_us, event);
                } else {
                    self.at_worker(worker, of);
                }
            }
            Event::PullEnds { worker, pull } => self.pull_ends(worker, pull),
            Event::Poll => self.poll(),
            Event::Listed => self.listed(),
            Event::PublishMore => self.publish_more(),
            Event::FaultBegins(k) => self.fault_begins(k),
            Event::ServerIsBack => self.server_is_back(),
        }
    }

    fn at_worker(&mut self, worker: WorkerId, event: WorkerEvent) {
        match event {
            WorkerEvent::Delivered => self.delivered(worker),
            WorkerEvent::Empty => self.empty(worker),
            WorkerEvent::Confirmed { all } => self.confirmed(worker, all),
            WorkerEvent::Requested { by } => self.requested(worker, by),
            WorkerEvent::NoDonor => self.no_donor(worker),
            WorkerEvent::Answered => self.answered(worker),
            WorkerEvent::Computed => self.computed(worker),
            WorkerEvent::PauseEnds { round } => self.pause_ends(worker, round),
            WorkerEvent::RenewTimer => {
                if !self.workers[worker as usize].tasks.is_empty() {
                    self.send(ServerEvent::Renew(worker));
                }
                self.at_worker_after(self.renew_us(), worker, event);
            }
        }
    }

    fn fault_begins(&mut self, k: u32) {
        match self.case.faults[k as usize] {
            Fault::Slow { .. } => {}
            Fault::Kill { worker, .. } => {
                // The server notices the end of the connection.
                self.listen(worker, false);
                self.workers[worker as usize] = Worker { is_dead: true, ..Worker::default() };
            }
            Fault::Stop { worker, for_s, .. } => {
                let worker = &mut self.workers[worker as usize];
                worker.stopped_until_us = self.now_us + us(for_s);
                if worker.is_computing() {
                    worker.owed_us += us(for_s);
                }
            }
            Fault::Wipe { .. } => {
                self.queue.wipe();
                self.stream += 1;
                self.stream_is_there = false;
            }
            Fault::Away { for_s, .. } => {
                self.away_until_us = self.now_us + us(for_s);
                self.after(us(for_s), Event::ServerIsBack);
            }
        }
    }

    /// Repeats the pulls that waited at the server.
    fn server_is_back(&mut self) {
        for (worker, pull) in std::mem::take(&mut self.waiting_pulls) {
            if self.pull_is_open(worker, pull) {
                let jitter_us = self.draw_below(us(RECONNECT_S));
                let pull = ServerEvent::Pull { worker, waits: true };
                self.after(jitter_us, Event::AtServer(pull));
            }
        }
    }
}
