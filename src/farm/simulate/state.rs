//! The state of a simulated farm, and its events in order of time.

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

/// Longest time that a client takes to reconnect after the server's return, s.
pub(super) const RECONNECT_S: f64 = 1.0;

pub(super) type WorkerId = u32;

/// Converts seconds to whole microseconds.
pub(super) fn us(seconds: f64) -> u64 {
    (seconds * 1e6).round() as u64
}

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Event {
    AtServer(ServerEvent),
    AtWorker(WorkerId, WorkerEvent),
    PullEnds { worker: WorkerId, pull: u32 },
    // Events of the coordinator.
    Poll,
    Listed,
    PublishMore,
    // Events of the faults.
    FaultBegins(u32),
    ServerIsBack,
}

/// Events at the queue's server, delayed while the server cannot be reached.
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

/// A simulated worker with one compute thread.
#[derive(Clone, Default)]
pub(super) struct Worker {
    pub(super) is_dead: bool,
    pub(super) stopped_until_us: u64,
    /// Computing time that the worker missed while it was stopped, µs.
    pub(super) owed_us: u64,
    /// Factor on the time to trace a shard.
    pub(super) slowness: f64,
    /// Time to load a scene, s.
    pub(super) load_s: f64,
    pub(super) tasks: Tasks<()>,
    pub(super) doing: Doing,
    pub(super) queued: VecDeque<TaskId>,
    pub(super) shards: VecDeque<(TaskId, u32)>,
    /// Moving mean of the time of a shard, s.
    pub(super) mean_s: Option<f64>,
    /// Number of the pull that has no answer yet.
    pub(super) open_pull: Option<u32>,
    pub(super) pulls: u32,
    /// A message on its way to the worker, and its stream.
    pub(super) inbox: Option<(Delivered, u32)>,
    /// Offers that the queue has not confirmed.
    pub(super) outbox: Vec<Offer>,
    /// Worker that gets an answer after the confirmation.
    pub(super) requester: Option<WorkerId>,
    /// The worker's index in the list of listeners, if it listens.
    pub(super) listens: Option<u32>,
    /// Number of the current timer of an idle worker; timers with other numbers are ignored.
    pub(super) round: u32,
    /// Number of pauses since the worker last loaded a scene.
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
    /// For each scene, true if the last listing of the queue had no message of the scene.
    pub(super) is_absent: Vec<bool>,
    /// Missing tasks that are not published yet.
    pub(super) backlog: VecDeque<Task>,
    pub(super) is_publishing: bool,
    pub(super) reconciled_us: u64,
    /// The first scene that was not done at the last listing.
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
    /// Number of the stream, which increases with every wipe.
    pub(super) stream: u32,
    pub(super) stream_is_there: bool,
    pub(super) away_until_us: u64,
    /// Pulls that wait at the server: worker, number of the pull.
    pub(super) waiting_pulls: VecDeque<(WorkerId, u32)>,
    /// Workers that accept requests for donations.
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

    /// Sends a request from a worker to the server, with the delay of one way.
    pub(super) fn send(&mut self, event: ServerEvent) {
        self.after(self.way_us(), Event::AtServer(event));
    }

    /// Sends an answer from the server to a worker, with the delay of one way.
    pub(super) fn reply(&mut self, worker: WorkerId, event: WorkerEvent) {
        self.at_worker_after(self.way_us(), worker, event);
    }

    /// Returns the delay from a worker to the server, µs.
    pub(super) fn way_us(&self) -> u64 {
        us(self.case.fleet.round_trip_s / 2.0)
    }

    pub(super) fn renew_us(&self) -> u64 {
        us(self.case.rules.lease_s / 3.0).max(1)
    }

    /// Returns a random integer below `limit`, which must be positive.
    pub(super) fn draw_below(&mut self, limit: u64) -> u64 {
        self.drawn += 1;
        mix(self.case.work.seed ^ mix(self.drawn)) % limit
    }
}
