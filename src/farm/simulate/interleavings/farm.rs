//! The farm: queue, store, network, coordinator; and the choice of the next step.

use super::super::case::mix;
use super::super::queue::{Delivered, Queue, Sequence};
use super::Mistake;
use super::worker::{Job, Publication, Worker};
use crate::farm::queue::{Lease, Message};
use crate::farm::worker::tasks::{TaskId, Time};
use crate::run::Task;
use std::collections::{BTreeMap, BTreeSet};

pub(super) const SCENES: u32 = 2;
pub(super) const SHARDS: u32 = 5;
const WORKERS: usize = 3;

/// On its way between a worker and the queue.
#[derive(Clone, Debug)]
pub(super) enum Packet {
    Publish(Publication, Message),
    Confirm(Publication),
    Acknowledge(Sequence),
}

/// Scene, first shard, one past the last, number.
pub(super) type Record = (u32, u32, u32, u32);

/// What is in the store: digests by what they are of.
#[derive(Default)]
pub(super) struct Store {
    pub(super) partials: BTreeMap<(u32, u32), u64>,
    pub(super) tuples: BTreeMap<u32, u64>,
    /// Records of attempts, and whose they are: worker and incarnation.
    pub(super) attempts: BTreeMap<Record, (usize, u32)>,
    /// Partials that were there once.
    stored: BTreeSet<(u32, u32)>,
}

impl Store {
    pub(super) fn has_all(&self, scene: u32) -> bool {
        (0..SHARDS).all(|shard| self.partials.contains_key(&(scene, shard)))
    }

    pub(super) fn put_partial(
        &mut self,
        scene: u32,
        shard: u32,
        digest: u64,
    ) -> Result<(), String> {
        self.stored.insert((scene, shard));
        put(&mut self.partials, (scene, shard), digest)
    }

    /// Of the shards that the tuple is made from.
    pub(super) fn put_tuple(
        &mut self,
        scene: u32,
        from: &BTreeMap<u32, u64>,
    ) -> Result<(), String> {
        if from.len() != SHARDS as usize {
            return Err(format!("the tuple of scene {scene} is made from {:?}", from.keys()));
        }
        put(&mut self.tuples, scene, from.values().fold(0, |all, digest| mix(all ^ digest)))
    }
}

fn put<K: Ord + std::fmt::Debug>(
    to: &mut BTreeMap<K, u64>,
    key: K,
    digest: u64,
) -> Result<(), String> {
    let text = format!("{key:?}");
    let there = *to.entry(key).or_insert(digest);
    if there == digest { Ok(()) } else { Err(format!("other bytes for {text}")) }
}

/// What tracing a shard results in.
pub(super) fn digest(scene: u32, shard: u32) -> u64 {
    mix(u64::from(scene) << 32 | u64::from(shard))
}

pub(super) struct Farm {
    seed: u64,
    drawn: u64,
    pub(super) mistake: Option<Mistake>,
    log: Option<Vec<String>>,
    pub(super) now: Time,
    queue: Queue,
    pub(super) store: Store,
    pub(super) workers: Vec<Worker>,
    pub(super) packets: Vec<Packet>,
    /// Scenes without a message when the coordinator listed the queue.
    absent: Option<Vec<u32>>,
    queue_kept_its_word: bool,
}

impl Farm {
    pub(super) fn new(seed: u64, mistake: Option<Mistake>, log: bool) -> Self {
        let mut farm = Self {
            seed,
            drawn: 0,
            mistake,
            log: log.then(Vec::new),
            now: Time::ZERO,
            queue: Queue::new(SCENES),
            store: Store::default(),
            workers: (0..WORKERS).map(|w| Worker::new(w, 0)).collect(),
            packets: Vec::new(),
            absent: None,
            queue_kept_its_word: true,
        };
        farm.list_queue();
        farm.publish_missing();
        farm
    }

    /// A random number below `limit`.
    pub(super) fn draw(&mut self, limit: usize) -> usize {
        self.drawn += 1;
        (mix(self.seed ^ mix(self.drawn)) % limit.max(1) as u64) as usize
    }

    pub(super) fn note(&mut self, text: impl FnOnce() -> String) {
        if let Some(log) = &mut self.log {
            log.push(text());
        }
    }

    pub(super) fn log(&mut self) -> String {
        self.log.take().unwrap_or_default().join("\n")
    }

    pub(super) fn has(&self, mistake: Mistake) -> bool {
        self.mistake == Some(mistake)
    }

    /// One step, and what must hold after it.
    pub(super) fn step(&mut self, queue_faults: bool) -> Result<(), String> {
        self.now += Time::from_millis(1);
        let w = self.draw(WORKERS);
        let kinds = if queue_faults { 103 } else { 100 };
        match self.draw(kinds) {
            0..8 => self.lease(w),
            8..58 => self.work(w)?,
            58..64 => self.donate(w),
            64..84 => self.network(false),
            84 | 85 => self.network(true),
            86 | 87 => {
                let lost = self.packet(false);
                self.note(|| format!("lost: {lost:?}"));
            }
            88..91 => self.lease_ends(),
            91 => self.crash(w),
            92 => self.stop(w),
            93 => self.leave(w),
            94 => self.hang(w),
            95 | 96 => self.give_up_waiting(w),
            97 => self.list_queue(),
            98 | 99 => self.publish_missing(),
            100 => {
                self.note(|| "the queue is made anew".to_owned());
                self.queue.wipe();
                self.queue_kept_its_word = false;
            }
            _ => self.resurrect(),
        }
        self.check()
    }

    fn lease(&mut self, w: usize) {
        if self.workers[w].stops {
            return;
        }
        let Some(Delivered { sequence, message, again }) = self.queue.take(0) else {
            return;
        };
        self.note(|| format!("worker {w} leases {sequence}: {message:?}"));
        let lease = Lease { id: u64::from(sequence), message, redelivered: again };
        let now = self.now;
        let worker = &mut self.workers[w];
        if let Some(task) = worker.tasks.lease(&lease, now) {
            worker.jobs.push(Job::Examine(task, lease));
        }
    }

    /// A packet that is on its way, taken out or copied.
    fn packet(&mut self, copy: bool) -> Option<Packet> {
        if self.packets.is_empty() {
            return None;
        }
        let k = self.draw(self.packets.len());
        Some(if copy { self.packets[k].clone() } else { self.packets.swap_remove(k) })
    }

    fn network(&mut self, copy: bool) {
        if let Some(packet) = self.packet(copy) {
            self.arrive(packet);
        }
    }

    fn arrive(&mut self, packet: Packet) {
        self.note(|| format!("arrives: {packet:?}"));
        match packet {
            Packet::Publish(publication, message) => {
                // Refused because it is there already: as good as published.
                self.queue.publish(&message);
                self.packets.push(Packet::Confirm(publication));
            }
            Packet::Confirm(publication) => self.confirmed(publication),
            Packet::Acknowledge(sequence) => {
                self.queue.acknowledge(sequence);
            }
        }
    }

    fn lease_ends(&mut self) {
        let held = self.queue.all_held();
        if !held.is_empty() {
            let sequence = held[self.draw(held.len())];
            self.note(|| format!("the lease of {sequence} ends"));
            self.queue.expire(sequence, u64::MAX);
        }
    }

    fn resurrect(&mut self) {
        let gone = self.queue.all_gone();
        if !gone.is_empty() {
            let sequence = gone[self.draw(gone.len())];
            let zombie = self.draw(2) == 0;
            self.note(|| format!("{sequence} comes back (never delivered: {zombie})"));
            self.queue.resurrect(sequence, zombie);
            self.queue_kept_its_word = false;
        }
    }

    /// The coordinator: the queue first, so that what is finished between the two listings is seen as finished. No worker
    /// will get what is left in a quiet queue.
    fn list_queue(&mut self) {
        if self.queue.waiting() + self.queue.held() == 0 && self.queue.len() > 0 {
            self.queue.wipe();
        }
        let absent = (0..SCENES).filter(|&scene| self.queue.ranges(scene).is_empty());
        self.absent = Some(absent.collect());
    }

    fn publish_missing(&mut self) {
        for scene in self.absent.take().unwrap_or_default() {
            if !self.store.tuples.contains_key(&scene) {
                self.note(|| format!("the coordinator publishes scene {scene}"));
                let task = Task { scene, shards: 0..SHARDS };
                self.queue.publish(&Message { task, hops: 0 });
            }
        }
    }

    /// Promises 2 and 3.
    fn check(&self) -> Result<(), String> {
        for &(scene, shard) in &self.store.stored {
            let there = self.store.tuples.contains_key(&scene)
                || self.store.partials.contains_key(&(scene, shard));
            if !there {
                return Err(format!("shard {shard} of scene {scene} was stored and is lost"));
            }
        }
        if !self.queue_kept_its_word {
            return Ok(());
        }
        for scene in (0..SCENES).filter(|scene| !self.store.tuples.contains_key(scene)) {
            let ranges = self.queue.ranges(scene);
            if ranges.is_empty() {
                return Err(format!("scene {scene} has no owner"));
            }
            let is_safe = |shard: u32| {
                self.store.partials.contains_key(&(scene, shard))
                    || ranges.iter().any(|range| range.contains(&shard))
            };
            if let Some(shard) = (0..SHARDS).find(|&shard| !is_safe(shard)) {
                return Err(format!("shard {shard} of scene {scene} has no owner"));
            }
        }
        Ok(())
    }

    /// Promise 4: faults end, everything gets its turn.
    pub(super) fn finish_fairly(&mut self) -> Result<(), String> {
        for _ in 0..60 {
            let is_done = self.store.tuples.len() == SCENES as usize
                && self.queue.waiting() + self.queue.held() == 0
                && self.packets.is_empty()
                && self.workers.iter().all(|w| w.tasks.is_empty() && w.jobs.is_empty());
            if is_done {
                return self.check_records();
            }
            for w in 0..WORKERS {
                self.lease(w);
            }
            self.settle()?;
            for w in 0..WORKERS {
                // Its confirmation was lost.
                self.give_up_waiting(w);
                if self.workers[w].stops {
                    self.leave(w);
                }
            }
            self.settle()?;
            // Messages whose holder is gone.
            for sequence in self.queue.all_held() {
                self.queue.expire(sequence, u64::MAX);
            }
            self.list_queue();
            self.publish_missing();
        }
        Err(format!("not finished: tuples of {:?}", self.store.tuples.keys()))
    }

    /// Until no worker has anything to do.
    fn settle(&mut self) -> Result<(), String> {
        for _ in 0..10_000 {
            while !self.packets.is_empty() {
                self.network(false);
            }
            for w in 0..WORKERS {
                self.now += Time::from_millis(1);
                self.work(w)?;
            }
            self.check()?;
            let is_busy = |w: &Worker| w.jobs.iter().any(|job| !job.waits());
            if self.packets.is_empty() && !self.workers.iter().any(is_busy) {
                // Nothing is put off for ever: what waits in memory is written in the end.
                let now = self.now + Time::from_secs(1);
                self.now = now;
                return Ok(());
            }
        }
        Err("the workers never rest".to_owned())
    }

    fn check_records(&self) -> Result<(), String> {
        let is_alive =
            |&(w, incarnation): &(usize, u32)| self.workers[w].incarnation == incarnation;
        match self.store.attempts.iter().find(|(_, owner)| is_alive(owner)) {
            Some((record, owner)) => Err(format!("{owner:?} leaves the record {record:?}")),
            None => Ok(()),
        }
    }

    /// The record of an attempt under the next free number.
    pub(super) fn record(&mut self, w: usize, task: &Task) -> u32 {
        let key = |n| (task.scene, task.shards.start, task.shards.end, n);
        let attempts = &self.store.attempts;
        let n = (1..u32::MAX).find(|&n| !attempts.contains_key(&key(n))).unwrap_or(1);
        let owner = (w, self.workers[w].incarnation);
        self.store.attempts.insert(key(n), owner);
        n
    }

    /// What the store has of a task's scene.
    pub(super) fn found(&self, scene: u32) -> Vec<u32> {
        let of = self.store.partials.keys().filter(|(s, _)| *s == scene);
        of.map(|(_, shard)| *shard).collect()
    }

    pub(super) fn has_tuple(&self, scene: u32) -> bool {
        self.store.tuples.contains_key(&scene)
    }

    pub(super) fn job_of(&mut self, w: usize) -> Option<Job> {
        let ready: Vec<usize> =
            (0..self.workers[w].jobs.len()).filter(|&k| !self.workers[w].jobs[k].waits()).collect();
        let k = *ready.get(self.draw(ready.len()))?;
        Some(self.workers[w].jobs.swap_remove(k))
    }

    /// The scene of a task that a worker has.
    pub(super) fn scene_of(&self, w: usize, task: TaskId) -> Option<u32> {
        self.workers[w].tasks.task(task).map(|leased| leased.scene)
    }
}
