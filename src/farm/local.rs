//! The local farm: one process, some threads, no server.
//!
//! Two extra threads wait for the disk: one reads the files of scenes to come, one writes what is encoded. A worker
//! thread computes, and nothing else: it encodes a file of a finished scene if there is one, else traces a band of a
//! shard from its own deque, else steals one from the others', and only when there is nothing to steal does it decode
//! the next scene and fill its own deque. So at most one scene a thread is in memory, scene N + 1 is read while N is
//! traced, and the last shards of a run are shared by all threads.
//!
//! Of results there wait for the disk at most one a thread in the channel, one with each thread and one with the
//! writer, each a partial or a scene's tuple, encoded.

use super::events::{Event, StageSeconds};
use super::finished::FinishedScene;
use super::job::SceneJob;
use super::quarantine::QuarantineRecord;
use super::run_dir::{Run, RunError};
use super::sweep::sweep;
use super::writer::{Order, What};
use crate::atomic_file::{self, WriteError};
use crate::ids::SceneId;
use crate::manifest::SceneLine;
use crate::merge::{SrgbEncoder, combine, is_written};
use crate::partial::{self, Partial};
use crate::scene::{LoadError, SceneFiles, load, read_files};
use crate::shard::{Shard, golden};
use crate::trace::{Isa, TileResult};
use crossbeam::channel::{Receiver, Sender, TryRecvError, bounded};
use crossbeam::deque::{Injector, Steal, Stealer, Worker};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// How to work.
pub struct WorkOptions<'a> {
    /// Threads that decode, trace and encode. One more reads files and one writes them.
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
    stealers: Vec<Stealer<Band<'a>>>,
    /// Before all else: what is traced is to become durable soon, and its memory free.
    to_encode: Injector<(Arc<FinishedScene<'a>>, usize)>,
    encoder: SrgbEncoder,
    /// Scenes that are loaded, or being loaded, and neither handed to the writer nor failed.
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

/// One band of a shard of a loaded scene.
struct Band<'a> {
    job: Arc<SceneJob<'a>>,
    shard: u32,
    /// From the top.
    index: u32,
}

/// A thread that computes.
struct Hand<'s, 'a> {
    farm: &'s Shared<'a>,
    index: usize,
    deque: Worker<Band<'a>>,
    writer: Sender<Order<'a>>,
}

/// Traces and merges all that the run lacks.
pub fn work(
    run: &Run,
    options: &WorkOptions,
    on_event: &(dyn Fn(Event) + Sync),
) -> Result<Outcome, FarmError> {
    let _lock = run.lock()?;
    let threads = options.threads.max(1);
    let found = golden(options.isa, threads);
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
    let (sender, files) = bounded(threads);
    let (writer, orders) = bounded(threads);
    let deques: Vec<Worker<Band>> = (0..threads).map(|_| Worker::new_fifo()).collect();
    let shared = Shared {
        run,
        options,
        on_event,
        files,
        stealers: deques.iter().map(Worker::stealer).collect(),
        to_encode: Injector::new(),
        encoder: SrgbEncoder::new(),
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
        scope.spawn(move || shared.write(&orders));
        for (index, deque) in deques.into_iter().enumerate() {
            let hand = Hand {
                farm: shared,
                index,
                deque,
                writer: writer.clone(),
            };
            scope.spawn(move || hand.work());
        }
        // The writer goes home when the last worker has.
        drop(writer);
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

    /// Writes all that is ordered, also after a stop; once the farm is broken only takes it, so that nobody waits.
    fn write(&self, orders: &Receiver<Order<'a>>) {
        for order in orders {
            if self.broken.load(Ordering::Relaxed) {
                continue;
            }
            let start = Instant::now();
            match catch_unwind(AssertUnwindSafe(|| order.write(&self.run.dir))) {
                Ok(Ok(())) => {}
                Ok(Err(error)) => {
                    self.break_down(error);
                    continue;
                }
                Err(panic) => {
                    if !order.failed.swap(true, Ordering::AcqRel) {
                        self.quarantine(order.line, &panic_reason(&*panic));
                    }
                    continue;
                }
            }
            match order.what {
                What::Partial { .. } => self.seconds.add_checkpoint(start.elapsed()),
                What::Tuple { miss_share, .. } => {
                    self.seconds.add_merge(start.elapsed());
                    self.merged.fetch_add(1, Ordering::Relaxed);
                    (self.on_event)(Event::SceneMerged {
                        scene: order.line.id.clone(),
                        miss_share,
                    });
                }
            }
        }
    }

    /// Does a piece of a scene's work; a panic in it costs that scene, not the farm.
    fn step(
        &self,
        line: &SceneLine,
        failed: &AtomicBool,
        work: impl FnOnce() -> Result<(), FarmError>,
    ) {
        match catch_unwind(AssertUnwindSafe(work)) {
            Ok(Ok(())) => {}
            Ok(Err(error)) => self.break_down(error),
            Err(panic) => self.fail(line, failed, &panic_reason(&*panic)),
        }
    }

    /// An open scene cannot be done.
    fn fail(&self, line: &SceneLine, failed: &AtomicBool, reason: &str) {
        if !failed.swap(true, Ordering::AcqRel) {
            self.quarantine(line, reason);
            self.open.fetch_sub(1, Ordering::AcqRel);
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
}

impl<'a> Hand<'_, 'a> {
    fn work(&self) {
        let farm = self.farm;
        while !farm.broken.load(Ordering::Relaxed) {
            if let Some((scene, file)) = take(|| farm.to_encode.steal()) {
                farm.step(scene.line, &scene.failed, || self.encode(&scene, file));
                continue;
            }
            if let Some(band) = self.deque.pop().or_else(|| self.steal()) {
                let job = &band.job;
                farm.step(job.line, job.failed(), || self.trace(&band));
                continue;
            }
            if farm.must_stop() {
                return;
            }
            // Counted before it is taken, so that nobody goes home while a scene may still be shared out.
            farm.open.fetch_add(1, Ordering::AcqRel);
            match farm.files.try_recv() {
                Ok((line, files)) => self.open_scene(line, files),
                Err(error) => {
                    let open = farm.open.fetch_sub(1, Ordering::AcqRel) - 1;
                    if error == TryRecvError::Disconnected && open == 0 {
                        return;
                    }
                    std::thread::sleep(Duration::from_micros(500));
                }
            }
        }
    }

    fn steal(&self) -> Option<Band<'a>> {
        let stealers = &self.farm.stealers;
        let count = stealers.len();
        (1..count).find_map(|offset| take(|| stealers[(self.index + offset) % count].steal()))
    }

    /// Waits while the channel is full. The writer takes orders until the last worker has gone home.
    fn order(&self, line: &'a SceneLine, failed: &Arc<AtomicBool>, what: What) {
        let order = Order {
            line,
            failed: Arc::clone(failed),
            what,
        };
        if self.writer.send(order).is_err() {
            // Its thread panicked, which the scope that joins it tells.
            self.farm.broken.store(true, Ordering::Relaxed);
        }
    }

    /// Decodes a scene, takes up what is on disk, and puts the missing shards' bands into the deque.
    fn open_scene(&self, line: &'a SceneLine, files: Result<SceneFiles, LoadError>) {
        let farm = self.farm;
        let start = Instant::now();
        let loaded = catch_unwind(AssertUnwindSafe(|| {
            files.and_then(|files| load(line, &files))
        }));
        farm.seconds.add_decode(start.elapsed());
        let job = match loaded {
            Ok(Ok(loaded)) => Arc::new(SceneJob::new(line, farm.run.layout(line), loaded)),
            Ok(Err(error)) => {
                farm.fail(line, &AtomicBool::new(false), &load_reason(line, &error));
                return;
            }
            Err(panic) => {
                farm.fail(line, &AtomicBool::new(false), &panic_reason(&*panic));
                return;
            }
        };
        let folder = farm.run.dir.partials(&line.id);
        if let Err(error) = atomic_file::create_dir(&folder) {
            farm.break_down(error.into());
            return;
        }
        for shard in job.layout.shards() {
            let path = farm.run.dir.partial(&line.id, shard.index);
            if let Ok(bytes) = std::fs::read(&path) {
                let reason = match partial::decode(&path, &bytes) {
                    Ok(found) if job.accepts(&shard, &found) => {
                        farm.resumed.fetch_add(1, Ordering::Relaxed);
                        (farm.on_event)(Event::ShardDone { resumed: true });
                        job.count_traced();
                        if let Some(partials) = job.finish(found) {
                            farm.step(line, job.failed(), || {
                                self.merge(&job, &partials);
                                Ok(())
                            });
                        }
                        continue;
                    }
                    Ok(_) => format!(
                        "partial {} belongs to other inputs or another spec; it will be traced again",
                        path.display()
                    ),
                    Err(error) => error.to_string(),
                };
                (farm.on_event)(Event::PartialRejected { reason });
            }
            for index in 0..job.bands(shard.index) {
                self.deque.push(Band {
                    job: Arc::clone(&job),
                    shard: shard.index,
                    index,
                });
            }
        }
    }

    fn trace(&self, band: &Band<'a>) -> Result<(), FarmError> {
        let (farm, job) = (self.farm, &band.job);
        if job.has_failed() || !job.may_trace(band.shard, farm.must_stop()) {
            return Ok(());
        }
        let shard = job.layout.shard(band.shard);
        let start = Instant::now();
        let result = job.trace_band(&shard, band.index, farm.options.isa);
        farm.seconds.add_trace(start.elapsed());
        match result {
            Some(result) => self.finish(job, &shard, result),
            None => Ok(()),
        }
    }

    /// A shard is traced: its partial goes to the writer, but that of the scene's last shard, since the tuple follows
    /// at once. A process that is killed in between has lost one shard, as if it were killed in tracing it.
    fn finish(
        &self,
        job: &Arc<SceneJob<'a>>,
        shard: &Shard,
        result: TileResult,
    ) -> Result<(), FarmError> {
        let farm = self.farm;
        let partial = if job.count_traced() {
            job.partial_in_memory(shard, result)
        } else {
            let start = Instant::now();
            let partial = job.partial(shard, result);
            let bytes = partial::encode(&partial).map_err(|e| {
                let path = farm.run.dir.partial(&job.line.id, shard.index);
                FarmError::Tuple(format!("cannot encode {}: {e}", path.display()))
            })?;
            farm.seconds.add_checkpoint(start.elapsed());
            let shard = shard.index;
            self.order(job.line, job.failed(), What::Partial { shard, bytes });
            partial
        };
        farm.traced.fetch_add(1, Ordering::Relaxed);
        (farm.on_event)(Event::ShardDone { resumed: false });
        if let Some(partials) = job.finish(partial) {
            self.merge(job, &partials);
        }
        Ok(())
    }

    /// All shards are there: combines them and shares out the encoding.
    fn merge(&self, job: &SceneJob<'a>, partials: &[Partial]) {
        let farm = self.farm;
        let start = Instant::now();
        let combined = combine(job.line, farm.run.spec.tile_px, partials);
        farm.seconds.add_merge(start.elapsed());
        match combined {
            Ok(tuple) => {
                let failed = Arc::clone(job.failed());
                let scene = Arc::new(FinishedScene::new(job.line, failed, tuple));
                for file in 0..scene.len() {
                    farm.to_encode.push((Arc::clone(&scene), file));
                }
            }
            Err(error) => farm.fail(job.line, job.failed(), &error.to_string()),
        }
    }

    fn encode(&self, scene: &FinishedScene<'a>, file: usize) -> Result<(), FarmError> {
        let farm = self.farm;
        let start = Instant::now();
        let files = scene.encode(file, &farm.encoder)?;
        farm.seconds.add_merge(start.elapsed());
        if let Some(files) = files {
            let miss_share = scene.miss_share();
            self.order(scene.line, &scene.failed, What::Tuple { files, miss_share });
            farm.open.fetch_sub(1, Ordering::AcqRel);
        }
        Ok(())
    }
}

/// Takes a task from a queue that others take from, too.
fn take<T>(steal: impl Fn() -> Steal<T>) -> Option<T> {
    loop {
        match steal() {
            Steal::Success(task) => return Some(task),
            Steal::Empty => return None,
            Steal::Retry => {}
        }
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
