//! A worker of the small farm: the real state machine, and jobs that each take a step.

use super::Mistake;
use super::farm::{Farm, Made, Packet, SHARDS, digest, record};
use crate::farm::queue::Lease;
use crate::farm::worker::costs::Costs;
use crate::farm::worker::tasks::{Action, TaskId, Tasks, Time};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::ops::Range;

/// Time that partials stay in memory only; a step takes 1 ms.
const CHECKPOINT: Time = Time::from_millis(25);

const COSTS: Costs = Costs { shard_s: 1.0, threads: 1.0, load_s: 0.1, load_is_known: true };

/// A pending operation of a worker's thread.
#[derive(Clone, Debug)]
pub(super) enum Job {
    /// A step of a task, ignored once the task has ended.
    Step(TaskId, Step),
    Donated(TaskId, Range<u32>),
    Act(VecDeque<Action>),
    /// A job that waits until these publications are confirmed.
    Confirmed(BTreeSet<u64>, Box<Job>),
}

#[derive(Clone, Debug)]
pub(super) enum Step {
    Examine(Lease),
    Load,
    /// The scene is loaded, with the shards that were found in the store.
    Loaded(Vec<u32>),
    Sandbox,
    Begin(u32),
    Trace(u32),
    Put(u32),
    /// Compares the worker's partial with that of another maker, which another worker may remove before.
    Compare(u32),
    CheckScene,
    Gather,
    Receipt,
    Merge,
}

impl Job {
    pub(super) fn waits(&self) -> bool {
        matches!(self, Self::Confirmed(open, _) if !open.is_empty())
    }
}

pub(super) struct Worker {
    pub(super) id: u32,
    pub(super) tasks: Tasks<()>,
    pub(super) jobs: Vec<Job>,
    /// True if the worker leases no task and starts no shard any more.
    pub(super) stops: bool,
    /// True if another worker replaces this one when its jobs are done.
    leaves: bool,
    results: BTreeMap<TaskId, BTreeMap<u32, Made>>,
}

impl Worker {
    pub(super) fn new(id: u32) -> Self {
        Self {
            id,
            tasks: Tasks::new(CHECKPOINT),
            jobs: Vec::new(),
            stops: false,
            leaves: false,
            results: BTreeMap::new(),
        }
    }

    fn act(&mut self, actions: Vec<Action>) {
        if !actions.is_empty() {
            self.jobs.push(Job::Act(actions.into()));
        }
    }

    /// Handles a confirmation. Without `finishes`, the lease that the message replaces is not finished.
    pub(super) fn confirmed(&mut self, number: u64, finishes: bool) {
        for job in &mut self.jobs {
            if let Job::Confirmed(open, then) = job
                && open.remove(&number)
                && !finishes
                && let Job::Act(actions) = &mut **then
                && let Some(Action::Finish { .. }) = actions.front()
            {
                actions.pop_front();
            }
        }
    }

    /// Drops the jobs that wait for a confirmation.
    pub(super) fn give_up_waiting(&mut self) {
        self.jobs.retain(|job| !job.waits());
    }
}

impl Farm {
    /// Does a random job of a worker, or replaces a leaving worker without jobs.
    pub(super) fn work(&mut self, w: usize) -> Result<(), String> {
        let jobs = &self.workers[w].jobs;
        let ready: Vec<usize> = (0..jobs.len()).filter(|&k| !jobs[k].waits()).collect();
        if ready.is_empty() {
            if self.workers[w].leaves && self.workers[w].jobs.is_empty() {
                self.workers[w] = Worker::new(self.number() as u32);
            }
            return Ok(());
        }
        let k = ready[self.draw(ready.len())];
        let mut job = self.workers[w].jobs.swap_remove(k);
        if let Job::Confirmed(_, then) = job {
            job = *then;
        }
        self.note(|| format!("worker {w}: {job:?}"));
        let worker = &mut self.workers[w];
        match job {
            Job::Step(task, step) => {
                if let Some(scene) = worker.tasks.scene(task) {
                    return self.advance(w, task, scene, step);
                }
            }
            Job::Donated(task, shards) => {
                let actions = worker.tasks.donated(task, shards);
                worker.act(actions);
            }
            Job::Act(actions) => self.act(w, actions),
            Job::Confirmed(..) => {}
        }
        Ok(())
    }

    fn advance(&mut self, w: usize, task: TaskId, scene: u32, step: Step) -> Result<(), String> {
        let now = self.now;
        let found = self.store.found(scene);
        let worker = &mut self.workers[w];
        let results = worker.results.entry(task).or_default();
        let mut next = Vec::new();
        let actions = match step {
            Step::Examine(lease) => {
                self.examine(w, task, &lease);
                return Ok(());
            }
            Step::Load => {
                // The store is listed now; the partials arrive in the next step.
                if worker.tasks.load(task, now) {
                    next.push(Step::Loaded(found));
                }
                Vec::new()
            }
            Step::Loaded(mut listed) => {
                // If the scene was merged meanwhile, its partials are gone.
                listed.retain(|shard| found.contains(shard));
                let there =
                    |&shard: &u32| Some((shard, *self.store.partials.get(&(scene, shard))?));
                results.extend(listed.iter().filter_map(there));
                let actions = worker.tasks.loaded(task, SHARDS, &listed, ());
                next.extend(worker.tasks.waiting(task).into_iter().map(Step::Begin));
                actions
            }
            Step::Sandbox => return self.sandbox(w, task, scene),
            Step::Begin(shard) => {
                if worker.tasks.begin(task, shard) {
                    next.push(Step::Trace(shard));
                }
                Vec::new()
            }
            Step::Trace(shard) => {
                results.insert(shard, (digest(scene, shard), worker.id));
                worker.tasks.traced(task, shard, now)
            }
            Step::Put(shard) => return self.put(w, task, (scene, shard)),
            Step::Compare(shard) => return self.compare(w, task, (scene, shard)),
            Step::CheckScene => {
                let all = found.len() == SHARDS as usize;
                let all = all && self.mistake != Some(Mistake::NeverTheLast);
                if !all && self.store.tuples.contains_key(&scene) {
                    worker.tasks.done_elsewhere(task)
                } else {
                    worker.tasks.scene_checked(task, all)
                }
            }
            Step::Gather => {
                let there =
                    |&shard: &u32| Some((shard, *self.store.partials.get(&(scene, shard))?));
                let missing = found.iter().filter(|shard| !results.contains_key(shard));
                let fetched: Vec<(u32, Made)> = missing.filter_map(there).collect();
                results.extend(fetched);
                let missing = (0..SHARDS).filter(|shard| !results.contains_key(shard));
                let missing: Vec<u32> = missing.collect();
                if self.mistake == Some(Mistake::GathersNothing) {
                    results.pop_last();
                }
                let actions = worker.tasks.gathered(task, &missing);
                if !missing.is_empty() {
                    self.note(|| format!("gone: {missing:?}"));
                }
                actions
            }
            Step::Receipt => {
                let mut makers = BTreeSet::from([worker.id]);
                if self.mistake != Some(Mistake::NamesOnlyItself) {
                    makers.extend(results.values().map(|made| made.1));
                }
                let is_late = self.mistake == Some(Mistake::ReceiptLast);
                if is_late || !self.store.tuples.contains_key(&scene) {
                    self.store.put_receipt(scene, makers);
                }
                if is_late {
                    worker.tasks.merged(task)
                } else {
                    next.push(Step::Merge);
                    Vec::new()
                }
            }
            Step::Merge => {
                self.store.put_tuple(scene, results)?;
                if self.mistake == Some(Mistake::ReceiptLast) {
                    next.push(Step::Receipt);
                    Vec::new()
                } else {
                    worker.tasks.merged(task)
                }
            }
        };
        let worker = &mut self.workers[w];
        worker.act(actions);
        worker.jobs.extend(next.into_iter().map(|step| Job::Step(task, step)));
        Ok(())
    }

    /// Puts a partial, or finds that of another maker.
    fn put(&mut self, w: usize, task: TaskId, at: (u32, u32)) -> Result<(), String> {
        let worker = &mut self.workers[w];
        if self.store.partials.get(&at).is_some_and(|made| made.1 != worker.id) {
            worker.jobs.push(Job::Step(task, Step::Compare(at.1)));
            return Ok(());
        }
        self.store.put_partial(at, (digest(at.0, at.1), worker.id))?;
        let actions = worker.tasks.stored(task, at.1);
        worker.act(actions);
        Ok(())
    }

    fn compare(&mut self, w: usize, task: TaskId, at: (u32, u32)) -> Result<(), String> {
        let worker = &mut self.workers[w];
        match self.store.partials.get(&at) {
            Some(made) if made.0 == digest(at.0, at.1) => {
                let actions = worker.tasks.stored(task, at.1);
                worker.act(actions);
            }
            None if self.mistake != Some(Mistake::GoneIsOther) => {
                worker.jobs.push(Job::Step(task, Step::Put(at.1)));
            }
            there => return Err(format!("partial {at:?} differs: {there:?}")),
        }
        Ok(())
    }

    fn examine(&mut self, w: usize, task: TaskId, lease: &Lease) {
        let leased = &lease.message.task;
        let suspect = lease.redelivered && self.draw(2) == 0;
        let worker = &mut self.workers[w];
        if self.store.tuples.contains_key(&leased.scene) {
            let actions = worker.tasks.nothing_to_do(task);
            return worker.act(actions);
        }
        if suspect && !worker.tasks.pin(task) {
            return;
        }
        // The record of the attempt gets the next free number.
        let attempts = &mut self.store.attempts;
        let n = (1..u32::MAX).find(|&n| !attempts.contains_key(&record(leased, n))).unwrap_or(1);
        if worker.tasks.attempted(task, n) {
            attempts.insert(record(leased, n), Some(worker.id));
            let step = if suspect { Step::Sandbox } else { Step::Load };
            worker.jobs.push(Job::Step(task, step));
        }
    }

    /// Traces the task's whole scene in a child process, loses the child, or stops it.
    fn sandbox(&mut self, w: usize, task: TaskId, scene: u32) -> Result<(), String> {
        let fate = self.draw(3);
        if !self.workers[w].tasks.sandbox(task, self.now) {
            return Ok(());
        }
        if fate == 1 {
            self.disown(w);
        }
        let worker = &mut self.workers[w];
        let actions = match fate {
            0 => {
                let id = worker.id;
                let all = (0..SHARDS).map(|shard| (shard, (digest(scene, shard), id))).collect();
                if !self.store.tuples.contains_key(&scene) {
                    self.store.put_receipt(scene, BTreeSet::from([id]));
                }
                self.store.put_tuple(scene, &all)?;
                worker.tasks.nothing_to_do(task)
            }
            1 => worker.tasks.retry(task),
            _ => worker.tasks.requeue(task),
        };
        worker.act(actions);
        Ok(())
    }

    /// Performs the first action. The others follow as a separate job.
    fn act(&mut self, w: usize, mut actions: VecDeque<Action>) {
        if self.mistake == Some(Mistake::FinishesFirst) {
            let is_finish = |action: &Action| matches!(action, Action::Finish { .. });
            actions.make_contiguous().sort_by_key(|action| !is_finish(action));
        }
        let Some(action) = actions.pop_front() else {
            return;
        };
        let mut open = BTreeSet::new();
        let worker = &mut self.workers[w];
        let mut then = |task, step| worker.jobs.push(Job::Step(task, step));
        match action {
            Action::Store { task, shards } => {
                for &shard in &shards {
                    then(task, Step::Put(shard));
                }
                if self.mistake == Some(Mistake::StoredTooEarly) {
                    for shard in shards {
                        let actions = worker.tasks.stored(task, shard);
                        worker.act(actions);
                    }
                }
            }
            Action::Merge { task } => {
                let is_late = self.mistake == Some(Mistake::ReceiptLast);
                then(task, if is_late { Step::Merge } else { Step::Receipt });
                if self.mistake == Some(Mistake::RemovesPartialsFirst)
                    && let Some(scene) = worker.tasks.scene(task)
                {
                    self.store.remove_partials(scene);
                }
            }
            Action::CheckScene { task } => then(task, Step::CheckScene),
            Action::Gather { task } => then(task, Step::Gather),
            Action::Quarantine { .. } => {}
            Action::RemovePartials { scene } => self.store.remove_partials(scene),
            Action::ForgetAttempt { task, n } => {
                if self.mistake != Some(Mistake::KeepsRecords) {
                    self.store.attempts.remove(&record(&task, n));
                }
            }
            Action::Replace { lease, messages } => {
                if self.mistake != Some(Mistake::NeverPublishes) {
                    for message in messages {
                        let number = self.number();
                        open.insert(number);
                        self.packets.push(Packet::Publish(number, message));
                    }
                }
                actions.push_front(Action::Finish { lease });
                if self.mistake == Some(Mistake::FinishesFirst) {
                    open.clear();
                }
            }
            Action::Finish { lease } => self.packets.push(Packet::Acknowledge(lease as u32)),
        }
        if !actions.is_empty() {
            self.workers[w].jobs.push(Job::Confirmed(open, Box::new(Job::Act(actions))));
        }
    }

    /// Offers shards to an idle worker, and gives them up after the confirmation.
    pub(super) fn donate(&mut self, w: usize) {
        if self.workers[w].stops {
            return;
        }
        for offer in self.workers[w].tasks.offers(COSTS, None) {
            self.note(|| format!("worker {w} offers {offer:?}"));
            let number = self.number();
            let donated = Job::Donated(offer.task, offer.shards());
            let early = self.mistake == Some(Mistake::LeavesBeforeConfirmed);
            let open = BTreeSet::from_iter((!early).then_some(number));
            self.workers[w].jobs.push(Job::Confirmed(open, Box::new(donated)));
            self.packets.push(Packet::Publish(number, offer.message));
        }
    }

    /// Stops a worker, which finishes the shards that it has started.
    pub(super) fn stop(&mut self, w: usize) {
        self.note(|| format!("worker {w} stops"));
        let worker = &mut self.workers[w];
        worker.stops = true;
        worker.tasks.stop();
        let actions = worker.tasks.store_all();
        worker.act(actions);
    }

    /// Ends a worker's threads and requeues its tasks, or only its queued and pinned tasks if it `hangs`.
    pub(super) fn leave(&mut self, w: usize, hangs: bool) {
        self.note(|| format!("worker {w} leaves (hangs: {hangs})"));
        self.disown(w);
        let worker = &mut self.workers[w];
        (worker.stops, worker.leaves) = (true, true);
        worker.jobs.clear();
        let tasks = &mut worker.tasks;
        let actions = if hangs { tasks.requeue_waiting() } else { tasks.requeue_all() };
        worker.act(actions);
    }

    pub(super) fn crash(&mut self, w: usize) {
        self.note(|| format!("worker {w} crashes"));
        self.workers[w] = Worker::new(self.number() as u32);
    }

    /// Exempts a worker from removing its attempt records, because its jobs may be cut off.
    fn disown(&mut self, w: usize) {
        let id = self.workers[w].id;
        for owner in self.store.attempts.values_mut().filter(|owner| **owner == Some(id)) {
            *owner = None;
        }
    }
}
