//! The coordinator publishes missing scenes to the queue and finishes the run.
//!
//! It keeps no state: to start, to resume or to take over from another coordinator, it runs the same loop, which polls
//! the queue, then the store, and publishes the missing scenes that are not in the queue. Several may run at once.

use super::error::FarmError;
use super::queue::{Listed, Message, QueueError, QueueKeeper, QueueState};
use super::round::{Carried, Decision, QueuePoll, Round, decide};
use super::share::share_run;
use super::stall::{LISTS_PER_LEASE, StallWatch, queued, unlisted};
use super::sweep::sweep_staged;
use super::tuples::remove_partials;
use super::worker::whole;
use crate::run::{AccessError, Control, ControlState, Event, Run, Scope, Snapshot, evidence, keys};
use crate::store::Store;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

pub struct CoordinateOptions<'a> {
    /// True once the caller wants the coordinator to stop.
    pub stop: &'a AtomicBool,
    /// Shortest time between two rounds.
    pub every: Duration,
    /// Duration of a lease.
    pub lease: Duration,
    /// True if a status page shows the run and its workers.
    pub watched: bool,
}

/// The coordinator's view of the run, for the status page.
#[derive(Debug, Default)]
pub struct Watch {
    pub snapshot: Snapshot,
    pub queue: QueueState,
    /// Error of the last poll of the queue, if it failed.
    pub queue_lost: Option<String>,
    /// Number of changes of the control state by the status page.
    control_changes: u64,
}

impl Watch {
    /// Shows a control state that the status page has stored, before the next poll finds it.
    pub fn set_control(&mut self, state: ControlState) {
        self.snapshot.control = Control { state, reason: None };
        self.control_changes += 1;
    }

    /// Replaces the snapshot. Ignores the control state of a poll that began before the page's last change, because it
    /// may be older than the change.
    fn update(&mut self, snapshot: Snapshot, changes_before_poll: u64) {
        let changed = self.control_changes != changes_before_poll;
        let control = changed.then(|| std::mem::take(&mut self.snapshot.control));
        self.snapshot = snapshot;
        if let Some(control) = control {
            self.snapshot.control = control;
        }
    }

    pub fn new(run: &Run) -> Self {
        Self { snapshot: Snapshot::new(run, Scope::DONE), ..Self::default() }
    }
}

#[derive(Debug)]
pub struct Coordinated {
    pub snapshot: Snapshot,
    pub published: u64,
    /// True if [`CoordinateOptions::stop`] ended the coordinator.
    pub stopped: bool,
    /// True if the run was cancelled before every scene was done or in quarantine.
    pub cancelled: bool,
}

/// Shortest pause after a round, as a multiple of the shorter duration of the last two rounds.
const PAUSE_ROUNDS: u32 = 20;
/// Longest time between two full rounds; events may require an earlier one.
const FULL_EVERY: Duration = Duration::from_mins(10);
/// Shortest time between two reports that the queue, or the store, cannot be reached.
const COMPLAIN: Duration = Duration::from_secs(30);

/// Polls and publishes until every scene is done or in quarantine, the run is cancelled, or the caller requests a stop.
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
        start: Instant::now(),
        last_listed: Instant::now(),
        listed: BTreeMap::new(),
        stalls: StallWatch::default(),
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
    /// True for each scene that was reported as done.
    told: Vec<bool>,
    /// True during the first round, which finds scenes that earlier processes completed.
    first: bool,
    control: Control,
    published: u64,
    last_full: Instant,
    start: Instant,
    last_listed: Instant,
    /// The queue's messages of each scene, as last listed.
    listed: BTreeMap<u32, Vec<Listed>>,
    stalls: StallWatch,
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
            let changes = self.watch.lock().expect("no holder of this lock panics").control_changes;
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
            let stalled = match self.stalled(&queue, &missing) {
                Ok(stalled) => stalled,
                Err(error) => {
                    self.wait_for_store(error)?;
                    continue;
                }
            };
            let round = Round {
                full,
                queue: queue.as_ref().ok(),
                stalled: &stalled,
                missing: &missing,
                taken_back,
                control: self.snapshot.control.state,
            };
            let (decision, after) = decide(&round, carried);
            carried = after;
            if decision == Decision::Verify {
                continue;
            }
            self.tell(&queue, changes, decision == Decision::Finish);
            let is_lost = queue.is_err();
            if let (Err(error @ QueueError::Hopeless(_)), false) =
                (queue, decision == Decision::Finish)
            {
                return Err(error.into());
            }
            if decision != Decision::Finish && self.must_stop() {
                return Ok(self.ended(true));
            }
            match decision {
                Decision::Finish => break,
                Decision::Cancel => {
                    // Workers lease nothing from the queue of a cancelled run, so a failed removal does no harm.
                    let _ = self.queue.remove();
                    return Ok(self.ended(false));
                }
                Decision::Publish { purge, scenes } => {
                    carried.due |= !self.publish(purge, &scenes);
                }
                Decision::Wait | Decision::Verify => {}
            }
            // The shorter of the last two rounds counts, so that one slow response of a server causes no long pause.
            let took = start.elapsed();
            // Calls to a server that is away end late, and it may be back soon.
            let slow = if is_lost { Duration::ZERO } else { took.min(took_before) * PAUSE_ROUNDS };
            self.pause(self.options.every.max(slow));
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

    /// Polls the queue before the store, so that a scene that leaves the queue in between already has its tuple. The
    /// second value is true if the poll is not `full` and finds that a tuple or a quarantine record was removed.
    fn poll(&mut self, full: bool) -> Result<(Result<QueuePoll, QueueError>, bool), FarmError> {
        let queue = self.poll_queue(full);
        let taken_back = if full {
            self.last_full = Instant::now();
            self.snapshot.refresh(self.run, self.store)?;
            false
        } else {
            self.snapshot.refresh_news(self.run, self.store)?
        };
        Ok((queue, taken_back))
    }

    /// Polls the queue, and lists its messages in a full round and several times in a lease.
    fn poll_queue(&mut self, full: bool) -> Result<QueuePoll, QueueError> {
        let other = self.queue.ensure()?;
        let state = self.queue.state()?;
        let is_due = self.last_listed.elapsed() >= self.options.lease / LISTS_PER_LEASE;
        let mut scenes = None;
        if full || is_due {
            self.last_listed = Instant::now();
            self.listed.clear();
            for listed in self.queue.messages()? {
                self.listed.entry(listed.message.task.scene).or_default().push(listed);
            }
            scenes = Some(queued(&self.listed));
        }
        Ok(QueuePoll { state, other, scenes })
    }

    /// Returns the missing scenes that stand still although the queue has messages of them.
    fn stalled(
        &mut self,
        queue: &Result<QueuePoll, QueueError>,
        missing: &[usize],
    ) -> Result<BTreeSet<usize>, FarmError> {
        let is_running = self.snapshot.control.state == ControlState::Running;
        if !is_running || !queue.as_ref().is_ok_and(|queue| queue.scenes.is_some()) {
            return Ok(BTreeSet::new());
        }
        let (now, lease) = (self.start.elapsed(), self.options.lease);
        let snapshot = &self.snapshot;
        let scenes = missing.iter().filter_map(|&scene| {
            let listed = self.listed.get(&(scene as u32))?;
            listed.iter().find(|listed| listed.is_readable)?;
            Some((scene as u32, snapshot.shards(scene), listed.as_slice()))
        });
        let mut stalled = BTreeSet::new();
        for scene in self.stalls.observe(now, lease, scenes) {
            let index = scene as usize;
            let id = &self.run.lines[index].id;
            let evidence = evidence(self.store, id)?;
            if self.stalls.judge(now, lease, scene, evidence) {
                let scene = id.clone();
                (self.on_event)(Event::SceneStalled { scene, for_s: 2.0 * lease.as_secs_f64() });
                stalled.insert(index);
            }
        }
        Ok(stalled)
    }

    /// Returns the message that publishes a scene, which must differ from those in the queue.
    fn message(&self, scene: usize, purged: bool) -> Message {
        let there = self.listed.get(&(scene as u32)).filter(|_| !purged);
        unlisted(whole(self.run, scene), there.map_or(&[], Vec::as_slice))
    }

    fn tell_done(&mut self) {
        let run = self.run;
        for scene in 0..run.lines.len() {
            if !self.snapshot.is_done(scene) || std::mem::replace(&mut self.told[scene], true) {
                continue;
            }
            (self.on_event)(Event::ShardDone { resumed: self.first });
            let scene = run.lines[scene].id.clone();
            (self.on_event)(Event::SceneMerged { scene, miss_share: 0.0, has_odd_view: false });
        }
        self.first = false;
    }

    /// Updates `watch` if a page shows it, and reports a change of control or, before the end, an unreachable queue.
    fn tell(
        &mut self,
        queue: &Result<QueuePoll, QueueError>,
        changes_before_poll: u64,
        finished: bool,
    ) {
        if self.options.watched {
            let mut watch = self.watch.lock().expect("no holder of this lock panics");
            watch.update(self.snapshot.clone(), changes_before_poll);
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

    /// Publishes scenes, after a purge of the queue if `purge` is set. Returns false if the queue cannot be reached.
    fn publish(&mut self, purge: bool, scenes: &[usize]) -> bool {
        let messages: Vec<Message> =
            scenes.iter().map(|&scene| self.message(scene, purge)).collect();
        let purged = if purge { self.queue.purge() } else { Ok(()) };
        match purged.and_then(|()| self.queue.publish(&messages)) {
            Ok(()) => {
                self.published += messages.len() as u64;
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

    /// Reports a temporary error of the store (if a report is due) and waits. Returns any other error.
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

    /// Removes the partials and attempts of done scenes. Ignores errors, because remaining objects do no harm.
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

    /// Removes objects that are no longer needed, marks the run as finished, and removes the queue.
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
        // A finished run needs no queue, so a failed removal does no harm.
        let _ = self.queue.remove();
        Ok(())
    }
}

/// True if there was no report yet, or the last one is older than [`COMPLAIN`]; the time of a due report is recorded.
fn is_due(complained: &mut Option<Instant>) -> bool {
    let due = complained.is_none_or(|at| at.elapsed() > COMPLAIN);
    if due {
        *complained = Some(Instant::now());
    }
    due
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_old_poll_does_not_hide_a_change_by_the_page() {
        let polled = |state| {
            let mut snapshot = Snapshot::default();
            snapshot.control.state = state;
            snapshot
        };
        let mut watch = Watch::default();
        watch.set_control(ControlState::Paused);
        watch.update(polled(ControlState::Running), 0);
        assert_eq!(watch.snapshot.control.state, ControlState::Paused);
        watch.update(polled(ControlState::Cancelled), 1);
        assert_eq!(watch.snapshot.control.state, ControlState::Cancelled);
    }
}
