//! A worker: one process, some threads, until nothing is left to do.
//!
//! Three threads wait so that no other has to: one takes spans from the queue and reads their scenes' files (`intake`),
//! one writes what is encoded (`writer`), and beside a shared queue one keeps the leases and gives work away (`leases`).
//! The others compute, and nothing else (`hand`). At most one scene a computing thread is in memory, scene N + 1 is read
//! while N is traced, and the last shards are shared by all threads.
//!
//! Of results there wait for the store at most one a thread in the channel, one with each thread and one with the
//! writer, each a partial or a scene's tuple, encoded.

use super::attempts::WorkerName;
use super::control::{ControlFlag, ControlLook};
use super::done::is_done;
use super::error::FarmError;
use super::events::{Event, StageSeconds, Stopwatch};
use super::fault::Fault;
use super::finished::FinishedScene;
use super::hand::{Band, Hand};
use super::held::{Costs, HeldSpans};
use super::intake::Loaded;
use super::keys;
use super::made_by::MadeBy;
use super::open_span::OpenSpan;
use super::quarantine::QuarantineRecord;
use super::queue::{LocalQueue, Queue, QueueKeeper, Waiting};
use super::receipt::Receipt;
use super::run_dir::Run;
use super::span::Span;
use super::suspect::Isolate;
use super::sweep::sweep;
use super::writer::{Order, What, remove_partials};
use crate::ids::SceneId;
use crate::manifest::SceneLine;
use crate::merge::SrgbEncoder;
use crate::shard::golden;
use crate::store::Store;
use crate::trace::Isa;
use crossbeam::channel::{Receiver, bounded};
use crossbeam::deque::{Injector, Stealer, Worker};
use std::collections::BTreeSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::{Duration, Instant};

/// How to work.
#[derive(Clone)]
pub struct WorkOptions<'a> {
    /// Threads that decode, trace and encode. One more reads files and one writes them.
    pub threads: usize,
    /// Kernels to use.
    pub isa: Isa,
    /// Set from outside to stop after the shards in flight.
    pub stop: &'a AtomicBool,
    /// No shard is begun after this time.
    pub deadline: Option<Instant>,
    /// Who works, for attempts and receipts.
    pub who: WorkerName,
    /// A span without any progress for this time counts as hung.
    pub hang: Duration,
    /// Partials of a scene that is here as a whole wait in memory for so long, for its other shards.
    pub checkpoint: Duration,
    /// Traces spans that may be dangerous in another process; without it they are traced in this one.
    pub isolate: Option<&'a dyn Isolate>,
    /// How to misbehave.
    pub faults: &'a [Fault],
}

/// A partial of 9 MB costs some 0.04 s of a core; a worker that is killed once an hour loses half of this time each time.
/// The best is the root of twice the one times the other (Young, Communications of the ACM 17, 1974), 17 s.
const CHECKPOINT: Duration = Duration::from_secs(20);

impl<'a> WorkOptions<'a> {
    /// Without a deadline, in one process.
    pub fn new(threads: usize, isa: Isa, stop: &'a AtomicBool) -> Self {
        Self {
            threads,
            isa,
            stop,
            deadline: None,
            who: WorkerName {
                worker: "local".to_owned(),
                host: "local".to_owned(),
            },
            hang: Duration::from_mins(2),
            checkpoint: CHECKPOINT,
            isolate: None,
            faults: &[],
        }
    }
}

/// A queue that other workers take from, too.
pub struct SharedQueue<'a> {
    /// This worker's end of it.
    pub queue: &'a dyn Queue,
    /// What is held for longer, and not renewed, is given to somebody else.
    pub lease: Duration,
    /// Called when a span is hung. It must end the process: the thread cannot be stopped.
    pub on_hung: &'a (dyn Fn(&str) + Sync),
    /// Called before leases are renewed, three times a lease.
    pub on_sign: &'a (dyn Fn() + Sync),
    /// This process was started by a worker, which records what comes of it.
    pub is_child: bool,
}

/// Why work ended before the end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// `stop` was set.
    Asked,
    /// The deadline passed.
    TimeLimit,
    /// Too many scenes failed here.
    Drained,
    /// The run was cancelled.
    Cancelled,
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
    /// Scenes loaded; one that several workers share is loaded by each.
    pub loaded: u64,
    /// Spans given to other workers, while working or at the end.
    pub given: u64,
    /// Scenes in quarantine, those of earlier times included, with their reasons.
    pub quarantined: Vec<(SceneId, String)>,
    /// Ended early.
    pub stopped: Option<Stop>,
    /// Where the threads' seconds went.
    pub seconds: StageSeconds,
}

pub(super) struct Shared<'a> {
    pub(super) run: &'a Run,
    pub(super) store: &'a Store,
    pub(super) queue: &'a dyn Queue,
    /// Other workers are there.
    pub(super) beside: Option<&'a SharedQueue<'a>>,
    pub(super) options: &'a WorkOptions<'a>,
    pub(super) on_event: &'a (dyn Fn(Event) + Sync),
    pub(super) files: Receiver<Loaded<'a>>,
    pub(super) stealers: Vec<Stealer<Band<'a>>>,
    /// Before all else: what is traced is to become durable soon, and its memory free.
    pub(super) to_encode: Injector<(Arc<FinishedScene<'a>>, usize)>,
    /// Scenes whose last shards others have traced.
    pub(super) to_complete: Injector<Arc<OpenSpan<'a>>>,
    /// Spans whose partials are to be written.
    pub(super) to_checkpoint: Injector<Arc<OpenSpan<'a>>>,
    pub(super) encoder: SrgbEncoder,
    pub(super) held: HeldSpans<'a>,
    /// Spans that are loaded, or being loaded, and have not ended.
    pub(super) open: AtomicUsize,
    pub(super) merged: AtomicU64,
    pub(super) found_merged: AtomicU64,
    pub(super) traced: AtomicU64,
    pub(super) resumed: AtomicU64,
    pub(super) given: AtomicU64,
    pub(super) loads: AtomicU64,
    /// Those of children, which did not cost this process anything.
    pub(super) isolated_loads: AtomicU64,
    pub(super) timed_out: AtomicBool,
    pub(super) drained: AtomicBool,
    /// There is nothing to do here, and nothing in the queue.
    pub(super) hungry: AtomicBool,
    /// Somebody has published something because this worker asked.
    pub(super) promised: AtomicBool,
    /// In which time other workers load a scene; 0 if none has told.
    pub(super) others_load_us: AtomicU64,
    /// Scenes that failed since the last one that did not.
    failing: Mutex<BTreeSet<SceneId>>,
    /// What the run has been told.
    pub(super) control: ControlFlag,
    pub(super) quarantined: Mutex<Vec<(SceneId, String)>>,
    pub(super) failure: Mutex<Option<FarmError>>,
    pub(super) broken: AtomicBool,
    /// The threads that compute have gone home.
    pub(super) over: AtomicBool,
    pub(super) seconds: StageSeconds,
}

/// Traces and merges all that the run lacks, alone.
pub fn work(
    run: &Run,
    options: &WorkOptions,
    on_event: &(dyn Fn(Event) + Sync),
) -> Result<Outcome, FarmError> {
    let _lock = run.lock()?;
    check_golden(run, options)?;
    sweep(run);
    let store = Store::local(run.dir.root())?;
    let queue = LocalQueue::new(None);
    let (mut quarantined, mut already_merged) = (Vec::new(), 0);
    let tried = scenes_tried(&store)?;
    let (mut shards, mut waiting, mut suspects) = (0, Vec::new(), Vec::new());
    for (scene, line) in run.lines.iter().enumerate() {
        if is_done(&store, line)? {
            already_merged += 1;
        } else if let Some(record) = QuarantineRecord::read(&run.dir, &line.id) {
            quarantined.push((line.id.clone(), record.reason));
        } else {
            // What stands there is no tuple of this scene, and nobody else works here.
            let _ = std::fs::remove_dir_all(run.dir.tuple(&line.id));
            shards += u64::from(run.layout(line).len());
            // Nobody else works here: an attempt that stands was lost.
            if tried.contains(&line.id) {
                suspects.push(whole(run, scene));
            } else {
                waiting.push(whole(run, scene));
            }
        }
    }
    on_event(Event::Started {
        shards,
        scenes: (waiting.len() + suspects.len()) as u64,
    });
    queue.publish(&waiting)?;
    queue.publish_suspects(&suspects);
    let worker = queue.worker();
    let mut outcome = work_on(run, &store, &worker, None, options, on_event)?;
    outcome.already_merged += already_merged;
    outcome.quarantined.extend(quarantined);
    outcome.quarantined.sort();
    Ok(outcome)
}

/// Works on what a queue gives until the run is over, beside other workers.
pub fn work_shared(
    run: &Run,
    store: &Store,
    shared: &SharedQueue,
    options: &WorkOptions,
    on_event: &(dyn Fn(Event) + Sync),
) -> Result<Outcome, FarmError> {
    check_golden(run, options)?;
    let shards = run.lines.iter().map(|l| u64::from(run.layout(l).len()));
    on_event(Event::Started {
        shards: shards.sum(),
        scenes: run.lines.len() as u64,
    });
    work_on(run, store, shared.queue, Some(shared), options, on_event)
}

/// Works on what is in a queue that this process has for itself, of a run on which others work, too. Nothing is recorded
/// of it: that is for who started this process.
pub fn work_span(
    run: &Run,
    store: &Store,
    shared: &SharedQueue,
    options: &WorkOptions,
    on_event: &(dyn Fn(Event) + Sync),
) -> Result<Outcome, FarmError> {
    work_on(run, store, shared.queue, Some(shared), options, on_event)
}

/// Scenes with a record of an attempt.
fn scenes_tried(store: &Store) -> Result<BTreeSet<SceneId>, FarmError> {
    let there = store.list(keys::ATTEMPTS)?;
    let scenes = there.iter().filter_map(|key| key.split('/').nth(1));
    Ok(scenes.filter_map(|id| SceneId::new(id).ok()).collect())
}

/// All of a scene.
pub(super) fn whole(run: &Run, scene: usize) -> Waiting {
    let shards = 0..run.layout(&run.lines[scene]).len();
    Waiting {
        span: Span {
            scene: scene as u32,
            shards,
        },
        handed_on: 0,
    }
}

pub(super) fn check_golden(run: &Run, options: &WorkOptions) -> Result<(), FarmError> {
    let found = golden(options.isa, options.threads.max(1));
    if found == run.spec.golden {
        return Ok(());
    }
    Err(FarmError::Golden {
        scene: run.spec.golden.scene.clone(),
        found: found.blake3,
        expected: run.spec.golden.blake3.clone(),
    })
}

fn work_on(
    run: &Run,
    store: &Store,
    queue: &dyn Queue,
    shared_queue: Option<&SharedQueue>,
    options: &WorkOptions,
    on_event: &(dyn Fn(Event) + Sync),
) -> Result<Outcome, FarmError> {
    let threads = options.threads.max(1);
    let (sender, files) = bounded(threads);
    let (writer, orders) = bounded(threads);
    let deques: Vec<Worker<Band>> = (0..threads).map(|_| Worker::new_fifo()).collect();
    let shared = Shared {
        run,
        store,
        queue,
        beside: shared_queue,
        options,
        on_event,
        files,
        stealers: deques.iter().map(Worker::stealer).collect(),
        to_encode: Injector::new(),
        to_complete: Injector::new(),
        to_checkpoint: Injector::new(),
        encoder: SrgbEncoder::new(),
        held: HeldSpans::default(),
        open: AtomicUsize::new(0),
        merged: AtomicU64::new(0),
        found_merged: AtomicU64::new(0),
        traced: AtomicU64::new(0),
        resumed: AtomicU64::new(0),
        given: AtomicU64::new(0),
        loads: AtomicU64::new(0),
        isolated_loads: AtomicU64::new(0),
        timed_out: AtomicBool::new(false),
        drained: AtomicBool::new(false),
        hungry: AtomicBool::new(false),
        promised: AtomicBool::new(false),
        others_load_us: AtomicU64::new(0),
        failing: Mutex::default(),
        control: ControlFlag::default(),
        quarantined: Mutex::default(),
        failure: Mutex::new(None),
        broken: AtomicBool::new(false),
        over: AtomicBool::new(false),
        seconds: StageSeconds::begin(),
    };
    let mut control = ControlLook::default();
    shared.look_at_control(&mut control);
    let (working, ended) = bounded(0);
    std::thread::scope(|scope| {
        let shared = &shared;
        scope.spawn(move || shared.watch_control(control, &ended));
        scope.spawn(move || shared.take_in(&sender));
        if let Some(queue) = shared.beside {
            scope.spawn(move || shared.keep_leases(queue));
        }
        let writing = scope.spawn(move || shared.write(&orders));
        let hands: Vec<_> = deques
            .into_iter()
            .enumerate()
            .map(|(index, deque)| {
                let hand = Hand {
                    farm: shared,
                    index,
                    deque,
                    writer: writer.clone(),
                };
                scope.spawn(move || hand.work())
            })
            .collect();
        // The writer goes home when the last hand has.
        drop(writer);
        let panics = hands
            .into_iter()
            .map(|hand| hand.join().is_err())
            .filter(|p| *p);
        let panicked = panics.count() > 0 || writing.join().is_err();
        shared.over.store(true, Ordering::Release);
        drop(working);
        assert!(!panicked, "a thread of the farm panicked");
    });
    let back = if shared.control.is_cancelled() {
        // Nothing is wanted back.
        shared.held.forget(store);
        0
    } else {
        // If the server is away, the leases end by themselves.
        // Nor is a store waited for that has just been in vain.
        let hurried = store.with_patience(Duration::ZERO);
        let back = shared.held.hand_back(queue, &hurried, &options.who);
        back.unwrap_or(0)
    };
    if shared_queue.is_some() {
        shared.given.fetch_add(u64::from(back), Ordering::Relaxed);
    }
    shared.outcome()
}

impl<'a> Shared<'a> {
    fn outcome(self) -> Result<Outcome, FarmError> {
        let failure = self.failure.into_inner();
        if let Some(error) = failure.expect("no holder of this lock panics") {
            return Err(error);
        }
        let stopped = if self.drained.into_inner() {
            Some(Stop::Drained)
        } else if self.options.stop.load(Ordering::Relaxed) {
            Some(Stop::Asked)
        } else if self.control.is_cancelled() {
            Some(Stop::Cancelled)
        } else {
            let timed_out = self.timed_out.load(Ordering::Relaxed);
            timed_out.then_some(Stop::TimeLimit)
        };
        let quarantined = self.quarantined.into_inner();
        let mut quarantined = quarantined.expect("no holder of this lock panics");
        quarantined.sort();
        Ok(Outcome {
            merged: self.merged.into_inner(),
            already_merged: self.found_merged.into_inner(),
            traced: self.traced.into_inner(),
            resumed: self.resumed.into_inner(),
            loaded: self.loads.into_inner() + self.isolated_loads.into_inner(),
            given: self.given.into_inner(),
            quarantined,
            stopped,
            seconds: self.seconds,
        })
    }

    /// No further shard may be begun.
    pub(super) fn must_stop(&self) -> bool {
        if self
            .options
            .deadline
            .is_some_and(|deadline| Instant::now() >= deadline)
        {
            self.timed_out.store(true, Ordering::Relaxed);
        }
        self.options.stop.load(Ordering::Relaxed)
            || self.timed_out.load(Ordering::Relaxed)
            || self.drained.load(Ordering::Relaxed)
            || self.broken.load(Ordering::Relaxed)
            || self.control.is_cancelled()
    }

    /// Spans to have read before they are needed. Beside other workers nothing is hoarded.
    pub(super) fn ahead(&self) -> usize {
        self.options.threads.div_ceil(4)
    }

    /// What a shard and a scene cost this worker so far.
    pub(super) fn costs(&self) -> Costs {
        let seconds = self.seconds.all();
        let of = |stage: &str| {
            let found = seconds.iter().find(|(name, _)| *name == stage);
            found.map_or(0.0, |(_, s)| *s)
        };
        let mean = |sum: f64, count: &AtomicU64, guess: f64| match count.load(Ordering::Relaxed) {
            0 => guess,
            n => sum / n as f64,
        };
        Costs {
            shard_s: mean(of("trace"), &self.traced, 0.4),
            threads: self.options.threads.max(1) as f64,
            load_s: mean(of("read") + of("decode"), &self.loads, 0.1),
            load_is_known: self.loads.load(Ordering::Relaxed) > 0,
        }
    }

    /// Writes all that is ordered, also after a stop; once the farm is broken only takes it, so that nobody waits.
    fn write(&self, orders: &Receiver<Order<'a>>) {
        for Order { span, what } in orders {
            if self.broken.load(Ordering::Relaxed) {
                continue;
            }
            let line = span.job.line;
            let start = Stopwatch::start();
            self.step(&span, || match what {
                What::Partial { .. } if span.is_merged() => Ok(()),
                What::Partial { shard, bytes } => {
                    let put = self.put_partial(&span, shard, &bytes.into());
                    if put.is_err() && self.is_done_elsewhere(&span)? {
                        // Its folder went while this was being written.
                        return Ok(());
                    }
                    if !put? {
                        return Ok(());
                    }
                    self.seconds.add_checkpoint(start.spent());
                    if span.stored() {
                        self.end_in_part(&span)?;
                    }
                    Ok(())
                }
                What::Tuple { files, miss_share } => {
                    if !self.put_tuple(&span, files)? {
                        return Ok(());
                    }
                    span.merged();
                    self.leave_receipt(&span);
                    remove_partials(self.store, line);
                    self.seconds.add_merge(start.spent());
                    self.merged.fetch_add(1, Ordering::Relaxed);
                    self.went_well();
                    (self.on_event)(Event::SceneMerged {
                        scene: line.id.clone(),
                        miss_share,
                    });
                    self.close(span.delivery.ticket);
                    Ok(())
                }
            });
        }
    }

    /// A span's own shards are durable: whoever finds all of the scene's shards there completes it.
    pub(super) fn end_in_part(&self, span: &Arc<OpenSpan<'a>>) -> Result<(), FarmError> {
        let line = span.job.line;
        let there = self.store.list(&keys::partials(&line.id))?;
        let shards = there.iter().filter_map(|key| keys::shard_of(key)).count();
        if shards >= span.job.layout.len() as usize {
            self.to_complete.push(Arc::clone(span));
        } else if !self.is_done_elsewhere(span)? {
            let (store, mine) = (self.store, &span.delivery.waiting.span);
            MadeBy::leave(store, &line.id, mine, &self.options.who);
            self.went_well();
            self.close(span.delivery.ticket);
        }
        Ok(())
    }

    /// Another worker has made the scene's tuple: this one slept, and what it still holds is of no use. True if so; the
    /// span is closed then.
    fn is_done_elsewhere(&self, span: &OpenSpan<'a>) -> Result<bool, FarmError> {
        let line = span.job.line;
        if self.beside.is_none() || !is_done(self.store, line)? {
            return Ok(false);
        }
        if !span.job.failed().swap(true, Ordering::AcqRel) {
            remove_partials(self.store, line);
            self.close(span.delivery.ticket);
        }
        Ok(true)
    }

    /// An open span has ended.
    pub(super) fn close(&self, ticket: u64) {
        self.let_go(ticket);
        self.open.fetch_sub(1, Ordering::AcqRel);
    }

    pub(super) fn failing(&self) -> MutexGuard<'_, BTreeSet<SceneId>> {
        self.failing.lock().expect("no holder of this lock panics")
    }

    /// Does a piece of a span's work; a panic in it costs its scene, not the farm.
    pub(super) fn step(&self, span: &OpenSpan<'a>, work: impl FnOnce() -> Result<(), FarmError>) {
        self.held.touch(span.delivery.ticket);
        match catch_unwind(AssertUnwindSafe(work)) {
            Ok(Ok(())) => {}
            Ok(Err(error)) => self.break_down(error),
            Err(panic) => self.fail(span, &panic_reason(&*panic)),
        }
        self.held.touch(span.delivery.ticket);
    }

    /// The scene of an open span cannot be done.
    pub(super) fn fail(&self, span: &OpenSpan<'a>, reason: &str) {
        if !span.job.failed().swap(true, Ordering::AcqRel) {
            self.quarantine(span.job.line, reason);
            self.close(span.delivery.ticket);
        }
    }

    pub(super) fn break_down(&self, error: FarmError) {
        self.broken.store(true, Ordering::Relaxed);
        self.failure
            .lock()
            .expect("no holder of this lock panics")
            .get_or_insert(error);
    }

    pub(super) fn quarantine(&self, line: &SceneLine, reason: &str) {
        if let Err(error) = QuarantineRecord::put(self.store, &line.id, reason) {
            self.break_down(error.into());
            return;
        }
        self.tell_quarantine(line, reason);
    }

    pub(super) fn tell_quarantine(&self, line: &SceneLine, reason: &str) {
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

    /// Beside other workers: who made the tuple. Nothing depends on it.
    fn leave_receipt(&self, span: &OpenSpan) {
        if self.beside.is_some() {
            let (scene, who) = (&span.job.line.id, &self.options.who);
            let receipt = Receipt::new(self.store, scene, who, span.is_alone());
            let _ = receipt.put(self.store, scene);
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
