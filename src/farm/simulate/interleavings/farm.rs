//! The farm around the workers (queue, store, network, coordinator), the steps, and the checks of `mod.rs`'s promises.

use super::super::case::mix;
use super::super::queue::{Delivered, Queue, Sequence};
use super::Mistake;
use super::worker::{Job, Step, Worker};
use crate::farm::queue::{Lease, Message};
use crate::farm::worker::tasks::Time;
use crate::run::Task;
use std::collections::{BTreeMap, BTreeSet};

pub(super) const SCENES: u32 = 2;
pub(super) const SHARDS: u32 = 5;
const WORKERS: usize = 3;

/// A packet between a worker and the queue. Its number identifies the publication.
#[derive(Clone, Debug)]
pub(super) enum Packet {
    Publish(u64, Message),
    /// Confirms that the queue has the message; true if the message is new.
    Confirm(u64, bool),
    Acknowledge(Sequence),
}

/// The digest of a result, and the worker that made it.
pub(super) type Made = (u64, u32);

/// The results in the store as digests, the records of attempts, and the history of puts.
#[derive(Default)]
pub(super) struct Store {
    pub(super) partials: BTreeMap<(u32, u32), Made>,
    pub(super) tuples: BTreeMap<u32, u64>,
    /// The makers of each tuple's partials, and those that its receipts name.
    makers: BTreeMap<u32, BTreeSet<u32>>,
    receipts: BTreeMap<u32, BTreeSet<u32>>,
    /// Records of attempts, each with the worker that must remove it, if any worker must.
    pub(super) attempts: BTreeMap<[u32; 4], Option<u32>>,
    /// Partials that were put at any time.
    put: BTreeSet<(u32, u32)>,
}

impl Store {
    /// Returns the scene's shards with a partial in the store.
    pub(super) fn found(&self, scene: u32) -> Vec<u32> {
        self.partials.range((scene, 0)..(scene + 1, 0)).map(|(&(_, shard), _)| shard).collect()
    }

    /// Puts a partial, unless the store has it.
    pub(super) fn put_partial(&mut self, at: (u32, u32), made: Made) -> Result<(), String> {
        self.put.insert(at);
        let there = self.partials.entry(at).or_insert(made).0;
        if there == made.0 { Ok(()) } else { Err(format!("the bytes of partial {at:?} changed")) }
    }

    /// Puts the receipt of a worker that merges these partials, unless the tuple is complete.
    pub(super) fn put_receipt(&mut self, scene: u32, makers: BTreeSet<u32>) {
        self.receipts.entry(scene).or_default().extend(makers);
    }

    pub(super) fn put_tuple(
        &mut self,
        scene: u32,
        from: &BTreeMap<u32, Made>,
    ) -> Result<(), String> {
        if from.len() != SHARDS as usize {
            return Err(format!("the tuple of scene {scene} is made from {:?}", from.keys()));
        }
        let digest = from.values().fold(0, |all, made| mix(all ^ made.0));
        let makers = || from.values().map(|made| made.1).collect();
        self.makers.entry(scene).or_insert_with(makers);
        let there = *self.tuples.entry(scene).or_insert(digest);
        if there == digest { Ok(()) } else { Err(format!("the bytes of tuple {scene} changed")) }
    }

    /// Returns a tuple and a maker of its partials that no receipt names.
    fn unnamed(&self) -> Option<(u32, u32)> {
        let none = BTreeSet::new();
        self.makers.iter().find_map(|(scene, makers)| {
            let named = self.receipts.get(scene).unwrap_or(&none);
            makers.difference(named).next().map(|maker| (*scene, *maker))
        })
    }

    pub(super) fn remove_partials(&mut self, scene: u32) {
        self.partials.retain(|(of, _), _| *of != scene);
    }
}

pub(super) fn digest(scene: u32, shard: u32) -> u64 {
    mix(u64::from(scene) << 32 | u64::from(shard))
}

/// Returns the key of an attempt's record.
pub(super) fn record(task: &Task, n: u32) -> [u32; 4] {
    [task.scene, task.shards.start, task.shards.end, n]
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
    /// Last number given to a publication or a worker.
    last_number: u64,
    /// Scenes that had no message when the coordinator listed the queue.
    absent: Vec<u32>,
    queue_is_reliable: bool,
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
            workers: Vec::new(),
            packets: Vec::new(),
            last_number: 0,
            absent: Vec::new(),
            queue_is_reliable: true,
        };
        farm.workers = (0..WORKERS).map(|_| Worker::new(farm.number() as u32)).collect();
        farm.reconcile();
        farm
    }

    /// Returns a random number below `limit`.
    pub(super) fn draw(&mut self, limit: usize) -> usize {
        self.drawn += 1;
        (mix(self.seed ^ mix(self.drawn)) % limit.max(1) as u64) as usize
    }

    pub(super) fn number(&mut self) -> u64 {
        self.last_number += 1;
        self.last_number
    }

    pub(super) fn note(&mut self, text: impl FnOnce() -> String) {
        if let Some(log) = &mut self.log {
            log.push(text());
        }
    }

    pub(super) fn log(&mut self) -> String {
        self.log.take().unwrap_or_default().join("\n")
    }

    /// Does one step and checks promises 2, 3 and 5. With every fourth seed, the queue may lose or resurrect messages.
    pub(super) fn step(&mut self) -> Result<(), String> {
        self.now += Time::from_millis(1);
        let w = self.draw(WORKERS);
        let kinds = if self.seed % 4 == 3 { 103 } else { 100 };
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
            93 => self.leave(w, false),
            94 => self.leave(w, true),
            95 | 96 => self.workers[w].give_up_waiting(),
            97 => self.list_queue(),
            98 | 99 => self.publish_missing(),
            100 => {
                self.note(|| "the queue is created again".to_owned());
                self.queue.wipe();
                self.queue_is_reliable = false;
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
        let worker = &mut self.workers[w];
        if let Some(task) = worker.tasks.lease(&lease, self.now) {
            worker.jobs.push(Job::Step(task, Step::Examine(lease)));
        }
    }

    /// Takes a random packet from the network, or copies one.
    fn packet(&mut self, copy: bool) -> Option<Packet> {
        if self.packets.is_empty() {
            return None;
        }
        let k = self.draw(self.packets.len());
        Some(if copy { self.packets[k].clone() } else { self.packets.swap_remove(k) })
    }

    /// Delivers a random packet, or a copy of one.
    fn network(&mut self, copy: bool) {
        let packet = self.packet(copy);
        self.note(|| format!("arrives: {packet:?}"));
        match packet {
            Some(Packet::Publish(number, message)) => {
                let is_new = self.queue.publish(&message);
                self.packets.push(Packet::Confirm(number, is_new));
            }
            Some(Packet::Confirm(number, is_new)) => {
                let finishes = is_new || self.mistake == Some(Mistake::FinishesRefused);
                for worker in &mut self.workers {
                    worker.confirmed(number, finishes);
                }
            }
            Some(Packet::Acknowledge(sequence)) => {
                self.queue.acknowledge(sequence);
            }
            None => {}
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
            self.note(|| format!("{sequence} reappears (never delivered: {zombie})"));
            self.queue.resurrect(sequence, zombie);
            self.queue_is_reliable = false;
        }
    }

    /// Lists the queue, and clears a queue that has messages but delivers none. The coordinator lists the queue before
    /// the store, so that it does not publish a scene that is finished in between.
    fn list_queue(&mut self) {
        if self.queue.waiting() + self.queue.held() == 0 && self.queue.len() > 0 {
            self.queue.wipe();
        }
        self.absent = (0..SCENES).filter(|&scene| self.queue.ranges(scene).is_empty()).collect();
    }

    fn publish_missing(&mut self) {
        for scene in std::mem::take(&mut self.absent) {
            if !self.store.tuples.contains_key(&scene) {
                self.note(|| format!("the coordinator publishes scene {scene}"));
                let task = Task { scene, shards: 0..SHARDS };
                self.queue.publish(&Message { task, hops: 0 });
            }
        }
    }

    fn reconcile(&mut self) {
        self.list_queue();
        self.publish_missing();
    }

    /// Checks promises 2, 3 and 5.
    fn check(&self) -> Result<(), String> {
        if let Some((scene, maker)) = self.store.unnamed() {
            return Err(format!("no receipt of scene {scene} names worker {maker}"));
        }
        let has_tuple = |scene| self.store.tuples.contains_key(&scene);
        let has_partial = |at| self.store.partials.contains_key(&at);
        let lost = |at: &&(u32, u32)| !has_tuple(at.0) && !has_partial(**at);
        if let Some((scene, shard)) = self.store.put.iter().find(lost) {
            return Err(format!("shard {shard} of scene {scene} was stored and is lost"));
        }
        if !self.queue_is_reliable {
            return Ok(());
        }
        for scene in (0..SCENES).filter(|&scene| !has_tuple(scene)) {
            let ranges = self.queue.ranges(scene);
            if ranges.is_empty() {
                return Err(format!("scene {scene} has no message"));
            }
            let is_safe = |shard| {
                has_partial((scene, shard)) || ranges.iter().any(|range| range.contains(&shard))
            };
            if let Some(shard) = (0..SHARDS).find(|&shard| !is_safe(shard)) {
                return Err(format!("shard {shard} of scene {scene} has no partial or message"));
            }
        }
        Ok(())
    }

    /// Checks promise 4: without further faults, and with a turn for every worker, packet and lease, all work is done.
    pub(super) fn finish_fairly(&mut self) -> Result<(), String> {
        for _ in 0..60 {
            let is_done = self.store.tuples.len() == SCENES as usize
                && self.queue.waiting() + self.queue.held() == 0
                && self.packets.is_empty()
                && self.workers.iter().all(|w| w.tasks.is_empty() && w.jobs.is_empty());
            if is_done {
                let ids: Vec<u32> = self.workers.iter().map(|worker| worker.id).collect();
                let left = |owner: &Option<u32>| owner.is_some_and(|owner| ids.contains(&owner));
                return match self.store.attempts.iter().find(|(_, owner)| left(owner)) {
                    Some(record) => Err(format!("a live worker leaves the record {record:?}")),
                    None => Ok(()),
                };
            }
            for w in 0..WORKERS {
                self.lease(w);
            }
            self.work_until_idle()?;
            for w in 0..WORKERS {
                // Jobs still wait for confirmations that were lost.
                self.workers[w].give_up_waiting();
                if self.workers[w].stops {
                    self.leave(w, false);
                }
            }
            self.work_until_idle()?;
            // No worker will finish the remaining leases: for example, a worker is gone or an acknowledgement was lost.
            for sequence in self.queue.all_held() {
                self.queue.expire(sequence, u64::MAX);
            }
            self.reconcile();
        }
        Err(format!("some work remains; scenes {:?} have tuples", self.store.tuples.keys()))
    }

    fn work_until_idle(&mut self) -> Result<(), String> {
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
                // Moves the clock past the checkpoint, so that partials in memory are written.
                self.now += Time::from_secs(1);
                return Ok(());
            }
        }
        Err("the workers never become idle".to_owned())
    }
}
