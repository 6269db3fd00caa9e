//! The shared state of a worker's threads, with the locked state machine, and the execution of the machine's actions.

use super::bell::Bell;
use super::costs::Costs;
use super::jobs::{ActiveTask, Job};
use super::options::{SharedQueue, WorkOptions};
use super::stop::StopSigns;
use super::tally::Tally;
use super::tasks::{Action, TaskId, Tasks, Time};
use crate::farm::FarmError;
use crate::farm::queue::Queue;
use crate::farm::tuples::remove_partials;
use crate::run::{Event, QuarantineRecord, Run, forget, is_done, keys};
use crate::store::Store;
use crossbeam::deque::Injector;
use glasshouse_line::SceneLine;
use render::partial::Maker;
use render::scene::PhotographCache;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::{Duration, Instant};

pub(super) struct Worker<'a> {
    pub(super) run: &'a Run,
    pub(super) store: &'a Store,
    pub(super) queue: &'a dyn Queue,
    /// The shared queue, if other processes take part in the run.
    pub(super) shared_queue: Option<&'a SharedQueue<'a>>,
    pub(super) options: &'a WorkOptions<'a>,
    pub(super) on_event: &'a (dyn Fn(Event) + Sync),
    pub(super) start: Instant,
    /// This worker, as the maker of its partials.
    pub(super) maker: Maker,
    pub(super) photographs: PhotographCache,
    pub(super) tasks: Mutex<Tasks<Arc<ActiveTask<'a>>>>,
    /// Jobs for the compute threads, which do them before all else, to store results and to free their memory.
    pub(super) jobs: Injector<Job<'a>>,
    /// Rings when there is work for compute threads, and when there may be none any more.
    pub(super) bell: Bell,
    pub(super) stop: StopSigns,
    pub(super) tally: Tally,
}

impl<'a> Worker<'a> {
    /// Locks the machine for one event or one query. A thread with this lock takes no other lock and does not wait.
    pub(super) fn tasks(&self) -> MutexGuard<'_, Tasks<Arc<ActiveTask<'a>>>> {
        self.tasks.lock().expect("no holder of this lock panics")
    }

    pub(super) fn now(&self) -> Time {
        self.start.elapsed()
    }

    pub(super) fn must_stop(&self) -> bool {
        let stops = self.stop.any(self.options.stop, self.options.deadline);
        if stops {
            self.tasks().stop();
        }
        stops
    }

    /// Sleeps until `time` has passed or the worker must stop.
    pub(super) fn pause(&self, time: Duration) {
        let start = Instant::now();
        while start.elapsed() < time && !self.must_stop() {
            std::thread::sleep(Duration::from_millis(5).min(time));
        }
    }

    /// Like [`pause`](Self::pause), for a task that does not count as hung meanwhile.
    pub(super) fn pause_with(&self, task: TaskId, time: Duration) {
        let end = Instant::now() + time;
        loop {
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() || self.must_stop() {
                return;
            }
            self.pause(left.min(Duration::from_secs(1)));
            self.progress(task);
        }
    }

    pub(super) fn costs(&self) -> Costs {
        self.tally.costs(self.options.threads)
    }

    pub(super) fn line(&self, scene: u32) -> &'a SceneLine {
        let run: &'a Run = self.run;
        &run.lines[scene as usize]
    }

    pub(super) fn progress(&self, task: TaskId) {
        let now = self.now();
        self.tasks().progress(task, now);
    }

    /// Does a part of a task's work. A panic fails the task's scene, not the farm.
    pub(super) fn step(&self, task: &ActiveTask, work: impl FnOnce() -> Result<(), FarmError>) {
        self.progress(task.id);
        let done = match catch_unwind(AssertUnwindSafe(work)) {
            Ok(done) => done,
            Err(panic) => self.fail(task.id, &panic_reason(&*panic)),
        };
        self.break_down_if(done);
        self.progress(task.id);
    }

    pub(super) fn break_down_if(&self, done: Result<(), FarmError>) {
        if let Err(error) = done {
            self.stop.break_down(error);
        }
    }

    pub(super) fn fail(&self, task: TaskId, reason: &str) -> Result<(), FarmError> {
        let actions = self.tasks().fail(task, reason);
        self.perform(actions)
    }

    /// Performs the machine's actions in order.
    pub(super) fn perform(&self, actions: Vec<Action>) -> Result<(), FarmError> {
        let done = self.perform_in(self.store, actions);
        // Compute threads wait for the last task's end.
        if self.tasks().is_empty() {
            self.bell.ring_all();
        }
        done.map(|_| ())
    }

    /// Performs actions on this handle of the run's store. Returns the number of published messages. A failed
    /// publication ends the call without an error, because unfinished leases expire by themselves.
    pub(super) fn perform_in(&self, store: &Store, actions: Vec<Action>) -> Result<u64, FarmError> {
        let mut published = 0;
        for action in actions {
            match action {
                Action::Store { task, shards } => {
                    for shard in shards {
                        self.for_pool(task, |task| Job::Seal(task, shard));
                    }
                }
                Action::Merge { task } => self.for_pool(task, Job::Merge),
                Action::Gather { task } => self.for_pool(task, Job::Gather),
                Action::CheckScene { task } => self.check_scene(task)?,
                Action::Quarantine { scene, reason } => {
                    let line = self.line(scene);
                    QuarantineRecord::put(store, &line.id, &reason)?;
                    self.tell_quarantine(line, &reason);
                }
                Action::RemovePartials { scene } => remove_partials(store, self.line(scene)),
                Action::ForgetAttempt { task, n } => {
                    let shards = [task.shards.start, task.shards.end];
                    // A remaining record counts only if the task's next worker is lost, too.
                    forget(store, &self.line(task.scene).id, shards, n);
                }
                Action::Replace { lease, messages } => {
                    let Ok(all_new) = self.queue.publish(&messages) else {
                        return Ok(published);
                    };
                    published += messages.len() as u64;
                    if all_new {
                        self.queue.finish(lease);
                    }
                }
                Action::Finish { lease } => self.queue.finish(lease),
            }
        }
        Ok(published)
    }

    fn for_pool(&self, task: TaskId, job: impl FnOnce(Arc<ActiveTask<'a>>) -> Job<'a>) {
        let active = self.tasks().payload(task).cloned();
        if let Some(active) = active {
            self.jobs.push(job(active));
            self.bell.ring(1);
        }
    }

    /// Completes a scene if the store has all of its shards, and otherwise ends the task, because its part is stored.
    fn check_scene(&self, task: TaskId) -> Result<(), FarmError> {
        let Some(active) = self.tasks().payload(task).cloned() else {
            return Ok(());
        };
        let line = active.job.line;
        let there = self.store.list(&keys::partials(&line.id))?;
        let shards = there.iter().filter_map(|key| keys::shard_of(key)).count();
        let all = shards >= active.job.layout.len() as usize;
        if !all {
            if self.is_done_elsewhere(&active)? {
                return Ok(());
            }
            self.stop.went_well();
        }
        let actions = self.tasks().scene_checked(task, all);
        self.perform(actions)
    }

    /// True if another worker has made the scene's tuple, for example while this one slept. If so, ends the task.
    pub(super) fn is_done_elsewhere(&self, task: &ActiveTask<'a>) -> Result<bool, FarmError> {
        if self.shared_queue.is_none() || !is_done(self.run, self.store, task.job.line)? {
            return Ok(false);
        }
        let actions = self.tasks().done_elsewhere(task.id);
        self.perform(actions)?;
        Ok(true)
    }

    pub(super) fn tell_quarantine(&self, line: &SceneLine, reason: &str) {
        let mut quarantined = self.tally.quarantined.lock().expect("no holder of this lock panics");
        quarantined.push((line.id.clone(), reason.to_owned()));
        drop(quarantined);
        (self.on_event)(Event::SceneQuarantined {
            scene: line.id.clone(),
            reason: reason.to_owned(),
            shards: u64::from(self.run.layout(line).len()),
        });
    }

    /// Counts a failure that may be this machine's fault. After too many in a row, a worker of a shared queue drains.
    pub(super) fn went_wrong(&self, line: &SceneLine) {
        let failed = self.stop.went_wrong(&line.id);
        if let Some(scenes) = failed.filter(|_| self.shared_queue.is_some() && self.stop.drain()) {
            let reason = format!(
                "{} scenes in a row failed here ({}): this worker leaves the rest to others; check this machine's \
                 inputs (--root) and memory, then start it again",
                scenes.len(),
                scenes.join(", ")
            );
            (self.on_event)(Event::Drained { reason });
        }
    }
}

pub(super) fn panic_reason(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic
        .downcast_ref::<&str>()
        .map(|text| (*text).to_owned())
        .or_else(|| panic.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "no message".to_owned());
    format!(
        "the program failed on this scene ({text}); please report it with the scene's manifest line"
    )
}
