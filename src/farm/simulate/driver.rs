//! A simulated worker: it drives the machine that ships, in virtual time. It computes one thing at a time.

use super::engine::{Event, Sim, WorkerId, us};
use super::queue::{Delivered, Sequence};
use crate::farm::queue::Lease;
use crate::farm::worker::costs::Costs;
use crate::farm::worker::tasks::{Action, Offer, TaskId, Tasks, Time};
use std::collections::VecDeque;

/// Partials of a scene that is here as a whole wait in memory for so long.
const CHECKPOINT: Time = Time::from_secs(20);

#[derive(Clone, Copy, Debug, PartialEq)]
enum Doing {
    Nothing,
    /// Loads a task's scene.
    Loads(TaskId),
    /// Traces a shard since that time, in microseconds.
    Traces(TaskId, u32, u64),
}

#[derive(Clone, Debug)]
pub(super) struct Worker {
    pub(super) is_alive: bool,
    pub(super) stopped_until_us: u64,
    /// What it could not compute while it was stopped.
    pub(super) owed_us: u64,
    /// 1, or more.
    pub(super) slowness: f64,
    pub(super) tasks: Tasks<()>,
    doing: Doing,
    /// Tasks that wait to be loaded.
    queued: VecDeque<TaskId>,
    /// Shards that wait to be traced.
    shards: VecDeque<(TaskId, u32)>,
    /// Seconds of a shard, a moving mean.
    mean_s: Option<f64>,
    /// Number of the pull that has no answer yet.
    pub(super) open_pull: Option<u32>,
    pub(super) pulls: u32,
    pub(super) inbox: Option<(Delivered, u32)>,
    /// What it offers, until the queue has confirmed.
    pub(super) outbox: Vec<Offer>,
    /// The worker to answer then.
    pub(super) asker: Option<WorkerId>,
    /// Its place among the listeners to requests.
    pub(super) listens: Option<u32>,
    /// Number of the round of requests; an older timer says nothing.
    pub(super) round: u32,
    /// How often it requested in vain.
    pub(super) pauses: u32,
}

impl Default for Worker {
    fn default() -> Self {
        Self {
            is_alive: true,
            stopped_until_us: 0,
            owed_us: 0,
            slowness: 1.0,
            tasks: Tasks::new(CHECKPOINT),
            doing: Doing::Nothing,
            queued: VecDeque::new(),
            shards: VecDeque::new(),
            mean_s: None,
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
    pub(super) fn kill(&mut self) {
        *self = Self { is_alive: false, ..Self::default() };
    }

    pub(super) fn is_computing(&self) -> bool {
        self.doing != Doing::Nothing
    }

    pub(super) fn is_idle(&self) -> bool {
        !self.is_computing() && self.tasks.is_empty() && self.inbox.is_none()
    }

    /// Where a worker of speed 1 needs `load_s` to load a scene.
    pub(super) fn costs(&self, load_s: f64) -> Costs {
        Costs {
            shard_s: self.mean_s.unwrap_or(1.0),
            threads: 1.0,
            load_s: load_s * self.slowness,
            load_is_known: true,
        }
    }
}

/// A lease of the message `sequence` of the stream number `stream`, as one number.
fn lease_of(sequence: Sequence, stream: u32) -> u64 {
    u64::from(stream) << 32 | u64::from(sequence)
}

/// Sequence and stream.
pub(super) fn message_of(lease: u64) -> (Sequence, u32) {
    (lease as u32, (lease >> 32) as u32)
}

impl Sim<'_> {
    pub(super) fn now(&self) -> Time {
        Time::from_micros(self.now_us)
    }

    pub(super) fn delivered(&mut self, worker: WorkerId) {
        let now = self.now();
        let w = &mut self.workers[worker as usize];
        let Some((delivery, stream)) = w.inbox.take() else {
            return;
        };
        w.round += 1;
        let scene = delivery.message.task.scene;
        let lease = Lease {
            id: lease_of(delivery.sequence, stream),
            message: delivery.message,
            redelivered: delivery.again,
        };
        if let Some(task) = w.tasks.lease(&lease, now) {
            w.queued.push_back(task);
            if self.store.has_tuple(scene) {
                let actions = w.tasks.nothing_to_do(task);
                self.perform(worker, actions);
            }
        }
        self.go_on(worker);
    }

    /// Begins the next thing, or looks for work.
    pub(super) fn go_on(&mut self, worker: WorkerId) {
        if !self.workers[worker as usize].is_computing() {
            self.begin(worker);
        }
        let w = &self.workers[worker as usize];
        if w.is_computing() {
            self.prefetch(worker);
        } else if w.is_idle() {
            self.look_for_work(worker);
        }
        self.refresh_listening(worker);
    }

    fn begin(&mut self, worker: WorkerId) {
        let now = self.now();
        let w = &mut self.workers[worker as usize];
        let work = &self.case.work;
        while let Some((task, shard)) = w.shards.pop_front() {
            if w.tasks.begin(task, shard)
                && let Some(scene) = w.tasks.task(task).map(|leased| leased.scene)
            {
                w.doing = Doing::Traces(task, shard, self.now_us);
                let shard_us = work.shard_us(scene, shard) as f64 * w.slowness;
                return self.after(shard_us as u64, Event::Computed { worker });
            }
        }
        while let Some(task) = w.queued.pop_front() {
            if w.tasks.load(task, now) {
                w.doing = Doing::Loads(task);
                // Work is there: not a task that was finished long ago, nor one that went to another that waited.
                w.pauses = 0;
                self.counts.loads += 1;
                let load_us = us(work.load_s * w.slowness);
                return self.after(load_us, Event::Computed { worker });
            }
        }
    }

    pub(super) fn computed(&mut self, worker: WorkerId) {
        let now = self.now();
        let w = &mut self.workers[worker as usize];
        if w.owed_us > 0 {
            let owed_us = std::mem::take(&mut w.owed_us);
            self.after(owed_us, Event::Computed { worker });
            return;
        }
        let actions = match std::mem::replace(&mut w.doing, Doing::Nothing) {
            Doing::Nothing => return,
            Doing::Loads(task) => {
                let Some(scene) = w.tasks.task(task).map(|leased| leased.scene) else {
                    return;
                };
                self.counts.worker_listings += 1;
                let shards = self.case.work.shards;
                let found = self.store.finished_of(scene, 0..shards);
                let actions = w.tasks.loaded(task, shards, &found, ());
                let waiting = w.tasks.waiting(task).into_iter();
                w.shards.extend(waiting.map(|shard| (task, shard)));
                actions
            }
            Doing::Traces(task, shard, since_us) => {
                let took_s = (self.now_us - since_us) as f64 * 1e-6;
                w.mean_s = Some(w.mean_s.map_or(took_s, |mean_s| 0.9 * mean_s + 0.1 * took_s));
                self.counts.shards_traced += 1;
                if let Some(scene) = w.tasks.task(task).map(|leased| leased.scene)
                    && !self.store.trace(scene, shard)
                {
                    self.counts.shards_traced_again += 1;
                }
                w.tasks.spent(task, took_s, 1.0);
                w.tasks.traced(task, shard, now)
            }
        };
        self.perform(worker, actions);
        self.go_on(worker);
    }

    /// Does what the machine asks for. Only giving back a lease takes time.
    pub(super) fn perform(&mut self, worker: WorkerId, actions: Vec<Action>) {
        let mut actions = VecDeque::from(actions);
        while let Some(action) = actions.pop_front() {
            let tasks = &mut self.workers[worker as usize].tasks;
            let scene_of = |task| tasks.task(task).map(|leased| leased.scene);
            match action {
                Action::Store { task, shards } => {
                    if let Some(scene) = scene_of(task) {
                        for shard in shards {
                            self.store.put_shard(scene, shard);
                            actions.extend(tasks.stored(task, shard));
                        }
                    }
                }
                Action::Merge { task } => {
                    if let Some(scene) = scene_of(task) {
                        if !self.store.has_tuple(scene) {
                            self.store.put_tuple(scene);
                            self.counts.last_tuple_us = self.now_us + us(self.case.fleet.store_s);
                        }
                        actions.extend(tasks.merged(task));
                    }
                }
                Action::CheckScene { task } => {
                    self.counts.worker_listings += 1;
                    if let Some(scene) = scene_of(task) {
                        actions.extend(if self.store.has_tuple(scene) {
                            tasks.done_elsewhere(task)
                        } else {
                            tasks.scene_checked(task, self.store.is_complete(scene))
                        });
                    }
                }
                Action::Gather { task } => actions.extend(tasks.gathered(task, &[])),
                Action::Finish { lease } => {
                    let (sequence, stream) = message_of(lease);
                    let delay_us = us(self.case.fleet.store_s) + self.way_us();
                    self.after(delay_us, Event::Acknowledge { sequence, stream });
                }
                Action::Publish { messages } => {
                    for message in &messages {
                        self.store_message(message);
                    }
                }
                Action::LeaveNote { .. }
                | Action::Quarantine { .. }
                | Action::RemovePartials { .. }
                | Action::ForgetAttempt { .. } => {}
            }
        }
    }

    /// The queue has confirmed what was offered, or it has not: then everything is kept.
    pub(super) fn confirmed(&mut self, worker: WorkerId, all: bool) {
        let w = &mut self.workers[worker as usize];
        let asker = w.asker.take();
        let offers = std::mem::take(&mut w.outbox);
        let count = if all { offers.len() as u32 } else { 0 };
        if all {
            self.counts.gives += 1;
            self.counts.spans_given += u64::from(count);
            for offer in offers {
                let tasks = &mut self.workers[worker as usize].tasks;
                let actions = tasks.donated(offer.task, offer.shards());
                self.perform(worker, actions);
            }
        }
        if let Some(asker) = asker {
            self.answer(asker, count);
        }
        self.go_on(worker);
    }
}
