//! The coordinator: it keeps everything that is not done in the queue, and ends the run.
//!
//! It has no state of its own. Starting, resuming and taking over from another coordinator are the same loop: look at
//! the queue, then at the store, publish what is in neither. Any number may run at once, for publishing twice does
//! nothing and merging twice makes the same bytes.

use super::error::FarmError;
use super::queue::{Message, QueueError, QueueKeeper, QueueState};
use super::round::{Carried, Decision, QueueLook, Round, decide};
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
    /// Shortest time between two looks.
    pub every: Duration,
    /// A page shows which worker does what.
    pub watched: bool,
}

/// What a coordinator knows, for the status page.
#[derive(Debug)]
pub struct Watch {
    pub snapshot: Snapshot,
    /// The queue, when it answered last.
    pub queue: QueueState,
    /// Why the queue does not answer, if it does not.
    pub queue_lost: Option<String>,
}

impl Watch {
    /// Before the first round.
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
    /// The run at the end.
    pub snapshot: Snapshot,
    pub published: u64,
    /// Ended by `stop`.
    pub stopped: bool,
    /// Ended because the run is cancelled.
    pub cancelled: bool,
}

/// A look must not cost more than a twentieth of the time.
const LOOK_SHARE: u32 = 20;
/// Between two looks at everything, if nothing makes one due before.
const EVERYTHING: Duration = Duration::from_mins(10);
/// Between two complaints about a queue that is away.
const COMPLAIN: Duration = Duration::from_secs(30);

/// Looks and publishes until every scene is done or in quarantine. `watch` is kept up to date.
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
        looked_at_all: Instant::now(),
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
    /// Scenes of which it has told that they are done.
    told: Vec<bool>,
    /// It has not looked yet: what is done was done before.
    first: bool,
    control: Control,
    published: u64,
    looked_at_all: Instant,
    queue_complained: Option<Instant>,
    store_complained: Option<Instant>,
}

/// What a look at queue and store found.
struct Looked {
    queue: Result<QueueLook, QueueError>,
    taken_back: bool,
}

impl Coordinator<'_> {
    fn coordinate(mut self) -> Result<Coordinated, FarmError> {
        let mut carried = Carried { due: true, was_quiet: false };
        let mut took_before = Duration::ZERO;
        loop {
            let start = Instant::now();
            let everything = carried.due || self.looked_at_all.elapsed() > EVERYTHING;
            let looked = match self.look(everything) {
                Ok(looked) => looked,
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
                everything,
                queue: looked.queue.as_ref().ok(),
                missing: &missing,
                taken_back: looked.taken_back,
                control: self.snapshot.control.state,
            };
            let (decision, after) = decide(&round, carried);
            carried = after;
            if decision == Decision::LookAtEverything {
                continue;
            }
            self.tell(&looked, decision == Decision::Finish);
            if decision != Decision::Finish && self.must_stop() {
                return Ok(self.ended(true));
            }
            match decision {
                Decision::Finish => break,
                Decision::Cancel => {
                    // One that cannot be removed does no harm: no worker takes from it.
                    let _ = self.queue.remove();
                    return Ok(self.ended(false));
                }
                Decision::Publish { purge, scenes } => {
                    carried.due |= !self.publish(purge, &scenes);
                }
                Decision::Wait | Decision::LookAtEverything => {}
            }
            // One look that waited for a server must not cost twenty times that: what the shorter of the last two took
            // counts.
            let took = start.elapsed();
            self.pause(self.options.every.max(took.min(took_before) * LOOK_SHARE));
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

    /// First the queue, then the store: a scene that leaves the queue in between has its tuple by then.
    fn look(&mut self, everything: bool) -> Result<Looked, FarmError> {
        let queue = self.look_at_queue(everything);
        let taken_back = if everything {
            self.snapshot.refresh(self.run, self.store)?;
            false
        } else {
            self.snapshot.refresh_news(self.run, self.store)?
        };
        Ok(Looked { queue, taken_back })
    }

    fn look_at_queue(&self, everything: bool) -> Result<QueueLook, QueueError> {
        let other = self.queue.ensure()?;
        let state = self.queue.look()?;
        let scenes = if everything { self.queue.scenes()? } else { BTreeSet::new() };
        Ok(QueueLook { state, other, scenes })
    }

    /// Tells of each scene once that it is done.
    fn tell_done(&mut self) {
        let run = self.run;
        for scene in 0..run.lines.len() {
            if !self.snapshot.is_done(scene) || std::mem::replace(&mut self.told[scene], true) {
                continue;
            }
            (self.on_event)(Event::ShardDone { resumed: self.first });
            (self.on_event)(Event::SceneMerged {
                scene: run.lines[scene].id.clone(),
                miss_share: 0.0,
            });
        }
        self.first = false;
    }

    /// Brings `watch` up to date, and tells of a change of control and of a queue that is away.
    fn tell(&mut self, looked: &Looked, finished: bool) {
        if self.options.watched {
            let mut watch = self.watch.lock().expect("no holder of this lock panics");
            watch.snapshot = self.snapshot.clone();
            watch.queue_lost = looked.queue.as_ref().err().map(QueueError::to_string);
            if let Ok(queue) = &looked.queue {
                watch.queue = queue.state;
            }
        }
        let told_to = &self.snapshot.control;
        if std::mem::replace(&mut self.control, told_to.clone()) != *told_to {
            (self.on_event)(Event::Controlled {
                state: told_to.state,
                reason: told_to.reason.clone(),
            });
        }
        match &looked.queue {
            _ if finished => {}
            Ok(_) => self.queue_complained = None,
            Err(error) => self.complain(error),
        }
    }

    /// False if the queue cannot be told.
    fn publish(&mut self, purge: bool, scenes: &[usize]) -> bool {
        let messages: Vec<Message> = scenes.iter().map(|&s| whole(self.run, s)).collect();
        let purged = if purge { self.queue.purge() } else { Ok(()) };
        match purged.and_then(|()| self.queue.publish(&messages)) {
            Ok(()) => {
                self.published += messages.len() as u64;
                self.looked_at_all = Instant::now();
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
        let last = &mut self.queue_complained;
        if last.is_none_or(|at| at.elapsed() > COMPLAIN) {
            *last = Some(Instant::now());
            let reason = error.to_string();
            (self.on_event)(Event::QueueLost { reason });
        }
    }

    /// Says that the store is away, and waits a little; any other error stays one.
    fn wait_for_store(&mut self, error: FarmError) -> Result<(), FarmError> {
        let FarmError::Access(AccessError::Store(error)) = error else {
            return Err(error);
        };
        if !error.is_passing() {
            return Err(error.into());
        }
        let last = &mut self.store_complained;
        if last.is_none_or(|at| at.elapsed() > COMPLAIN) {
            *last = Some(Instant::now());
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

    /// Removes what is left of scenes that are done. What cannot be removed does no harm.
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

    /// Says that the run is over, and clears away what is not needed any more.
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
        // A queue that cannot be removed does no harm: its messages are of a run that is over.
        let _ = self.queue.remove();
        Ok(())
    }
}
