//! The prefetch thread: it leases tasks from the queue and reads their scenes' files before compute threads need them.

use super::core::Worker;
use super::jobs::Loaded;
use super::poison::Finding;
use super::tasks::TaskId;
use crate::farm::FarmError;
use crate::farm::queue::{Lease, QueueError, Taken};
use crate::run::{Event, Stage, Stopwatch, keys};
use crate::store::StoreError;
use crossbeam::channel::Sender;
use glasshouse_line::{SceneLine, is_url};
use render::input_file::InputFile;
use render::scene::{LoadError, SceneFiles, read_files_by};
use std::cell::Cell;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Longest wait of one call for a task, after which the thread checks for a stop.
const WAIT: Duration = Duration::from_millis(500);
/// Pause before the thread checks again whether another task is needed.
const PAUSE: Duration = Duration::from_millis(5);
/// Pause between two calls that do not wait, and between two checks of a paused run; also the shortest wait for a task.
const AGAIN: Duration = Duration::from_millis(50);
/// Shortest time between two checks for the end of the run, while the queue responds but delivers no task.
const CHECK_OVER: Duration = Duration::from_secs(1);
/// Shortest time between two reports that the queue cannot be reached.
const COMPLAIN: Duration = Duration::from_secs(30);

/// State that the prefetch thread and the lease keeper share.
#[derive(Default)]
pub(super) struct Appetite {
    /// True if neither the worker nor the queue has a task.
    pub(super) hungry: AtomicBool,
    /// Mean time that other workers take to load a scene, µs; 0 if unknown.
    others_load_us: AtomicU64,
}

impl Appetite {
    fn set_hungry(&self, hungry: bool) {
        self.hungry.store(hungry, Ordering::Release);
    }

    /// Records another worker's time to load a scene.
    pub(super) fn hear_of(&self, load_s: Option<f64>) {
        let Some(load_s) = load_s else { return };
        let known = self.others_load_us.load(Ordering::Relaxed);
        let heard = (load_s * 1e6) as u64;
        // Scenes and workers differ, so this is a mean in which the latest value counts most.
        let mean = if known == 0 { heard } else { u64::midpoint(known, heard) };
        self.others_load_us.store(mean.max(1), Ordering::Relaxed);
    }

    fn others_load_s(&self) -> Option<f64> {
        let others_us = self.others_load_us.load(Ordering::Relaxed);
        (others_us > 0).then_some(others_us as f64 * 1e-6)
    }
}

pub(super) struct Prefetcher<'s, 'a> {
    pub(super) worker: &'s Worker<'a>,
    pub(super) appetite: &'s Appetite,
    pub(super) sender: Sender<Loaded<'a>>,
    /// Index of the first scene that [`Self::has_readable_scene`] looks at: all before cannot be read.
    pub(super) readable: Cell<usize>,
}

impl<'a> Prefetcher<'_, 'a> {
    pub(super) fn run(&self) {
        let worker = self.worker;
        let is_shared = worker.shared_queue.is_some();
        let (mut checked, mut complained) = (Instant::now(), None::<Instant>);
        let (mut hungry_since, mut removed) = (None, None::<Instant>);
        while !worker.must_stop() {
            if is_shared && worker.tasks().has_enough(self.ahead(), worker.costs()) {
                std::thread::sleep(PAUSE);
                continue;
            }
            let idle = self.sender.is_empty() && worker.tasks().is_empty();
            match self.take(self.wait(idle, hungry_since)) {
                Taken::Lease(lease) => {
                    self.appetite.set_hungry(false);
                    (complained, hungry_since) = (None, None);
                    if !self.prepare(&lease) {
                        return;
                    }
                    continue;
                }
                Taken::Nothing => {
                    complained = None;
                    self.appetite.set_hungry(idle);
                    hungry_since = idle.then(|| hungry_since.unwrap_or_else(Instant::now));
                    if is_shared {
                        self.pause(idle);
                    }
                }
                Taken::Ended => return,
                Taken::Removed(reason) => {
                    if removed.is_none_or(|at| at.elapsed() > COMPLAIN) {
                        removed = Some(Instant::now());
                        (worker.on_event)(Event::MessageRemoved { reason });
                    }
                }
                Taken::Lost(error) => {
                    self.appetite.set_hungry(false);
                    if self.is_run_over() {
                        return;
                    }
                    if matches!(error, QueueError::Hopeless(_)) {
                        worker.stop.break_down(error.into());
                        return;
                    }
                    let reason = error.to_string();
                    if complained.is_none_or(|at| at.elapsed() > COMPLAIN) {
                        complained = Some(Instant::now());
                        (worker.on_event)(Event::QueueLost { reason });
                    }
                }
            }
            if is_shared && checked.elapsed() > CHECK_OVER {
                checked = Instant::now();
                if self.is_run_over() {
                    return;
                }
            }
        }
    }

    /// Returns the number of tasks to prefetch. It is small, because other workers need tasks, too.
    fn ahead(&self) -> usize {
        self.worker.options.threads.div_ceil(4)
    }

    /// Returns the time to wait at the queue for a task.
    ///
    /// A busy worker must not wait there, or it takes a task that was donated for an idle worker. Slow workers poll,
    /// too, because a donation to them would finish last. All other idle workers wait. Their waits are short at
    /// first, because a worker may not know yet that it is slower than others.
    fn wait(&self, idle: bool, hungry_since: Option<Instant>) -> Duration {
        match hungry_since {
            _ if self.worker.shared_queue.is_none() => WAIT,
            Some(since) if idle && !self.is_slower() => since.elapsed().clamp(AGAIN, WAIT),
            _ => Duration::ZERO,
        }
    }

    /// True if this worker is known to be slower than others.
    fn is_slower(&self) -> bool {
        let others_load_s = self.appetite.others_load_s();
        others_load_s.is_some() && self.worker.costs().slowness(others_load_s) < 1.0
    }

    /// Pauses after a poll of an empty queue. An idle worker polls again at once if its polls wait at the queue.
    fn pause(&self, idle: bool) {
        if !idle {
            std::thread::sleep(AGAIN);
        } else if self.is_slower() {
            self.worker.pause(WAIT);
        }
    }

    /// True if the store can be reached and contains the coordinator's mark of a finished run.
    fn is_run_over(&self) -> bool {
        let store = self.worker.store.with_patience(Duration::ZERO);
        matches!(store.get(keys::FINISHED), Ok(Some(_)))
    }

    /// Leases the next task. Leases none while a shared run is paused.
    fn take(&self, wait: Duration) -> Taken {
        let worker = self.worker;
        if worker.shared_queue.is_none() || !worker.stop.control.is_paused() {
            return worker.queue.take(wait);
        }
        std::thread::sleep(AGAIN);
        Taken::Nothing
    }

    /// Examines a task, reads its files and sends them to a compute thread. Returns false if the worker must stop.
    fn prepare(&self, lease: &Lease) -> bool {
        let worker = self.worker;
        let now = worker.now();
        let task = worker.tasks().lease(lease, now);
        let Some(task) = task else {
            return true;
        };
        worker.tasks().take_in(task, true, now);
        let examined = self.examine_and_read(lease, task);
        let now = worker.now();
        worker.tasks().take_in(task, false, now);
        match examined {
            Ok(Some(loaded)) => self.send(loaded),
            Ok(None) => true,
            Err(error) => {
                worker.stop.break_down(error);
                false
            }
        }
    }

    /// Examines a task and reads its files. Returns `None` if the compute threads have nothing to trace.
    fn examine_and_read(
        &self,
        lease: &Lease,
        task: TaskId,
    ) -> Result<Option<Loaded<'a>>, FarmError> {
        let worker = self.worker;
        let leased = &lease.message.task;
        let line = worker.line(leased.scene);
        let (record, is_suspect) = match worker.examine(line, task, lease)? {
            Finding::Over => return Ok(None),
            Finding::Fresh(record) => (record, false),
            Finding::Suspect(record) => (Some(record), true),
        };
        let files = self.read(line, task)?;
        match &files {
            Err(error) if self.may_be_mine(error) => {
                worker.could_not_read(line, task, record, &error.to_string())?;
                return Ok(None);
            }
            Err(error @ LoadError::Read { .. })
                if worker.shared_queue.is_none() && !self.has_readable_scene() =>
            {
                // The files may be gone with the folder of the run, which is another failure.
                worker.store.check_place()?;
                return Err(FarmError::NoInputs(error.to_string()));
            }
            Ok(_) if is_suspect => {
                if let (Some(sandbox), Some(record)) = (worker.options.sandbox, record) {
                    worker.trace_in(sandbox, line, (task, leased), record)?;
                    return Ok(None);
                }
            }
            _ => {}
        }
        let leased = leased.clone();
        Ok(Some(Loaded { line, task, leased, files }))
    }

    /// Reads a scene's files. The outer error belongs to the store and is no fault of the scene.
    fn read(
        &self,
        line: &SceneLine,
        task: TaskId,
    ) -> Result<Result<SceneFiles, LoadError>, StoreError> {
        let start = Stopwatch::start();
        let run = self.worker.run;
        // Every file is progress, so that a scene with many files on a slow disk does not count as a hang.
        let open = |path: &Path| {
            let bytes = run.inputs.read(path);
            self.worker.progress(task);
            bytes
        };
        let files = read_files_by(line, &run.roots, run.root(), &open);
        self.worker.tally.seconds.add(Stage::Read, start.spent());
        match files {
            Ok(files) => Ok(Ok(files)),
            Err(error) => without_store(error).map(Err),
        }
    }

    /// True if all files of some scene of the run can be opened, or if they are not local. If no scene's can, a disk is
    /// probably missing, and a scene must not go into quarantine for it.
    fn has_readable_scene(&self) -> bool {
        let run = self.worker.run;
        let open = |path: &Path| {
            if is_url(path) { Ok(Vec::new()) } else { InputFile::open(path).map(|_| Vec::new()) }
        };
        let can_open =
            |line: &SceneLine| read_files_by(line, &run.roots, run.root(), &open).is_ok();
        let unread = run.lines.iter().skip(self.readable.get()).take_while(|line| !can_open(line));
        self.readable.set(self.readable.get() + unread.count());
        self.readable.get() < run.lines.len()
    }

    /// True if the error may be this machine's fault, so that another machine may be able to read the file.
    fn may_be_mine(&self, error: &LoadError) -> bool {
        let shared_queue = self.worker.shared_queue;
        shared_queue.is_some_and(|shared| !shared.is_child)
            && matches!(error, LoadError::Read { .. } | LoadError::Root(_))
    }

    fn send(&self, mut loaded: Loaded<'a>) -> bool {
        loop {
            if self.worker.must_stop() {
                return false;
            }
            match self.sender.send_timeout(loaded, Duration::from_millis(50)) {
                Ok(()) => {
                    self.worker.bell.ring(1);
                    return true;
                }
                Err(error) if error.is_disconnected() => return false,
                Err(error) => loaded = error.into_inner(),
            }
        }
    }
}

/// Returns the error of a file as `Ok`, and that of a store as `Err`.
fn without_store(error: LoadError) -> Result<LoadError, StoreError> {
    match error {
        LoadError::Read { path, source } => match source.downcast::<StoreError>() {
            Ok(error) => Err(error),
            Err(source) => Ok(LoadError::Read { path, source }),
        },
        error => Ok(error),
    }
}
