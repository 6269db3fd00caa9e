//! Drives a worker's real state machine in virtual time.

use super::queue::Sequence;
use super::state::{Doing, Event, ServerEvent, Sim, WorkerEvent, WorkerId, us};
use crate::farm::queue::Lease;
use crate::farm::worker::tasks::{Action, Time};
use std::collections::VecDeque;

/// Returns the sequence number and the stream of a lease's message.
pub(super) fn message_of(lease: u64) -> (Sequence, u32) {
    (lease as u32, (lease >> 32) as u32)
}

impl Sim<'_> {
    fn now(&self) -> Time {
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
        let id = u64::from(stream) << 32 | u64::from(delivery.sequence);
        let lease = Lease { id, message: delivery.message, redelivered: delivery.again };
        if let Some(task) = w.tasks.lease(&lease, now) {
            w.queued.push_back(task);
            if self.store.has_tuple(scene) {
                let actions = w.tasks.nothing_to_do(task);
                self.perform(worker, actions);
            }
        }
        self.go_on(worker);
    }

    /// Starts the next computation and prefetches a task, or looks for work.
    fn go_on(&mut self, worker: WorkerId) {
        if !self.workers[worker as usize].is_computing() {
            self.compute(worker);
        }
        let w = &self.workers[worker as usize];
        if w.is_computing() {
            self.prefetch(worker);
        } else if w.is_idle() {
            self.look_for_work(worker);
        }
        self.refresh_listening(worker);
    }

    fn compute(&mut self, worker: WorkerId) {
        let now = self.now();
        let w = &mut self.workers[worker as usize];
        let work = &self.case.work;
        while let Some((task, shard)) = w.shards.pop_front() {
            if w.tasks.begin(task, shard)
                && let Some(scene) = w.tasks.scene(task)
            {
                w.doing = Doing::Traces(task, shard, self.now_us);
                let shard_us = work.shard_us(scene, shard) as f64 * w.slowness;
                return self.at_worker_after(shard_us as u64, worker, WorkerEvent::Computed);
            }
        }
        while let Some(task) = w.queued.pop_front() {
            if w.tasks.load(task, now) {
                w.doing = Doing::Loads(task);
                // Only a load resets the pauses, because a newly leased task may be done or donated by now.
                w.pauses = 0;
                self.outcome.loads += 1;
                let load_us = us(w.load_s);
                return self.at_worker_after(load_us, worker, WorkerEvent::Computed);
            }
        }
    }

    pub(super) fn computed(&mut self, worker: WorkerId) {
        let now = self.now();
        let w = &mut self.workers[worker as usize];
        if w.owed_us > 0 {
            let owed_us = std::mem::take(&mut w.owed_us);
            return self.at_worker_after(owed_us, worker, WorkerEvent::Computed);
        }
        let actions = match std::mem::replace(&mut w.doing, Doing::Nothing) {
            Doing::Nothing => return,
            Doing::Loads(task) => {
                let Some(scene) = w.tasks.scene(task) else {
                    return;
                };
                self.outcome.worker_listings += 1;
                let found = self.store.found(scene);
                let actions = w.tasks.loaded(task, self.case.work.shards, &found, ());
                w.shards.extend(w.tasks.waiting(task).into_iter().map(|shard| (task, shard)));
                actions
            }
            Doing::Traces(task, shard, since_us) => {
                let took_s = (self.now_us - since_us) as f64 * 1e-6;
                w.mean_s = Some(w.mean_s.map_or(took_s, |mean_s| 0.9 * mean_s + 0.1 * took_s));
                self.outcome.shards_traced += 1;
                if let Some(scene) = w.tasks.scene(task)
                    && !self.store.trace(scene, shard)
                {
                    self.outcome.shards_traced_again += 1;
                }
                w.tasks.spent(task, took_s, 1.0);
                w.tasks.traced(task, shard, now)
            }
        };
        self.perform(worker, actions);
        self.go_on(worker);
    }

    /// Performs the machine's actions. Only finishing a lease takes time.
    fn perform(&mut self, worker: WorkerId, actions: Vec<Action>) {
        let mut actions = VecDeque::from(actions);
        while let Some(action) = actions.pop_front() {
            let tasks = &mut self.workers[worker as usize].tasks;
            match action {
                Action::Store { task, shards } => {
                    if let Some(scene) = tasks.scene(task) {
                        for shard in shards {
                            self.store.put_shard(scene, shard);
                            actions.extend(tasks.stored(task, shard));
                        }
                    }
                }
                Action::Merge { task } => {
                    if let Some(scene) = tasks.scene(task) {
                        if !self.store.has_tuple(scene) {
                            self.store.put_tuple(scene);
                            let at_us = self.now_us + us(self.case.fleet.store_s);
                            self.outcome.makespan_s = at_us as f64 * 1e-6;
                        }
                        actions.extend(tasks.merged(task));
                    }
                }
                Action::CheckScene { task } => {
                    self.outcome.worker_listings += 1;
                    if let Some(scene) = tasks.scene(task) {
                        let count = self.store.found(scene).len();
                        actions.extend(if self.store.has_tuple(scene) {
                            tasks.done_elsewhere(task)
                        } else {
                            tasks.scene_checked(task, count == self.case.work.shards as usize)
                        });
                    }
                }
                Action::Gather { task } => actions.extend(tasks.gathered(task, &[])),
                Action::Finish { lease } => {
                    let (sequence, stream) = message_of(lease);
                    let delay_us = us(self.case.fleet.store_s) + self.way_us();
                    let acknowledge = ServerEvent::Acknowledge { sequence, stream };
                    self.after(delay_us, Event::AtServer(acknowledge));
                }
                Action::Replace { lease, messages } => {
                    let mut refused = false;
                    for message in &messages {
                        refused |= self.store_message(message) == Some(false);
                    }
                    if !refused {
                        actions.push_front(Action::Finish { lease });
                    }
                }
                Action::Quarantine { .. }
                | Action::RemovePartials { .. }
                | Action::ForgetAttempt { .. } => {}
            }
        }
    }

    /// Handles the queue's answer to the offers. With `all`, the queue has them; otherwise the donor keeps its shards.
    pub(super) fn confirmed(&mut self, worker: WorkerId, all: bool) {
        let w = &mut self.workers[worker as usize];
        let requester = w.requester.take();
        let offers = std::mem::take(&mut w.outbox);
        let count = if all { offers.len() as u32 } else { 0 };
        if all {
            self.outcome.donations += 1;
            self.outcome.tasks_donated += u64::from(count);
            for offer in offers {
                let tasks = &mut self.workers[worker as usize].tasks;
                let actions = tasks.donated(offer.task, offer.shards());
                self.perform(worker, actions);
            }
        }
        if let Some(requester) = requester {
            self.answer(requester, count);
        }
        self.go_on(worker);
    }
}
