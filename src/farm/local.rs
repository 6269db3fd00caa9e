//! The local farm: one process, some threads, no server.
//!
//! One extra thread reads the files of scenes to come. A worker thread takes shards from its own deque, then
//! steals from the others', and only when there is nothing to steal does it decode the next scene and fill its
//! own deque: so at most one scene a thread is in memory, scene N + 1 is prepared while N is traced, and the
//! last shards of a run are shared by all threads. Whoever finishes a scene's last shard merges it.

use super::events::{Event, StageSeconds};
use super::job::SceneJob;
use super::quarantine::QuarantineRecord;
use super::run_dir::{Run, RunError};
use super::sweep::{remove_partials, sweep};
use crate::atomic_file::{self, WriteError};
use crate::ids::SceneId;
use crate::manifest::SceneLine;
use crate::merge::{combine, is_written, write_tuple};
use crate::partial;
use crate::scene::{LoadError, SceneFiles, load, read_files};
use crate::shard::golden;
use crate::trace::Isa;
use crossbeam::channel::{Receiver, Sender, TryRecvError, bounded};
use crossbeam::deque::{Steal, Stealer, Worker};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// How to work.
pub struct WorkOptions<'a> {
    /// Tracer threads.
    pub threads: usize,
    /// Kernels to use.
    pub isa: Isa,
    /// Set from outside to stop after the shards in flight.
    pub stop: &'a AtomicBool,
    /// No shard is begun after this time.
    pub deadline: Option<Instant>,
}

/// Why work ended before the end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// `stop` was set.
    Asked,
    /// The deadline passed.
    TimeLimit,
}

/// How work ended.
#[derive(Debug)]
pub struct Outcome {
    /// Tuples written now.
    pub merged: u64,
    /// Tuples that were there before.
    pub already_merged: u64,
    /// Shards traced now.
    pub traced: u64,
    /// Shards whose partials were found.
    pub resumed: u64,
    /// Scenes in quarantine, those of earlier times included, with their reasons.
    pub quarantined: Vec<(SceneId, String)>,
    /// Ended early.
    pub stopped: Option<Stop>,
    /// Where the threads' seconds went.
    pub seconds: StageSeconds,
}

/// The farm itself broke (not a scene).
#[derive(Debug, thiserror::Error)]
pub enum FarmError {
    /// The run's folder cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// The run is in use.
    #[error(transparent)]
    Run(#[from] RunError),
    /// A tuple cannot be written.
    #[error("{0}")]
    Tuple(String),
    /// This machine computes other pixels.
    #[error(
        "this machine is refused: it computes other bits for the golden shard {scene} ({found}) than the run's spec holds \
         ({expected}); do not use it for this run, and report its CPU and this program's version"
    )]
    Golden {
        /// The golden scene.
        scene: String,
        /// Digest here.
        found: String,
        /// Digest in the spec.
        expected: String,
    },
}

struct Shared<'a> {
    run: &'a Run,
    options: &'a WorkOptions<'a>,
    on_event: &'a (dyn Fn(Event) + Sync),
    files: Receiver<(&'a SceneLine, Result<SceneFiles, LoadError>)>,
    stealers: Vec<Stealer<Task<'a>>>,
    /// Scenes that are loaded, or being loaded, and neither merged nor failed.
    open: AtomicUsize,
    merged: AtomicU64,
    traced: AtomicU64,
    resumed: AtomicU64,
    timed_out: AtomicBool,
    quarantined: Mutex<Vec<(SceneId, String)>>,
    failure: Mutex<Option<FarmError>>,
    broken: AtomicBool,
    seconds: StageSeconds,
}

/// One shard of a loaded scene.
type Task<'a> = (Arc<SceneJob<'a>>, u32);

/// Traces and merges all that the run lacks.
pub fn work(
    run: &Run,
    options: &WorkOptions,
    on_event: &(dyn Fn(Event) + Sync),
) -> Result<Outcome, FarmError> {
    let _lock = run.lock()?;
    let found = golden(options.isa);
    if found != run.spec.golden {
        return Err(FarmError::Golden {
            scene: run.spec.golden.scene.clone(),
            found: found.blake3,
            expected: run.spec.golden.blake3.clone(),
        });
    }
    sweep(run);
    let mut pending = Vec::new();
    let mut quarantined = Vec::new();
    let mut already_merged = 0;
    for line in &run.lines {
        if is_written(&run.dir.tuple(&line.id), line) {
            already_merged += 1;
        } else if let Some(record) = QuarantineRecord::read(&run.dir, &line.id) {
            quarantined.push((line.id.clone(), record.reason));
        } else {
            pending.push(line);
        }
    }
    on_event(Event::Started {
        shards: pending
            .iter()
            .map(|line| u64::from(run.layout(line).len()))
            .sum(),
        scenes: pending.len() as u64,
    });
    let threads = options.threads.max(1);
    let (sender, files) = bounded(threads);
    let deques: Vec<Worker<Task>> = (0..threads).map(|_| Worker::new_fifo()).collect();
    let shared = Shared {
        run,
        options,
        on_event,
        files,
        stealers: deques.iter().map(Worker::stealer).collect(),
        open: AtomicUsize::new(0),
        merged: AtomicU64::new(0),
        traced: AtomicU64::new(0),
        resumed: AtomicU64::new(0),
        timed_out: AtomicBool::new(false),
        quarantined: Mutex::new(quarantined),
        failure: Mutex::new(None),
        broken: AtomicBool::new(false),
        seconds: StageSeconds::default(),
    };
    std::thread::scope(|scope| {
        let shared = &shared;
        let pending = &pending;
        scope.spawn(move || shared.prefetch(pending, &sender));
        for (index, deque) in deques.into_iter().enumerate() {
            scope.spawn(move || shared.worker(index, &deque));
        }
    });
    let failure = shared
        .failure
        .into_inner()
        .expect("no holder of this lock panics");
    if let Some(error) = failure {
        return Err(error);
    }
    let stopped = if options.stop.load(Ordering::Relaxed) {
        Some(Stop::Asked)
    } else {
        shared
            .timed_out
            .load(Ordering::Relaxed)
            .then_some(Stop::TimeLimit)
    };
    let mut quarantined = shared
        .quarantined
        .into_inner()
        .expect("no holder of this lock panics");
    quarantined.sort();
    Ok(Outcome {
        merged: shared.merged.into_inner(),
        already_merged,
        traced: shared.traced.into_inner(),
        resumed: shared.resumed.into_inner(),
        quarantined,
        stopped,
        seconds: shared.seconds,
    })
}

impl<'a> Shared<'a> {
    /// No further shard may be begun.
    fn must_stop(&self) -> bool {
        if self
            .options
            .deadline
            .is_some_and(|deadline| Instant::now() >= deadline)
        {
            self.timed_out.store(true, Ordering::Relaxed);
        }
        self.options.stop.load(Ordering::Relaxed)
            || self.timed_out.load(Ordering::Relaxed)
            || self.broken.load(Ordering::Relaxed)
    }

    /// Reads scenes' files ahead of the workers, as many scenes as the channel holds.
    fn prefetch(
        &self,
        pending: &[&'a SceneLine],
        sender: &Sender<(&'a SceneLine, Result<SceneFiles, LoadError>)>,
    ) {
        for line in pending {
            let start = Instant::now();
            let mut message = (
                *line,
                read_files(line, &self.run.roots, self.run.dir.root()),
            );
            self.seconds.add_read(start.elapsed());
            loop {
                if self.must_stop() {
                    return;
                }
                match sender.send_timeout(message, Duration::from_millis(50)) {
                    Ok(()) => break,
                    Err(error) if error.is_disconnected() => return,
                    Err(error) => message = error.into_inner(),
                }
            }
        }
    }

    fn worker(&self, index: usize, deque: &Worker<Task<'a>>) {
        while !self.must_stop() {
            if let Some((job, shard)) = deque.pop().or_else(|| self.steal(index)) {
                self.step(&job, |this| this.trace_shard(&job, shard));
                continue;
            }
            // Counted before it is taken, so that nobody goes home while a scene may still be shared out.
            self.open.fetch_add(1, Ordering::AcqRel);
            match self.files.try_recv() {
                Ok((line, files)) => self.open_scene(line, files, deque),
                Err(error) => {
                    let open = self.open.fetch_sub(1, Ordering::AcqRel) - 1;
                    if error == TryRecvError::Disconnected && open == 0 {
                        return;
                    }
                    std::thread::sleep(Duration::from_micros(500));
                }
            }
        }
    }

    fn steal(&self, index: usize) -> Option<Task<'a>> {
        let count = self.stealers.len();
        for victim in (1..count).map(|offset| &self.stealers[(index + offset) % count]) {
            loop {
                match victim.steal() {
                    Steal::Success(task) => return Some(task),
                    Steal::Empty => break,
                    Steal::Retry => {}
                }
            }
        }
        None
    }

    /// Does a piece of a scene's work; a panic in it costs that scene, not the farm.
    fn step(&self, job: &SceneJob, work: impl FnOnce(&Self) -> Result<(), FarmError>) {
        match catch_unwind(AssertUnwindSafe(|| work(self))) {
            Ok(Ok(())) => {}
            Ok(Err(error)) => self.break_down(error),
            Err(panic) => {
                if job.fail() {
                    self.quarantine(job.line, &panic_reason(&*panic));
                    self.open.fetch_sub(1, Ordering::AcqRel);
                }
            }
        }
    }

    fn break_down(&self, error: FarmError) {
        self.broken.store(true, Ordering::Relaxed);
        self.failure
            .lock()
            .expect("no holder of this lock panics")
            .get_or_insert(error);
    }

    fn quarantine(&self, line: &SceneLine, reason: &str) {
        if let Err(error) = QuarantineRecord::write(&self.run.dir, &line.id, reason) {
            self.break_down(error.into());
            return;
        }
        let entry = (line.id.clone(), reason.to_owned());
        self.quarantined
            .lock()
            .expect("no holder of this lock panics")
            .push(entry);
        (self.on_event)(Event::SceneQuarantined {
            scene: line.id.clone(),
            reason: reason.to_owned(),
            shards: u64::from(self.run.layout(line).len()),
        });
    }

    /// Decodes a scene, takes up what is on disk, and puts the missing shards into the deque.
    fn open_scene(
        &self,
        line: &'a SceneLine,
        files: Result<SceneFiles, LoadError>,
        deque: &Worker<Task<'a>>,
    ) {
        let start = Instant::now();
        let loaded = catch_unwind(AssertUnwindSafe(|| {
            files.and_then(|files| load(line, &files))
        }));
        self.seconds.add_decode(start.elapsed());
        let job = match loaded {
            Ok(Ok(loaded)) => Arc::new(SceneJob::new(line, self.run.layout(line), loaded)),
            Ok(Err(error)) => {
                self.quarantine(line, &load_reason(line, &error));
                self.open.fetch_sub(1, Ordering::AcqRel);
                return;
            }
            Err(panic) => {
                self.quarantine(line, &panic_reason(&*panic));
                self.open.fetch_sub(1, Ordering::AcqRel);
                return;
            }
        };
        let folder = self.run.dir.partials(&line.id);
        if let Err(error) = atomic_file::create_dir(&folder) {
            self.break_down(error.into());
            return;
        }
        for shard in job.layout.shards() {
            let path = self.run.dir.partial(&line.id, shard.index);
            let Ok(bytes) = std::fs::read(&path) else {
                deque.push((Arc::clone(&job), shard.index));
                continue;
            };
            let reason = match partial::decode(&path, &bytes) {
                Ok(found) if job.accepts(&shard, &found) => {
                    self.resumed.fetch_add(1, Ordering::Relaxed);
                    (self.on_event)(Event::ShardDone { resumed: true });
                    if job.finish(found) {
                        self.step(&job, |this| this.merge(&job));
                    }
                    continue;
                }
                Ok(_) => format!(
                    "partial {} belongs to other inputs or another spec; it will be traced again",
                    path.display()
                ),
                Err(error) => error.to_string(),
            };
            (self.on_event)(Event::PartialRejected { reason });
            deque.push((Arc::clone(&job), shard.index));
        }
    }

    fn trace_shard(&self, job: &SceneJob, index: u32) -> Result<(), FarmError> {
        if job.has_failed() {
            return Ok(());
        }
        let start = Instant::now();
        let result = job.trace(&job.layout.shard(index), self.options.isa);
        self.seconds.add_trace(start.elapsed());
        let start = Instant::now();
        let path = self.run.dir.partial(&job.line.id, index);
        let bytes = partial::encode(&result)
            .map_err(|e| FarmError::Tuple(format!("cannot encode {}: {e}", path.display())))?;
        atomic_file::write(&path, &bytes)?;
        self.seconds.add_checkpoint(start.elapsed());
        self.traced.fetch_add(1, Ordering::Relaxed);
        (self.on_event)(Event::ShardDone { resumed: false });
        if job.finish(result) {
            self.merge(job)
        } else {
            Ok(())
        }
    }

    /// All shards are there: writes the tuple, then removes the partials.
    fn merge(&self, job: &SceneJob) -> Result<(), FarmError> {
        let start = Instant::now();
        let partials = job.take_results();
        match combine(job.line, self.run.spec.tile_px, &partials) {
            Ok(tuple) => {
                let folder = self.run.dir.tuple(&job.line.id);
                write_tuple(&tuple, &folder).map_err(|e| FarmError::Tuple(e.to_string()))?;
                remove_partials(&self.run.dir.partials(&job.line.id));
                self.merged.fetch_add(1, Ordering::Relaxed);
                let layers = tuple.record.layers.values();
                (self.on_event)(Event::SceneMerged {
                    scene: job.line.id.clone(),
                    miss_share: layers.map(|layer| layer.miss_share).fold(0.0, f64::max),
                });
            }
            Err(error) => {
                job.fail();
                self.quarantine(job.line, &error.to_string());
            }
        }
        self.open.fetch_sub(1, Ordering::AcqRel);
        self.seconds.add_merge(start.elapsed());
        Ok(())
    }
}

/// Errors about a file name it; those about the scene as a whole need its files' names beside them.
fn load_reason(line: &SceneLine, error: &LoadError) -> String {
    match error {
        LoadError::Assemble(error) => format!(
            "{error} (front is {}, back is {})",
            line.front.name(),
            line.back.name()
        ),
        error => error.to_string(),
    }
}

fn panic_reason(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic
        .downcast_ref::<&str>()
        .map(|text| (*text).to_owned())
        .or_else(|| panic.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "no message".to_owned());
    format!(
        "the program failed on this scene ({text}); please report it with the scene's manifest line"
    )
}
