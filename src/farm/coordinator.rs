//! The coordinator: it keeps all missing scenes in the queue, and ends the run.
//!
//! It has no state of its own. Starting, resuming and taking over from another coordinator are the same loop: poll the queue,
//! then the store, and publish the scenes that are in neither. Several may run at once, for publishing twice changes nothing.

use super::error::FarmError;
use super::queue::{Message, QueueError, QueueKeeper, QueueState};
use super::round::{Carried, Decision, QueuePoll, Round, decide};
use super::share::share_run;
use super::sweep::sweep_staged;
use super::tuples::remove_partials;
use super::worker::whole;
use crate::run::{AccessError, Control, ControlState, Event, Run, Scope, Snapshot, keys};
use crate::store::Store;
use std::collections::BTreeSet;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

pub struct CoordinateOptions<'a> {
    /// Set from outside to end.
    pub stop: &'a AtomicBool,
    /// Shortest time between two rounds.
    pub every: Duration,
    /// A status page shows the run and its workers.
    pub watched: bool,
}

/// The coordinator's view of the run, for the status page.
#[derive(Debug)]
pub struct Watch {
    pub snapshot: Snapshot,
    pub queue: QueueState,
    /// The reason for which the queue does not answer.
    pub queue_lost: Option<String>,
}

impl Watch {
    pub fn new(run: &Run) -> Self {
        Self {
            snapshot: Snapshot::new(run, Scope::DONE),
            queue: QueueState::default(),
            queue_lost: None,
        }
    }
}

#[derive(Debug)]
pub struct Coordinated {
    pub snapshot: Snapshot,
    pub published: u64,
    /// Ended by `stop`.
    pub stopped: bool,
    /// Ended because the run is cancelled.
    pub cancelled: bool,
}

/// A pause is at least this many times as long as a round.
const PAUSE_ROUNDS: u32 = 20;
/// Between two full rounds, if nothing makes one due before.
const FULL_EVERY: Duration = Duration::from_mins(10);
/// Between two reports that queue or store are away.
const COMPLAIN: Duration = Duration::from_secs(30);

/// Polls and publishes until every scene is done or in quarantine. `watch` is kept up to date.
pub fn coordinate(
    run: &Run,
    store: &Store,
    queue: &dyn QueueKeeper,
    options: &CoordinateOptions,
    watch: &Mutex<Watch>,
    on_event: &(dyn Fn(Event) + Sync),
) -> Result<Coordinated, FarmError> {
    share_run(run, store)?;
    on_event(Event::Started { shards: run.lines.len() as u64, scenes: run.lines.len() as u64 });
    let scope = Scope { workers: options.watched, ..Scope::DONE };
    let coordinator = Coordinator {
        run,
        store,
        queue,
        options,
        watch,
        on_event,
        snapshot: Snapshot::new(run, scope),
        told: vec![false; run.lines.len()],
        first: true,
        control: Control::default(),
        published: 0,
        last_full: Instant::now(),
        queue_complained: None,
        store_complained: None,
    };
    coordinator.coordinate()
}

struct Coordinator<'a> {
    run: &'a Run,
    store: &'a Store,
    queue: &'a dyn QueueKeeper,
    options: &'a CoordinateOptions<'a>,
    watch: &'a Mutex<Watch>,
    on_event: &'a (dyn Fn(Event) + Sync),
    snapshot: Snapshot,
    /// Scenes that it has reported as done.
    told: Vec<bool>,
    /// It is in its first round, so done scenes were done before.
    first: bool,
    control: Control,
    published: u64,
    last_full: Instant,
    queue_complained: Option<Instant>,
    store_complained: Option<Instant>,
}

impl Coordinator<'_> {
    fn coordinate(mut self) -> Result<Coordinated, FarmError> {
        let mut carried = Carried { due: true, was_quiet: false };
        let mut took_before = Duration::ZERO;
        loop {
            let start = Instant::now();
            let full = carried.due || self.last_full.elapsed() > FULL_EVERY;
            let (queue, taken_back) = match self.poll(full) {
                Ok(found) => found,
                Err(error) => {
                    self.wait_for_store(error)?;
                    if self.must_stop() {
                        return Ok(self.ended(true));
                    }
                    continue;
                }
            };
            self.store_complained = None;
            self.tell_done();
            let missing: Vec<usize> = self.snapshot.missing().collect();
            let round = Round {
                full,
                queue: queue.as_ref().ok(),
                missing: &missing,
                taken_back,
                control: self.snapshot.control.state,
            };
            let (decision, after) = decide(&round, carried);
            carried = after;
            if decision == Decision::Verify {
                continue;
            }
            self.tell(&queue, decision == Decision::Finish);
            if decision != Decision::Finish && self.must_stop() {
                return Ok(self.ended(true));
            }
            match decision {
                Decision::Finish => break,
                Decision::Cancel => {
                    // A queue that stays does no harm: no worker leases from it.
                    let _ = self.queue.remove();
                    return Ok(self.ended(false));
                }
                Decision::Publish { purge, scenes } => {
                    carried.due |= !self.publish(purge, &scenes);
                }
                Decision::Wait | Decision::Verify => {}
            }
            // The shorter of the last two rounds counts, so that one slow answer of a server causes no long pause.
            let took = start.elapsed();
            self.pause(self.options.every.max(took.min(took_before) * PAUSE_ROUNDS));
            took_before = took;
        }
        while let Err(error) = self.finish() {
            self.wait_for_store(error)?;
            if self.must_stop() {
                return Ok(self.ended(true));
            }
        }
        Ok(self.ended(false))
    }

    /// Polls the queue before the store: a scene that leaves the queue in between has its tuple by then. The second result is
    /// whether a tuple or a quarantine record was removed.
    fn poll(&mut self, full: bool) -> Result<(Result<QueuePoll, QueueError>, bool), FarmError> {
        let queue = self.poll_queue(full);
        let taken_back = if full {
            self.snapshot.refresh(self.run, self.store)?;
            false
        } else {
            self.snapshot.refresh_news(self.run, self.store)?
        };
        Ok((queue, taken_back))
    }

    fn poll_queue(&self, full: bool) -> Result<QueuePoll, QueueError> {
        let other = self.queue.ensure()?;
        let state = self.queue.state()?;
        let scenes = if full { self.queue.scenes()? } else { BTreeSet::new() };
        Ok(QueuePoll { state, other, scenes })
    }

    fn tell_done(&mut self) {
        let run = self.run;
        for scene in 0..run.lines.len() {
            if !self.snapshot.is_done(scene) || std::mem::replace(&mut self.told[scene], true) {
                continue;
            }
            (self.on_event)(Event::ShardDone { resumed: self.first });
            let scene = run.lines[scene].id.clone();
            (self.on_event)(Event::SceneMerged { scene, miss_share: 0.0 });
        }
        self.first = false;
    }

    /// Updates `watch`, and reports a change of control and a queue that is away.
    fn tell(&mut self, queue: &Result<QueuePoll, QueueError>, finished: bool) {
        if self.options.watched {
            let mut watch = self.watch.lock().expect("no holder of this lock panics");
            watch.snapshot = self.snapshot.clone();
            watch.queue_lost = queue.as_ref().err().map(QueueError::to_string);
            if let Ok(queue) = queue {
                watch.queue = queue.state;
            }
        }
        let now = &self.snapshot.control;
        if std::mem::replace(&mut self.control, now.clone()) != *now {
            let Control { state, reason } = now.clone();
            (self.on_event)(Event::Controlled { state, reason });
        }
        match queue {
            _ if finished => {}
            Ok(_) => self.queue_complained = None,
            Err(error) => self.complain(error),
        }
    }

    /// False if the queue is away.
    fn publish(&mut self, purge: bool, scenes: &[usize]) -> bool {
        let messages: Vec<Message> = scenes.iter().map(|&s| whole(self.run, s)).collect();
        let purged = if purge { self.queue.purge() } else { Ok(()) };
        match purged.and_then(|()| self.queue.publish(&messages)) {
            Ok(()) => {
                self.published += messages.len() as u64;
                self.last_full = Instant::now();
                true
            }
            Err(error) => {
                self.complain(&error);
                false
            }
        }
    }

    fn must_stop(&self) -> bool {
        self.options.stop.load(Ordering::Relaxed)
    }

    fn pause(&self, time: Duration) {
        let until = Instant::now() + time;
        while Instant::now() < until && !self.must_stop() {
            std::thread::sleep(Duration::from_millis(20).min(time));
        }
    }

    fn complain(&mut self, error: &QueueError) {
        if is_due(&mut self.queue_complained) {
            let reason = error.to_string();
            (self.on_event)(Event::QueueLost { reason });
        }
    }

    /// Reports that the store is away, and waits a little; returns any other error.
    fn wait_for_store(&mut self, error: FarmError) -> Result<(), FarmError> {
        let FarmError::Access(AccessError::Store(error)) = error else {
            return Err(error);
        };
        if !error.is_passing() {
            return Err(error.into());
        }
        if is_due(&mut self.store_complained) {
            let reason = error.to_string();
            (self.on_event)(Event::StoreLost { reason });
        }
        std::thread::sleep(self.options.every);
        Ok(())
    }

    fn ended(self, stopped: bool) -> Coordinated {
        let is_cancelled = self.snapshot.control.state == ControlState::Cancelled;
        Coordinated {
            published: self.published,
            stopped,
            cancelled: is_cancelled && !self.snapshot.is_finished(),
            snapshot: self.snapshot,
        }
    }

    /// Removes the partials and attempts of done scenes. Failures do no harm.
    fn clear_away(&self) {
        let (run, store, snapshot) = (self.run, self.store, &self.snapshot);
        let done = || (0..run.lines.len()).filter(|&scene| snapshot.is_done(scene));
        if store.is_local() {
            done().for_each(|scene| remove_partials(store, &run.lines[scene]));
            return;
        }
        let done: BTreeSet<&str> = done().map(|scene| run.lines[scene].id.as_str()).collect();
        for folder in [keys::PARTIALS, keys::ATTEMPTS] {
            let mut left = store.list(folder).unwrap_or_default();
            left.retain(|key| key.split('/').nth(1).is_some_and(|id| done.contains(id)));
            let _ = store.delete(&left);
        }
    }

    /// Marks the run as finished, and removes objects that are not needed any more.
    fn finish(&self) -> Result<(), FarmError> {
        let (run, store) = (self.run, self.store);
        self.clear_away();
        sweep_staged(run, store);
        let quarantined = self.snapshot.counts().quarantined.len();
        let note = serde_json::json!({
            "schema": "glasshouse.finished/1",
            "scenes": run.lines.len(),
            "quarantined": quarantined,
        });
        store.replace(keys::FINISHED, format!("{note}\n").as_bytes())?;
        // A queue that stays does no harm: the run is over.
        let _ = self.queue.remove();
        Ok(())
    }
}

/// At the first complaint, and some time after the last one.
fn is_due(complained: &mut Option<Instant>) -> bool {
    let due = complained.is_none_or(|at| at.elapsed() > COMPLAIN);
    if due {
        *complained = Some(Instant::now());
    }
    due
}
