//! The state of a simulated farm, and its events in the order of their times.

use super::case::{Case, mix};
use super::outcome::{Outcome, Tally};
use super::queue::{Delivered, Queue, Sequence};
use super::store::Store;
use crate::farm::worker::costs::Costs;
use crate::farm::worker::tasks::{Offer, TaskId, Tasks, Time};
use crate::run::Task;
use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};

/// The default of a worker's `--checkpoint-s`.
const CHECKPOINT: Time = Time::from_secs(20);

/// Clients reconnect within this time after their server is back, s.
pub(super) const RECONNECT_S: f64 = 1.0;

pub(super) type WorkerId = u32;

/// Seconds as whole microseconds.
pub(super) fn us(seconds: f64) -> u64 {
    (seconds * 1e6).round() as u64
}

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Event {
    AtServer(ServerEvent),
    AtWorker(WorkerId, WorkerEvent),
    PullEnds { worker: WorkerId, pull: u32 },
    // Of the coordinator.
    Poll,
    Listed,
    PublishMore,
    // Of the case.
    FaultBegins(u32),
    ServerIsBack,
}

/// Requests to the queue's server, which are put off while it is away.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum ServerEvent {
    Pull { worker: WorkerId, waits: bool },
    Publish(WorkerId),
    Acknowledge { sequence: Sequence, stream: u32 },
    Renew(WorkerId),
    Request(WorkerId),
    LeaseEnds { sequence: Sequence, stream: u32 },
}

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum WorkerEvent {
    Delivered,
    Empty,
    Confirmed { all: bool },
    Requested { by: WorkerId },
    NoDonor,
    Answered,
    Computed,
    PauseEnds { round: u32 },
    RenewTimer,
}

#[derive(Clone, Copy, Default, PartialEq)]
pub(super) enum Doing {
    #[default]
    Nothing,
    Loads(TaskId),
    Traces(TaskId, u32, u64),
}

/// A simulated worker. It computes one thing at a time.
#[derive(Clone, Default)]
pub(super) struct Worker {
    pub(super) is_dead: bool,
    pub(super) stopped_until_us: u64,
    /// Computation that it missed while it was stopped.
    pub(super) owed_us: u64,
    /// It takes this many times as long as others.
    pub(super) slowness: f64,
    /// Seconds in which it loads a scene.
    pub(super) load_s: f64,
    pub(super) tasks: Tasks<()>,
    pub(super) doing: Doing,
    pub(super) queued: VecDeque<TaskId>,
    pub(super) shards: VecDeque<(TaskId, u32)>,
    /// Seconds of a shard, a moving mean.
    pub(super) mean_s: Option<f64>,
    /// Number of the pull that has no answer yet.
    pub(super) open_pull: Option<u32>,
    pub(super) pulls: u32,
    /// A message on its way here, and its stream.
    pub(super) inbox: Option<(Delivered, u32)>,
    /// Offers that the queue has not confirmed.
    pub(super) outbox: Vec<Offer>,
    /// The worker to answer after the confirmation.
    pub(super) requester: Option<WorkerId>,
    /// Its place among the listeners to requests.
    pub(super) listens: Option<u32>,
    /// Number of its last pause between requests; timers of earlier ones are void.
    pub(super) round: u32,
    /// Pauses since it last had work.
    pub(super) pauses: u32,
}

impl Worker {
    pub(super) fn is_computing(&self) -> bool {
        self.doing != Doing::Nothing
    }

    pub(super) fn is_idle(&self) -> bool {
        !self.is_computing() && self.tasks.is_empty() && self.inbox.is_none()
    }

    pub(super) fn costs(&self) -> Costs {
        let shard_s = self.mean_s.unwrap_or(1.0);
        Costs { shard_s, threads: 1.0, load_s: self.load_s, load_is_known: true }
    }
}

#[derive(Default)]
pub(super) struct Coordinator {
    pub(super) is_listing: bool,
    /// By scene: the queue had no message of it when it was listed.
    pub(super) is_absent: Vec<bool>,
    /// Missing tasks that are not published yet.
    pub(super) backlog: VecDeque<Task>,
    pub(super) is_publishing: bool,
    pub(super) reconciled_us: u64,
    /// All scenes before it were done at the last listing.
    pub(super) first_missing: u32,
    pub(super) is_finished: bool,
}

pub(super) struct Sim<'a> {
    pub(super) case: &'a Case,
    pub(super) now_us: u64,
    pub(super) events: BinaryHeap<Reverse<(u64, u64, Event)>>,
    scheduled: u64,
    drawn: u64,
    pub(super) workers: Vec<Worker>,
    pub(super) queue: Queue,
    /// How often the stream was made anew.
    pub(super) stream: u32,
    pub(super) stream_is_there: bool,
    pub(super) away_until_us: u64,
    /// Pulls that wait at the server: worker, number of the pull.
    pub(super) waiting_pulls: VecDeque<(WorkerId, u32)>,
    /// Workers that have something to donate.
    pub(super) listeners: Vec<WorkerId>,
    pub(super) store: Store,
    pub(super) coordinator: Coordinator,
    pub(super) tally: Tally,
    pub(super) outcome: Outcome,
}

impl<'a> Sim<'a> {
    pub(super) fn new(case: &'a Case, bound_s: f64) -> Self {
        let work = &case.work;
        let tasks = Tasks::new(CHECKPOINT);
        let worker = Worker { slowness: 1.0, load_s: work.load_s, tasks, ..Worker::default() };
        Self {
            case,
            now_us: 0,
            events: BinaryHeap::new(),
            scheduled: 0,
            drawn: 0,
            workers: vec![worker; case.fleet.workers as usize],
            queue: Queue::new(work.scenes),
            stream: 0,
            stream_is_there: true,
            away_until_us: 0,
            waiting_pulls: VecDeque::new(),
            listeners: Vec::new(),
            store: Store::new(work.scenes, work.shards),
            coordinator: Coordinator::default(),
            tally: Tally::default(),
            outcome: Outcome { bound_s, ..Outcome::default() },
        }
    }

    pub(super) fn after(&mut self, delay_us: u64, event: Event) {
        self.scheduled += 1;
        self.events.push(Reverse((self.now_us + delay_us, self.scheduled, event)));
    }

    pub(super) fn at_worker_after(&mut self, delay_us: u64, worker: WorkerId, event: WorkerEvent) {
        self.after(delay_us, Event::AtWorker(worker, event));
    }

    /// A request of a worker, which arrives one way later.
    pub(super) fn send(&mut self, event: ServerEvent) {
        self.after(self.way_us(), Event::AtServer(event));
    }

    /// An answer of the server, which arrives one way later.
    pub(super) fn reply(&mut self, worker: WorkerId, event: WorkerEvent) {
        self.at_worker_after(self.way_us(), worker, event);
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
}
