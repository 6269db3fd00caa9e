//! The farm around the workers: store, clock, coordinator, the steps, and the checks of `mod.rs`'s promises.

use super::super::case::mix;
use super::Mistake;
use super::queue::{Holder, Queue};
use super::worker::Worker;
use crate::farm::message::{read_delivered, read_subject, write_subject};
use crate::farm::queue::{Listed, Message, QueueState, write_message};
use crate::farm::round::{Carried, Decision, QueuePoll, Round, decide};
use crate::farm::stall::{LISTS_PER_LEASE, StallWatch, queued, unlisted};
use crate::farm::worker::tasks::Time;
use crate::run::{AttemptRecord, ControlState, Task};
use glasshouse_line::ids::SceneId;
use std::collections::hash_map::DefaultHasher;
use std::collections::{BTreeMap, BTreeSet};
use std::hash::{Hash as _, Hasher as _};

pub(super) const SHARDS: u32 = 4;
pub(super) const RUN: [u8; 8] = *b"the run!";
pub(super) const LEASE: Time = Time::from_millis(40);
const WORKERS: usize = 5;
/// Real deaths of workers. Four could put a healthy scene into quarantine.
const KILLS: u32 = 3;

#[derive(Default)]
pub(super) struct Store {
    pub(super) partials: BTreeSet<(u32, u32)>,
    pub(super) tuples: BTreeSet<u32>,
    pub(super) attempts: Vec<Attempt>,
}

pub(super) struct Attempt {
    pub(super) record: AttemptRecord,
    /// Time of the last sign of life.
    pub(super) signed: Time,
    /// Time at which another worker marked the attempt as lost.
    pub(super) marked: Option<Time>,
}

impl Store {
    pub(super) fn found(&self, scene: u32) -> Vec<u32> {
        self.partials.range((scene, 0)..(scene + 1, 0)).map(|&(_, shard)| shard).collect()
    }

    fn evidence(&self, scene: u32, id: &SceneId) -> u64 {
        let mut hasher = DefaultHasher::new();
        self.found(scene).len().hash(&mut hasher);
        for attempt in self.attempts.iter().filter(|attempt| attempt.record.scene == *id) {
            let record = &attempt.record;
            (record.shards, record.n, attempt.signed, attempt.marked).hash(&mut hasher);
        }
        hasher.finish()
    }
}

pub(super) struct Farm {
    seed: u64,
    drawn: u64,
    pub(super) mistake: Option<Mistake>,
    log: Option<Vec<String>>,
    pub(super) now: Time,
    /// Number of shards of each scene, and its id.
    pub(super) shards: [u32; 2],
    pub(super) ids: [SceneId; 2],
    pub(super) queue: Queue,
    pub(super) store: Store,
    pub(super) workers: Vec<Worker>,
    last_worker: u32,
    kills: u32,
    /// Messages that the adversary knows.
    pub(super) forged: Vec<(String, Vec<u8>)>,
    carried: Carried,
    stalls: StallWatch,
    next_list: Time,
    is_finished: bool,
    /// Time since which no worker works at a scene and no readable message of it waits.
    abandoned: BTreeMap<u32, Time>,
}

impl Farm {
    pub(super) fn new(seed: u64, mistake: Option<Mistake>, log: bool) -> Self {
        let id = |name: &str| SceneId::new(name).expect("a plain name is an id");
        let mut farm = Self {
            seed,
            drawn: 0,
            mistake,
            log: log.then(Vec::new),
            now: Time::ZERO,
            // A scene of one shard and one of several.
            shards: [1, SHARDS],
            ids: [id("a"), id("b")],
            queue: Queue::default(),
            store: Store::default(),
            workers: Vec::new(),
            last_worker: 0,
            kills: 0,
            forged: Vec::new(),
            carried: Carried { due: true, was_quiet: false },
            stalls: StallWatch::default(),
            next_list: Time::ZERO,
            is_finished: false,
            abandoned: BTreeMap::new(),
        };
        for _ in 0..WORKERS {
            let worker = farm.new_worker();
            farm.workers.push(worker);
        }
        farm.coordinate();
        farm
    }

    fn new_worker(&mut self) -> Worker {
        self.last_worker += 1;
        Worker::new(self.last_worker)
    }

    /// Returns a random number below `limit`.
    pub(super) fn draw(&mut self, limit: usize) -> usize {
        self.drawn += 1;
        (mix(self.seed ^ mix(self.drawn)) % limit.max(1) as u64) as usize
    }

    pub(super) fn note(&mut self, text: impl FnOnce() -> String) {
        if let Some(log) = &mut self.log {
            log.push(format!("{:4} ms: {}", self.now.as_millis(), text()));
        }
    }

    pub(super) fn log(&mut self) -> String {
        self.log.take().unwrap_or_default().join("\n")
    }

    pub(super) fn hostile_step(&mut self) -> Result<(), String> {
        let w = self.draw(WORKERS);
        match self.draw(20) {
            0..7 => self.act_as_adversary(),
            7 if self.kills < KILLS => {
                self.kills += 1;
                self.note(|| format!("worker {w} is killed"));
                self.workers[w] = self.new_worker();
            }
            8 => {
                // A shard that takes longer than the loss of a silent worker; the lease keeper works on.
                self.note(|| format!("worker {w} is slow"));
                self.workers[w].busy_until = self.now + 4 * LEASE;
            }
            9 => self.pass(LEASE / 2),
            10 if self.workers[w].sleeps_until <= self.now => {
                // A busy machine or store. Silence is noticed after two leases, and ends before two more.
                self.note(|| format!("the lease keeper of worker {w} sleeps"));
                self.workers[w].sleeps_until = self.now + LEASE * 7 / 2;
            }
            _ => self.work(w)?,
        }
        self.pass(Time::from_millis(1));
        Ok(())
    }

    /// Lets time pass in small steps: leases end, lease keepers renew and sign, the coordinator lists.
    fn pass(&mut self, time: Time) {
        let step = Time::from_millis(5).min(time);
        let end = self.now + time;
        while self.now < end {
            self.now += step;
            for worker in self.workers.iter_mut().filter(|w| w.sleeps_until <= self.now) {
                for kept in self.queue.kept.values_mut() {
                    if kept.holder == Holder::Worker(worker.id) {
                        kept.lease_end = self.now + LEASE;
                    }
                }
                let signs = self.mistake != Some(Mistake::GivesNoSign);
                if signs && self.now.saturating_sub(worker.signed) >= LEASE {
                    worker.signed = self.now;
                    let name = worker.id.to_string();
                    let own = self.store.attempts.iter_mut().filter(|a| a.record.worker == name);
                    own.for_each(|attempt| attempt.signed = self.now);
                }
            }
            self.queue.expire(self.now);
            self.coordinate();
        }
    }

    fn listed(&self) -> BTreeMap<u32, Vec<Listed>> {
        let delivered = self.queue.kept.values().filter(|kept| kept.deliveries > 0);
        let delivered = delivered.map(|kept| kept.number).max().unwrap_or(0);
        let mut listed: BTreeMap<u32, Vec<Listed>> = BTreeMap::new();
        for kept in self.queue.kept.values() {
            let Some(message) = read_subject(&kept.subject, &self.shards) else { continue };
            let is_good = read_delivered(&kept.subject, &kept.bytes, RUN, &self.shards).is_ok();
            let is_readable = is_good || self.mistake == Some(Mistake::BelievesSubjects);
            let waits = kept.number > delivered;
            listed.entry(message.task.scene).or_default().push(Listed {
                message,
                waits,
                is_readable,
            });
        }
        listed
    }

    fn coordinate(&mut self) {
        if self.now < self.next_list || self.is_finished {
            return;
        }
        self.next_list = self.now + LEASE / LISTS_PER_LEASE;
        let listed = self.listed();
        let missing: Vec<usize> =
            (0..self.shards.len()).filter(|s| !self.store.tuples.contains(&(*s as u32))).collect();
        let scenes = missing.iter().filter_map(|&scene| {
            let of = listed.get(&(scene as u32))?;
            of.iter().find(|listed| listed.is_readable)?;
            Some((scene as u32, self.shards[scene], of.as_slice()))
        });
        let mut stalled = BTreeSet::new();
        for scene in self.stalls.observe(self.now, LEASE, scenes) {
            let evidence = self.store.evidence(scene, &self.ids[scene as usize]);
            let stands = self.stalls.judge(self.now, LEASE, scene, evidence);
            let looks =
                !matches!(self.mistake, Some(Mistake::IgnoresHolders | Mistake::BelievesSubjects));
            if stands && looks {
                self.note(|| format!("scene {scene} stands still"));
                stalled.insert(scene as usize);
            }
        }
        let held = |kept: &&super::queue::Kept| kept.holder != Holder::Nobody;
        let held = self.queue.kept.values().filter(held).count() as u64;
        let waiting = self.queue.kept.len() as u64 - held;
        let state = QueueState { waiting, held };
        let poll = QueuePoll { state, other: false, scenes: Some(queued(&listed)) };
        let round = Round {
            full: self.carried.due,
            queue: Some(&poll),
            missing: &missing,
            stalled: &stalled,
            taken_back: false,
            control: ControlState::Running,
        };
        let (decision, after) = decide(&round, self.carried);
        self.carried = after;
        match decision {
            Decision::Finish => self.is_finished = true,
            Decision::Publish { purge, scenes } => {
                if purge {
                    self.queue.kept.clear();
                }
                for scene in scenes {
                    let there = listed.get(&(scene as u32)).map_or(&[][..], Vec::as_slice);
                    self.publish(scene, there);
                }
            }
            Decision::Verify | Decision::Cancel | Decision::Wait => {}
        }
    }

    fn publish(&mut self, scene: usize, there: &[Listed]) {
        let task = Task { scene: scene as u32, shards: 0..self.shards[scene] };
        let ignores = self.mistake == Some(Mistake::IgnoresTakenSubjects);
        let there: Vec<Listed> =
            there.iter().filter(|listed| listed.is_readable || !ignores).cloned().collect();
        let message = unlisted(Message { task, hops: 0 }, &there);
        self.note(|| format!("the coordinator publishes {message:?}"));
        self.queue.publish(write_subject(&message), write_message(RUN, &message));
    }

    /// True if a worker works at a task of the scene, or a readable message of it waits.
    fn is_served(&self, scene: u32) -> bool {
        // A worker goes on with a task whose message the adversary has removed.
        let holds = |worker: &Worker| {
            worker.tasks.attempts().iter().any(|(_, task, _)| task.scene == scene)
        };
        let waits = |kept: &super::queue::Kept| {
            let there = read_delivered(&kept.subject, &kept.bytes, RUN, &self.shards);
            kept.holder == Holder::Nobody && there.is_ok_and(|m| m.task.scene == scene)
        };
        self.workers.iter().any(holds) || self.queue.kept.values().any(waits)
    }

    /// Checks promises 2 to 4. The adversary acts no more, but holds its messages and renews their leases.
    pub(super) fn finish_fairly(&mut self) -> Result<(), String> {
        self.note(|| "the adversary only holds its messages now".to_owned());
        self.abandoned.clear();
        let last_act = self.now;
        self.workers.iter_mut().for_each(|worker| worker.sleeps_until = self.now);
        while !self.is_finished || self.now < last_act + 5 * LEASE {
            for w in 0..WORKERS {
                self.work(w)?;
            }
            self.pass(Time::from_millis(1));
            for scene in 0..self.shards.len() as u32 {
                if self.store.tuples.contains(&scene) || self.is_served(scene) {
                    self.abandoned.remove(&scene);
                    continue;
                }
                let since = *self.abandoned.entry(scene).or_insert(self.now);
                if self.now.saturating_sub(since) > 3 * LEASE {
                    return Err(format!("scene {scene} is not published again for three leases"));
                }
            }
            if self.now > last_act + 100 * LEASE {
                return Err(format!("the run does not end; tuples: {:?}", self.store.tuples));
            }
        }
        let unreadable = |kept: &&super::queue::Kept| {
            kept.holder != Holder::Adversary
                && read_delivered(&kept.subject, &kept.bytes, RUN, &self.shards).is_err()
        };
        match self.queue.kept.values().find(unreadable) {
            Some(kept) => Err(format!("an unreadable message remains: {kept:?}")),
            None if self.store.tuples.len() == self.shards.len() => Ok(()),
            None => Err(format!("the run ended with the tuples {:?}", self.store.tuples)),
        }
    }
}
