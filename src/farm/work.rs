//! A worker: one process, some threads, until nothing is left to do.
//!
//! Three threads wait so that no other has to: one takes spans from the queue and reads their scenes' files (`intake`),
//! one writes what is encoded (`writer`), and beside a shared queue one keeps the leases and gives work away (`leases`).
//! The others compute, and nothing else (`hand`). At most one scene a computing thread is in memory, scene N + 1 is read
//! while N is traced, and the last shards are shared by all threads.
//!
//! Of results there wait for the store at most one a thread in the channel, one with each thread and one with the
//! writer, each a partial or a scene's tuple, encoded.

use super::error::FarmError;
use super::fault::Fault;
use super::hand::{Band, Hand};
use super::held::HeldSpans;
use super::queue::{LocalQueue, Queue, QueueKeeper, Waiting};
use super::shared::Shared;
use super::suspect::Isolate;
use super::sweep::sweep;
use super::work_log::work_log;
use crate::run::AccessError;
use crate::run::Span;
use crate::run::Stop;
use crate::run::attempts::WorkerName;
use crate::run::control::{ControlFlag, ControlLook};
use crate::run::done::is_done;
use crate::run::events::{Event, StageSeconds};
use crate::run::keys;
use crate::run::quarantine::QuarantineRecord;
use crate::run::run_dir::Run;
use crate::run::work_log::{LogTime, SceneSeconds};
use crate::store::Store;
use crossbeam::channel::bounded;
use crossbeam::deque::{Injector, Worker};
use render::ids::SceneId;
use render::merge::SrgbEncoder;
use render::shard::golden;
use render::trace::Isa;
use std::collections::BTreeSet;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
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
    Err(FarmError::from(AccessError::Golden {
        scene: run.spec.golden.scene.clone(),
        found: found.blake3,
        expected: run.spec.golden.blake3.clone(),
    }))
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
        scene_seconds: SceneSeconds::default(),
    };
    let began = LogTime::now();
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
    let scenes = shared.scene_seconds.of(run);
    let outcome = shared.outcome()?;
    let is_child = shared_queue.is_some_and(|queue| queue.is_child);
    work_log(&outcome, options, scenes, is_child, &began).leave(store);
    Ok(outcome)
}
