//! The loop over events in virtual time, and the faults.

use super::bound::lower_bound_s;
use super::case::{Case, Fault, mix};
use super::coordinator::{Coordinator, POLL_S};
use super::driver::Worker;
use super::outcome::{Counts, Outcome};
use super::queue::{Queue, Sequence};
use super::store::Store;
use super::tally::Tally;
use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};

/// Number of a worker.
pub(super) type WorkerId = u32;

/// Something that happens at a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Event {
    // At the queue's server.
    Pull {
        worker: WorkerId,
        waits: bool,
    },
    Publish {
        worker: WorkerId,
    },
    Acknowledge {
        sequence: Sequence,
        stream: u32,
    },
    Renew {
        worker: WorkerId,
    },
    Ask {
        worker: WorkerId,
    },
    LeaseEnds {
        sequence: Sequence,
        stream: u32,
    },
    PullEnds {
        worker: WorkerId,
        pull: u32,
    },
    // At a worker.
    Delivered {
        worker: WorkerId,
    },
    Empty {
        worker: WorkerId,
    },
    Confirmed {
        worker: WorkerId,
    },
    NotConfirmed {
        worker: WorkerId,
    },
    Asked {
        giver: WorkerId,
        asker: WorkerId,
    },
    Answered {
        worker: WorkerId,
    },
    /// No worker listens to requests.
    NoGiver {
        worker: WorkerId,
    },
    /// What the worker computes is done.
    Computed {
        worker: WorkerId,
    },
    PauseEnds {
        worker: WorkerId,
        round: u32,
    },
    RenewTimer {
        worker: WorkerId,
    },
    // At the coordinator.
    Poll,
    Listed,
    PublishMore,
    // From outside.
    FaultBegins(u32),
    FaultEnds(u32),
}

pub(super) struct Sim<'a> {
    pub(super) case: &'a Case,
    pub(super) now_us: u64,
    events: BinaryHeap<Reverse<(u64, u64, Event)>>,
    scheduled: u64,
    drawn: u64,
    pub(super) workers: Vec<Worker>,
    pub(super) queue: Queue,
    /// Which stream it is: counts how often it was made.
    pub(super) stream: u32,
    pub(super) stream_is_there: bool,
    /// Until then the server is away.
    pub(super) away_until_us: u64,
    /// Pulls that wait at the server: worker, number of the pull.
    pub(super) waiting_pulls: VecDeque<(WorkerId, u32)>,
    /// Workers that have something to give.
    pub(super) listeners: Vec<WorkerId>,
    pub(super) store: Store,
    pub(super) coordinator: Coordinator,
    pub(super) tally: Tally,
    pub(super) counts: Counts,
}

/// Clients reconnect within so many seconds after their server is back.
pub(super) const RECONNECT_S: f64 = 1.0;

/// Seconds as whole microseconds.
pub(super) fn us(seconds: f64) -> u64 {
    (seconds * 1e6).round() as u64
}

/// Simulates a case until its coordinator knows that every scene is done; none if it does not come to that in a hundred
/// times the lower bound.
pub fn simulate(case: &Case) -> Option<Outcome> {
    let bound_s = lower_bound_s(case)?;
    let mut sim = Sim::new(case);
    let limit_us = us(100.0 * bound_s + 100.0 * case.rules.reconcile_s);
    while sim.coordinator.finished_us.is_none() {
        let Reverse((at_us, _, event)) = sim.events.pop()?;
        if at_us > limit_us {
            return None;
        }
        sim.now_us = at_us;
        sim.counts.events += 1;
        sim.handle(event);
    }
    Some(sim.outcome(bound_s))
}

impl<'a> Sim<'a> {
    fn new(case: &'a Case) -> Self {
        let work = &case.work;
        let mut sim = Self {
            case,
            now_us: 0,
            events: BinaryHeap::new(),
            scheduled: 0,
            drawn: 0,
            workers: vec![Worker::default(); case.fleet.workers as usize],
            queue: Queue::new(work.scenes),
            stream: 0,
            stream_is_there: true,
            away_until_us: 0,
            waiting_pulls: VecDeque::new(),
            listeners: Vec::new(),
            store: Store::new(work.scenes, work.shards),
            coordinator: Coordinator::default(),
            tally: Tally::default(),
            counts: Counts::default(),
        };
        for (k, fault) in case.faults.iter().enumerate() {
            let at_s = match *fault {
                Fault::Slow { worker, times } => {
                    sim.workers[worker as usize].slowness *= times;
                    continue;
                }
                Fault::Kill { at_s, .. }
                | Fault::Stop { at_s, .. }
                | Fault::Wipe { at_s }
                | Fault::Away { at_s, .. } => at_s,
            };
            sim.after(us(at_s), Event::FaultBegins(k as u32));
        }
        sim.reconcile();
        sim.after(us(POLL_S), Event::Poll);
        for worker in 0..case.fleet.workers {
            // A thousand machines do not start at the same instant.
            let start_us = sim.draw_below(us(0.1).max(1));
            sim.after(start_us, Event::PauseEnds { worker, round: 0 });
            let renew_us = sim.draw_below(sim.renew_us());
            sim.after(renew_us, Event::RenewTimer { worker });
        }
        sim
    }

    pub(super) fn after(&mut self, delay_us: u64, event: Event) {
        self.scheduled += 1;
        let entry = (self.now_us + delay_us, self.scheduled, event);
        self.events.push(Reverse(entry));
    }

    /// One way between a worker and the server.
    pub(super) fn way_us(&self) -> u64 {
        us(self.case.fleet.round_trip_s / 2.0)
    }

    pub(super) fn renew_us(&self) -> u64 {
        us(self.case.rules.lease_s / 3.0).max(1)
    }

    /// A random whole number below `limit`, which is above 0.
    pub(super) fn draw_below(&mut self, limit: u64) -> u64 {
        self.drawn += 1;
        mix(self.case.work.seed ^ mix(self.drawn)) % limit
    }

    fn handle(&mut self, event: Event) {
        use Event as E;
        match event {
            E::Pull { .. }
            | E::Publish { .. }
            | E::Acknowledge { .. }
            | E::Renew { .. }
            | E::Ask { .. }
            | E::LeaseEnds { .. } => {
                if self.now_us < self.away_until_us {
                    self.put_off_until_back(event);
                } else {
                    self.at_server(event);
                }
            }
            E::PullEnds { worker, pull } => self.pull_ends(worker, pull),
            E::Delivered { worker }
            | E::Empty { worker }
            | E::Confirmed { worker }
            | E::NotConfirmed { worker }
            | E::Answered { worker }
            | E::NoGiver { worker }
            | E::Asked { giver: worker, .. }
            | E::Computed { worker }
            | E::PauseEnds { worker, .. }
            | E::RenewTimer { worker } => {
                let stopped_until_us = self.workers[worker as usize].stopped_until_us;
                if !self.workers[worker as usize].is_alive {
                } else if self.now_us < stopped_until_us && !matches!(event, E::Computed { .. }) {
                    self.after(stopped_until_us - self.now_us, event);
                } else {
                    self.at_worker(event);
                }
            }
            E::Poll => self.poll(),
            E::Listed => self.listed(),
            E::PublishMore => self.publish_more(),
            E::FaultBegins(k) => self.fault_begins(k),
            E::FaultEnds(_) => self.server_is_back(),
        }
    }

    /// A client whose server is away sends again when it is back: not all at the same instant.
    fn put_off_until_back(&mut self, event: Event) {
        let jitter_us = match event {
            Event::LeaseEnds { .. } => 0,
            _ => self.draw_below(us(RECONNECT_S)),
        };
        self.after(self.away_until_us - self.now_us + jitter_us, event);
    }

    fn fault_begins(&mut self, k: u32) {
        match self.case.faults[k as usize] {
            Fault::Slow { .. } => {}
            Fault::Kill { worker, .. } => {
                // The server sees the connection end.
                self.listen(worker, false);
                self.workers[worker as usize].kill();
            }
            Fault::Stop { worker, for_s, .. } => {
                let end_us = self.now_us + us(for_s);
                let worker = &mut self.workers[worker as usize];
                worker.stopped_until_us = end_us;
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
                self.after(us(for_s), Event::FaultEnds(k));
            }
        }
    }

    /// Pulls that waited at the server are sent again.
    fn server_is_back(&mut self) {
        for (worker, pull) in std::mem::take(&mut self.waiting_pulls) {
            if self.pull_is_open(worker, pull) {
                let jitter_us = self.draw_below(us(RECONNECT_S));
                self.after(jitter_us, Event::Pull { worker, waits: true });
            }
        }
    }
}
