//! A worker: the real state machine, one task at a time, and a lease keeper.

use super::Mistake;
use super::farm::{Attempt, Farm, LEASE, RUN};
use super::queue::{Holder, Kept};
use crate::farm::message::{read_delivered, write_subject};
use crate::farm::queue::{Lease, Message, read_message, write_message};
use crate::farm::worker::tasks::{Action, TaskId, Tasks, Time};
use crate::run::{AttemptRecord, EndKind, Ending, PoisonCheck, Task, WorkerName, poison_check};
use std::collections::VecDeque;

pub(super) struct Worker {
    pub(super) id: u32,
    pub(super) tasks: Tasks<()>,
    /// Shards to trace, of the only task that is open.
    open: Option<(TaskId, VecDeque<u32>)>,
    /// The task that a child process traces until `busy_until`.
    child: Option<(TaskId, Task)>,
    /// An empty task, which is never done.
    pub(super) is_stuck: bool,
    /// Time until which the worker traces one shard.
    pub(super) busy_until: Time,
    pub(super) signed: Time,
    /// Time until which the lease keeper neither renews nor signs.
    pub(super) sleeps_until: Time,
    /// A task whose scene the worker would condemn, with the time of that judgment.
    doubted: Option<(TaskId, Lease, Time)>,
}

impl Worker {
    pub(super) fn new(id: u32) -> Self {
        Self {
            id,
            tasks: Tasks::new(Time::from_millis(10)),
            open: None,
            child: None,
            is_stuck: false,
            busy_until: Time::ZERO,
            signed: Time::ZERO,
            sleeps_until: Time::ZERO,
            doubted: None,
        }
    }
}

impl Farm {
    /// Does a step of a worker: a lease, a load, or a shard.
    pub(super) fn work(&mut self, w: usize) -> Result<(), String> {
        let worker = &mut self.workers[w];
        if worker.is_stuck || worker.busy_until > self.now {
            return Ok(());
        }
        if let Some(child) = worker.child.take() {
            return self.child_ends(w, child);
        }
        if let Some((task, lease, since)) = worker.doubted.take() {
            return self.examine(w, task, &lease, Some(since));
        }
        let Some((task, shards)) = &mut worker.open else {
            return self.lease(w);
        };
        let task = *task;
        let Some(shard) = shards.pop_front() else {
            worker.open = None;
            return Ok(());
        };
        if worker.tasks.begin(task, shard) {
            let now = self.now;
            let actions = worker.tasks.traced(task, shard, now);
            return self.act(w, actions);
        }
        Ok(())
    }

    fn lease(&mut self, w: usize) -> Result<(), String> {
        let id = self.workers[w].id;
        let Some(kept) = self.queue.take(self.now, LEASE, Holder::Worker(id)) else {
            return Ok(());
        };
        let message = match self.read(&kept) {
            Ok(message) => message,
            Err(reason) => {
                self.note(|| format!("worker {id} removes {}: {reason}", kept.subject));
                if self.mistake == Some(Mistake::PutsBack) {
                    let until = self.now + 2 * LEASE;
                    if let Some(kept) = self.queue.kept.get_mut(&kept.number) {
                        (kept.holder, kept.not_before) = (Holder::Nobody, until);
                    }
                } else {
                    self.queue.acknowledge(kept.number);
                }
                return Ok(());
            }
        };
        self.note(|| format!("worker {id} leases {message:?}"));
        let redelivered = kept.deliveries > 1;
        let lease = Lease { id: kept.number, message, redelivered };
        if lease.message.task.shards.is_empty() {
            self.workers[w].is_stuck = true;
            return Ok(());
        }
        match self.workers[w].tasks.lease(&lease, self.now) {
            Some(task) => self.examine(w, task, &lease, None),
            None => Ok(()),
        }
    }

    fn read(&self, kept: &Kept) -> Result<Message, String> {
        if self.mistake == Some(Mistake::CutsRanges)
            && let Ok(Some(mut message)) = read_message(&kept.bytes, RUN, &[u32::MAX; 9])
            && let Some(&count) = self.shards.get(message.task.scene as usize)
        {
            let shards = message.task.shards;
            message.task.shards = shards.start.min(count)..shards.end.min(count);
            return Ok(message);
        }
        read_delivered(&kept.subject, &kept.bytes, RUN, &self.shards)
    }

    /// Judges a task, for the second time if the first judgment of the time `doubted` was a condemnation.
    fn examine(
        &mut self,
        w: usize,
        task: TaskId,
        lease: &Lease,
        doubted: Option<Time>,
    ) -> Result<(), String> {
        let (now, leased) = (self.now, lease.message.task.clone());
        let (id, scene) = (self.workers[w].id, leased.scene);
        if self.store.tuples.contains(&scene) {
            let actions = self.workers[w].tasks.nothing_to_do(task);
            return self.act(w, actions);
        }
        let found = self.store.found(scene);
        let own_found = found.iter().filter(|shard| leased.shards.contains(shard)).count() as u32;
        let (silence, judged) = (2 * LEASE, doubted.unwrap_or(now));
        let blames = self.mistake == Some(Mistake::BlamesDeliveries) && lease.redelivered;
        let scene_id = &self.ids[scene as usize];
        for Attempt { record, signed, marked } in &mut self.store.attempts {
            let is_of = record.scene == *scene_id
                && record.shards == [leased.shards.start, leased.shards.end];
            if !is_of || marked.is_some_and(|marked| *signed <= marked) {
                continue;
            }
            record.ended = None;
            if blames || judged.saturating_sub(*signed) >= silence {
                let reason = format!("{} was lost", record.worker);
                record.ended =
                    Some(Ending { kind: EndKind::Lost, reason, log_tail: String::new() });
                *marked = Some(now);
            }
        }
        let of = self.store.attempts.iter().filter(|attempt| attempt.record.scene == *scene_id);
        let records: Vec<AttemptRecord> = of.map(|attempt| attempt.record.clone()).collect();
        let check = poison_check(&records, &leased, own_found);
        if let PoisonCheck::Poison(reason) = &check {
            if doubted.is_some() || self.mistake == Some(Mistake::JudgesAtOnce) {
                return Err(format!("healthy scene {scene} goes into quarantine: {reason}"));
            }
            self.note(|| format!("worker {id} looks again at scene {scene} after two leases"));
            let worker = &mut self.workers[w];
            (worker.doubted, worker.busy_until) = (Some((task, lease.clone(), now)), now + silence);
            return Ok(());
        }
        let n = 1 + records.iter().map(|record| record.n).max().unwrap_or(0);
        let who = WorkerName { worker: id.to_string(), host: "h".to_owned() };
        let mut record = AttemptRecord::new(scene_id, &leased, &who, own_found);
        record.n = n;
        self.store.attempts.push(Attempt { record, signed: now, marked: None });
        let tasks = &mut self.workers[w].tasks;
        tasks.pin(task);
        tasks.attempted(task, n);
        if check == PoisonCheck::Suspect {
            let takes = LEASE * self.draw(4) as u32;
            self.note(|| format!("worker {id}: a child traces scene {scene} for {takes:?}"));
            let worker = &mut self.workers[w];
            worker.tasks.sandbox(task, now);
            (worker.child, worker.busy_until) = (Some((task, leased)), now + takes);
            return Ok(());
        }
        let worker = &mut self.workers[w];
        worker.tasks.load(task, now);
        let count = self.shards[scene as usize];
        let actions = worker.tasks.loaded(task, count, &found, ());
        worker.open = Some((task, worker.tasks.waiting(task).into()));
        self.act(w, actions)
    }

    /// The child has written each shard, and the scene is healthy.
    fn child_ends(&mut self, w: usize, (task, leased): (TaskId, Task)) -> Result<(), String> {
        let scene = leased.scene;
        if !self.store.tuples.contains(&scene) {
            self.store.partials.extend(leased.shards.map(|shard| (scene, shard)));
            if self.store.found(scene).len() == self.shards[scene as usize] as usize {
                self.merge(scene);
            }
        }
        let actions = self.workers[w].tasks.nothing_to_do(task);
        self.act(w, actions)
    }

    fn merge(&mut self, scene: u32) {
        self.note(|| format!("scene {scene} is merged"));
        self.store.tuples.insert(scene);
    }

    /// Performs the machine's actions at once; other tests reorder and lose them.
    fn act(&mut self, w: usize, actions: Vec<Action>) -> Result<(), String> {
        let mut actions = VecDeque::from(actions);
        while let Some(action) = actions.pop_front() {
            let tasks = &mut self.workers[w].tasks;
            let more = match action {
                Action::Store { task, shards } => {
                    let Some(scene) = tasks.scene(task) else { continue };
                    let put = |shard| {
                        self.store.partials.insert((scene, shard));
                        tasks.stored(task, shard)
                    };
                    shards.into_iter().flat_map(put).collect()
                }
                Action::Merge { task } => {
                    let Some(scene) = tasks.scene(task) else { continue };
                    self.merge(scene);
                    self.workers[w].tasks.merged(task)
                }
                Action::CheckScene { task } => {
                    let Some(scene) = tasks.scene(task) else { continue };
                    let all = self.store.found(scene).len() == self.shards[scene as usize] as usize;
                    if !all && self.store.tuples.contains(&scene) {
                        tasks.done_elsewhere(task)
                    } else {
                        tasks.scene_checked(task, all)
                    }
                }
                Action::Gather { task } => tasks.gathered(task, &[]),
                Action::Quarantine { scene, reason } => {
                    return Err(format!("healthy scene {scene} goes into quarantine: {reason}"));
                }
                Action::RemovePartials { scene } => {
                    self.store.partials.retain(|(of, _)| *of != scene);
                    Vec::new()
                }
                Action::ForgetAttempt { task, n } => {
                    self.forget(&task, n);
                    Vec::new()
                }
                Action::Replace { lease, messages } => {
                    let mut all_new = true;
                    for message in messages {
                        let bytes = write_message(RUN, &message);
                        all_new &= self.queue.publish(write_subject(&message), bytes);
                    }
                    if all_new { vec![Action::Finish { lease }] } else { Vec::new() }
                }
                Action::Finish { lease } => {
                    self.queue.acknowledge(lease);
                    Vec::new()
                }
            };
            more.into_iter().rev().for_each(|action| actions.push_front(action));
        }
        Ok(())
    }

    fn forget(&mut self, task: &Task, n: u32) {
        let id = &self.ids[task.scene as usize];
        let shards = [task.shards.start, task.shards.end];
        let is_it = |r: &AttemptRecord| r.scene == *id && r.shards == shards && r.n == n;
        self.store.attempts.retain(|attempt| !is_it(&attempt.record));
    }
}
