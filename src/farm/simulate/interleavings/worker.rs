//! A worker of the small farm: the machine that ships, and its jobs, each a step of its own.

use super::Mistake;
use super::farm::{Farm, Packet, SHARDS, digest};
use crate::farm::queue::Lease;
use crate::farm::worker::costs::Costs;
use crate::farm::worker::tasks::{Action, TaskId, Tasks, Time};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::ops::Range;

/// Steps after which a partial no longer waits in memory.
const CHECKPOINT: Time = Time::from_millis(25);

const COSTS: Costs = Costs { shard_s: 1.0, threads: 1.0, load_s: 0.1, load_is_known: true };

/// Names a published message: a confirmation to a worker that crashed means nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Publication {
    worker: usize,
    incarnation: u32,
    number: u32,
}

/// Something that one of its threads does next.
#[derive(Clone, Debug)]
pub(super) enum Job {
    Examine(TaskId, Lease),
    Load(TaskId),
    /// With the partials that were found.
    Loaded(TaskId, Vec<u32>),
    Sandbox(TaskId),
    Begin(TaskId, u32),
    Trace(TaskId, u32),
    Put(TaskId, u32),
    Check(TaskId),
    Gather(TaskId),
    Merge(TaskId),
    Act(VecDeque<Action>),
    /// Until all of it is confirmed, then goes on.
    Publishes(BTreeSet<Publication>, VecDeque<Action>),
    /// The same for an offer.
    Offers(Publication, TaskId, Range<u32>),
}

impl Job {
    pub(super) fn waits(&self) -> bool {
        matches!(self, Self::Publishes(..) | Self::Offers(..))
    }
}

pub(super) struct Worker {
    number: usize,
    pub(super) incarnation: u32,
    pub(super) tasks: Tasks<()>,
    pub(super) jobs: Vec<Job>,
    /// It takes nothing new, and begins no shard.
    pub(super) stops: bool,
    /// It is replaced when it has done the rest.
    pub(super) leaves: bool,
    results: BTreeMap<TaskId, BTreeMap<u32, u64>>,
    published: u32,
}

impl Worker {
    pub(super) fn new(number: usize, incarnation: u32) -> Self {
        Self {
            number,
            incarnation,
            tasks: Tasks::new(CHECKPOINT),
            jobs: Vec::new(),
            stops: false,
            leaves: false,
            results: BTreeMap::new(),
            published: 0,
        }
    }

    fn act(&mut self, actions: Vec<Action>) {
        if !actions.is_empty() {
            self.jobs.push(Job::Act(actions.into()));
        }
    }

    fn publication(&mut self) -> Publication {
        self.published += 1;
        Publication { worker: self.number, incarnation: self.incarnation, number: self.published }
    }
}

impl Farm {
    /// One of a worker's threads does something.
    pub(super) fn work(&mut self, w: usize) -> Result<(), String> {
        let Some(job) = self.job_of(w) else {
            let worker = &self.workers[w];
            if worker.leaves && worker.jobs.is_empty() {
                self.replace(w);
            }
            return Ok(());
        };
        self.note(|| format!("worker {w}: {job:?}"));
        let now = self.now;
        match job {
            Job::Examine(task, lease) => self.examine(w, task, &lease),
            Job::Load(task) => {
                // The store is listed now, and what it has arrives later.
                if self.workers[w].tasks.load(task, now)
                    && let Some(scene) = self.scene_of(w, task)
                {
                    let found = self.found(scene);
                    self.workers[w].jobs.push(Job::Loaded(task, found));
                }
            }
            Job::Loaded(task, found) => self.loaded(w, task, found),
            Job::Sandbox(task) => self.sandbox(w, task)?,
            Job::Begin(task, shard) => {
                if self.workers[w].tasks.begin(task, shard) {
                    self.workers[w].jobs.push(Job::Trace(task, shard));
                }
            }
            Job::Trace(task, shard) => {
                if let Some(scene) = self.scene_of(w, task) {
                    let worker = &mut self.workers[w];
                    let results = worker.results.entry(task).or_default();
                    results.insert(shard, digest(scene, shard));
                    let actions = worker.tasks.traced(task, shard, now);
                    worker.act(actions);
                }
            }
            Job::Put(task, shard) => self.put(w, task, shard)?,
            Job::Check(task) => self.check_scene(w, task),
            Job::Gather(task) => self.gather(w, task),
            Job::Merge(task) => self.merge(w, task)?,
            Job::Act(actions) => self.act(w, actions),
            Job::Publishes(..) | Job::Offers(..) => {}
        }
        Ok(())
    }

    fn examine(&mut self, w: usize, task: TaskId, lease: &Lease) {
        let leased = lease.message.task.clone();
        let is_done = self.has_tuple(leased.scene);
        let suspect = lease.redelivered && self.draw(2) == 0;
        if is_done {
            let actions = self.workers[w].tasks.nothing_to_do(task);
            return self.workers[w].act(actions);
        }
        if suspect && !self.workers[w].tasks.pin(task) {
            return;
        }
        let n = self.record(w, &leased);
        if !self.workers[w].tasks.attempted(task, n) {
            let key = (leased.scene, leased.shards.start, leased.shards.end, n);
            self.store.attempts.remove(&key);
            return;
        }
        let job = if suspect { Job::Sandbox(task) } else { Job::Load(task) };
        self.workers[w].jobs.push(job);
    }

    fn loaded(&mut self, w: usize, task: TaskId, mut found: Vec<u32>) {
        let Some(scene) = self.scene_of(w, task) else {
            return;
        };
        // What was merged by another worker meanwhile is not found any more.
        let there = self.found(scene);
        found.retain(|shard| there.contains(shard));
        let worker = &mut self.workers[w];
        let results = found.iter().map(|&shard| (shard, digest(scene, shard)));
        worker.results.insert(task, results.collect());
        let actions = worker.tasks.loaded(task, SHARDS, &found, ());
        worker.act(actions);
        for shard in worker.tasks.waiting(task) {
            worker.jobs.push(Job::Begin(task, shard));
        }
    }

    /// A child does all of it, or dies, or is told to stop.
    fn sandbox(&mut self, w: usize, task: TaskId) -> Result<(), String> {
        let now = self.now;
        let fate = self.draw(3);
        let Some(scene) = self.scene_of(w, task) else {
            return Ok(());
        };
        if !self.workers[w].tasks.sandbox(task, now) {
            return Ok(());
        }
        let actions = match fate {
            0 => {
                let all: BTreeMap<u32, u64> = (0..SHARDS).map(|s| (s, digest(scene, s))).collect();
                self.store.put_tuple(scene, &all)?;
                self.workers[w].tasks.nothing_to_do(task)
            }
            1 => {
                self.disown(w);
                self.workers[w].tasks.retry(task)
            }
            _ => self.workers[w].tasks.requeue(task),
        };
        self.workers[w].act(actions);
        Ok(())
    }

    fn put(&mut self, w: usize, task: TaskId, shard: u32) -> Result<(), String> {
        let Some(scene) = self.scene_of(w, task) else {
            return Ok(());
        };
        if self.workers[w].tasks.has(task) {
            self.store.put_partial(scene, shard, digest(scene, shard))?;
        }
        let actions = self.workers[w].tasks.stored(task, shard);
        self.workers[w].act(actions);
        Ok(())
    }

    fn check_scene(&mut self, w: usize, task: TaskId) {
        let Some(scene) = self.scene_of(w, task) else {
            return;
        };
        let all = self.store.has_all(scene) && !self.has(Mistake::NeverTheLast);
        let done = !all && self.has_tuple(scene);
        let tasks = &mut self.workers[w].tasks;
        let actions =
            if done { tasks.done_elsewhere(task) } else { tasks.scene_checked(task, all) };
        self.workers[w].act(actions);
    }

    fn gather(&mut self, w: usize, task: TaskId) {
        let Some(scene) = self.scene_of(w, task) else {
            return;
        };
        let there = self.found(scene);
        let nothing = self.has(Mistake::GathersNothing);
        let worker = &mut self.workers[w];
        let results = worker.results.entry(task).or_default();
        for shard in there {
            results.insert(shard, digest(scene, shard));
        }
        let mut missing: Vec<u32> = (0..SHARDS).collect();
        missing.retain(|shard| !results.contains_key(shard));
        if nothing {
            results.pop_last();
        }
        let actions = worker.tasks.gathered(task, &missing);
        worker.act(actions);
        if !missing.is_empty() {
            self.note(|| format!("gone: {missing:?}"));
        }
    }

    /// Removing what is left of the scene is the machine's word.
    fn merge(&mut self, w: usize, task: TaskId) -> Result<(), String> {
        let Some(scene) = self.scene_of(w, task) else {
            return Ok(());
        };
        if !self.workers[w].tasks.has(task) {
            return Ok(());
        }
        let results = self.workers[w].results.remove(&task).unwrap_or_default();
        self.store.put_tuple(scene, &results)?;
        let actions = self.workers[w].tasks.merged(task);
        self.workers[w].act(actions);
        Ok(())
    }

    /// The first of some actions; the others follow as a job of their own.
    fn act(&mut self, w: usize, mut actions: VecDeque<Action>) {
        if self.has(Mistake::FinishesFirst) {
            let is_finish = |action: &Action| matches!(action, Action::Finish { .. });
            actions.make_contiguous().sort_by_key(|action| !is_finish(action));
        }
        let Some(action) = actions.pop_front() else {
            return;
        };
        match action {
            Action::Store { task, shards } => {
                for shard in shards {
                    if self.has(Mistake::StoredTooEarly) {
                        let early = self.workers[w].tasks.stored(task, shard);
                        self.workers[w].act(early);
                    }
                    self.workers[w].jobs.push(Job::Put(task, shard));
                }
            }
            Action::Merge { task } => {
                if self.has(Mistake::RemovesPartialsFirst)
                    && let Some(scene) = self.scene_of(w, task)
                {
                    self.store.partials.retain(|(s, _), _| *s != scene);
                }
                self.workers[w].jobs.push(Job::Merge(task));
            }
            Action::CheckScene { task } => self.workers[w].jobs.push(Job::Check(task)),
            Action::Gather { task } => self.workers[w].jobs.push(Job::Gather(task)),
            Action::LeaveNote { .. } | Action::Quarantine { .. } => {}
            Action::RemovePartials { scene } => {
                self.store.partials.retain(|(s, _), _| *s != scene);
            }
            Action::ForgetAttempt { task, n } => {
                let record = (task.scene, task.shards.start, task.shards.end, n);
                if !self.has(Mistake::KeepsRecords) {
                    self.store.attempts.remove(&record);
                }
            }
            Action::Publish { messages } => {
                if !self.has(Mistake::NeverPublishes) {
                    let mut open = BTreeSet::new();
                    for message in messages {
                        let publication = self.workers[w].publication();
                        open.insert(publication);
                        self.packets.push(Packet::Publish(publication, message));
                    }
                    self.workers[w].jobs.push(Job::Publishes(open, actions));
                    return;
                }
            }
            Action::Finish { lease } => self.packets.push(Packet::Acknowledge(lease as u32)),
        }
        if !actions.is_empty() {
            self.workers[w].jobs.push(Job::Act(actions));
        }
    }

    /// The queue has a message.
    pub(super) fn confirmed(&mut self, publication: Publication) {
        let worker = &mut self.workers[publication.worker];
        let is_it = |job: &Job| match job {
            Job::Publishes(open, _) => open.contains(&publication),
            Job::Offers(offer, ..) => *offer == publication,
            _ => false,
        };
        let Some(k) = worker.jobs.iter().position(is_it) else {
            return;
        };
        match worker.jobs.swap_remove(k) {
            Job::Publishes(mut open, actions) => {
                open.remove(&publication);
                let next =
                    if open.is_empty() { Job::Act(actions) } else { Job::Publishes(open, actions) };
                worker.jobs.push(next);
            }
            Job::Offers(_, task, shards) => {
                let actions = worker.tasks.donated(task, shards);
                worker.act(actions);
            }
            _ => {}
        }
    }

    /// Another worker is idle.
    pub(super) fn donate(&mut self, w: usize) {
        if self.workers[w].stops {
            return;
        }
        for offer in self.workers[w].tasks.offers(COSTS, None) {
            self.note(|| format!("worker {w} offers {offer:?}"));
            let worker = &mut self.workers[w];
            let publication = worker.publication();
            let (task, shards) = (offer.task, offer.shards());
            worker.jobs.push(Job::Offers(publication, task, shards.clone()));
            self.packets.push(Packet::Publish(publication, offer.message));
            if self.has(Mistake::LeavesBeforeConfirmed) {
                let actions = self.workers[w].tasks.donated(task, shards);
                self.workers[w].act(actions);
            }
        }
    }

    /// It does not wait for confirmations any more; what should have come after them is not done.
    pub(super) fn give_up_waiting(&mut self, w: usize) {
        self.workers[w].jobs.retain(|job| !job.waits());
    }

    /// It finishes what it has begun.
    pub(super) fn stop(&mut self, w: usize) {
        self.note(|| format!("worker {w} stops"));
        let worker = &mut self.workers[w];
        worker.stops = true;
        worker.tasks.stop();
        let actions = worker.tasks.store_all();
        worker.act(actions);
    }

    /// It leaves, whatever its threads were about to do.
    pub(super) fn leave(&mut self, w: usize) {
        self.note(|| format!("worker {w} leaves"));
        self.disown(w);
        let worker = &mut self.workers[w];
        (worker.stops, worker.leaves) = (true, true);
        worker.jobs.clear();
        let actions = worker.tasks.requeue_all();
        worker.act(actions);
    }

    /// One of its threads never returns: it leaves the rest to others.
    pub(super) fn hang(&mut self, w: usize) {
        self.note(|| format!("worker {w} hangs"));
        self.disown(w);
        let worker = &mut self.workers[w];
        (worker.stops, worker.leaves) = (true, true);
        worker.jobs.clear();
        let actions = worker.tasks.requeue_waiting();
        worker.act(actions);
    }

    pub(super) fn crash(&mut self, w: usize) {
        self.note(|| format!("worker {w} crashes"));
        self.replace(w);
    }

    fn replace(&mut self, w: usize) {
        self.workers[w] = Worker::new(w, self.workers[w].incarnation + 1);
    }

    /// The records that this worker has now may stay: its jobs end somewhere.
    fn disown(&mut self, w: usize) {
        for (owner, incarnation) in self.store.attempts.values_mut() {
            if *owner == w {
                *incarnation = u32::MAX;
            }
        }
    }
}
