//! Runs a worker's threads until the run is over.

use super::bell::Bell;
use super::core::Worker;
use super::jobs::Band;
use super::lease_keeper::LeaseKeeper;
use super::options::{Outcome, SharedQueue, WorkOptions};
use super::pool::{ComputeThread, Pool};
use super::prefetch::{Appetite, Prefetcher};
use super::stop::StopSigns;
use super::tally::Tally;
use super::tasks::Tasks;
use super::writer::Writer;
use crate::farm::FarmError;
use crate::farm::queue::{LocalQueue, Message, Queue, QueueKeeper};
use crate::farm::sweep::sweep;
use crate::run::{
    AccessError, ControlPoll, Event, LogTime, Run, RunError, Scope, Snapshot, Task,
    WORK_LOG_SCHEMA, WorkLog, keys,
};
use crate::store::Store;
use crossbeam::channel::bounded;
use crossbeam::deque::{Injector, Worker as Deque};
use glasshouse_line::color::SrgbEncoder;
use glasshouse_line::ids::SceneId;
use render::scene::PhotographCache;
use render::shard::golden_of;
use render::trace::TRACER_VERSION;
use std::cell::Cell;
use std::collections::BTreeSet;
use std::sync::Mutex;
use std::sync::atomic::Ordering;
use std::thread::{self, Scope as ThreadScope, ScopedJoinHandle};
use std::time::{Duration, Instant, SystemTime};

/// Makes everything that the run lacks, as its only worker.
pub fn work(
    run: &Run,
    options: &WorkOptions,
    on_event: &(dyn Fn(Event) + Sync),
) -> Result<Outcome, FarmError> {
    let lock = run.lock()?;
    check_golden(run, options)?;
    sweep(run);
    let store = Store::local(run.root())?;
    let queue = LocalQueue::new(None);
    let scope = Scope { workers: true, ..Scope::DONE };
    let snapshot = Snapshot::take(run, &store, scope)?;
    // No other process works on this run, so the process of every recorded attempt is gone.
    let lost: BTreeSet<&SceneId> = snapshot.attempts().map(|a| &a.record.scene).collect();
    let (mut shards, mut waiting, mut suspects) = (0, Vec::new(), Vec::new());
    for scene in snapshot.missing() {
        let id = &run.lines[scene].id;
        // The scene has no tuple and no other process writes one, so the files in its folder are useless.
        store.remove_folder(&keys::tuple_folder(id))?;
        shards += u64::from(snapshot.shards(scene));
        if lost.contains(id) {
            suspects.push(whole(run, scene));
        } else {
            waiting.push(whole(run, scene));
        }
    }
    on_event(Event::Started { shards, scenes: (waiting.len() + suspects.len()) as u64 });
    queue.publish(&waiting)?;
    queue.publish_redelivered(&suspects);
    let worker = queue.worker();
    let mut outcome = work_on(run, &store, &worker, None, options, on_event)?;
    outcome.already_merged += snapshot.counts().merged;
    let reason = |scene: usize| {
        let reason = snapshot.reason(scene)?.to_owned();
        Some((run.lines[scene].id.clone(), reason))
    };
    let before = (0..run.lines.len()).filter_map(reason);
    outcome.quarantined.extend(before);
    outcome.quarantined.sort();
    store.check_place()?;
    run.check_lock(&lock)?;
    run.check_unchanged()?;
    if outcome.stopped.is_none()
        && let Some(scene) = Snapshot::take(run, &store, Scope::DONE)?.missing().next()
    {
        let path = run.path(&keys::tuple_folder(&run.lines[scene].id));
        return Err(RunError::Changed { path }.into());
    }
    Ok(outcome)
}

/// Works on the tasks of a shared queue until the run is over. A child process skips the check of the golden shard.
pub fn work_shared(
    run: &Run,
    store: &Store,
    shared: &SharedQueue,
    options: &WorkOptions,
    on_event: &(dyn Fn(Event) + Sync),
) -> Result<Outcome, FarmError> {
    if !shared.is_child {
        check_golden(run, options)?;
        let shards = run.lines.iter().map(|l| u64::from(run.layout(l).len()));
        on_event(Event::Started { shards: shards.sum(), scenes: run.lines.len() as u64 });
    }
    work_on(run, store, shared.queue, Some(shared), options, on_event)
}

/// Returns the message of a whole scene.
pub(crate) fn whole(run: &Run, scene: usize) -> Message {
    let shards = 0..run.layout(&run.lines[scene]).len();
    Message { task: Task { scene: scene as u32, shards }, hops: 0 }
}

pub(super) fn check_golden(run: &Run, options: &WorkOptions) -> Result<(), FarmError> {
    let found = golden_of(&run.spec.golden.scene, options.isa, options.threads.max(1));
    if found == run.spec.golden {
        return Ok(());
    }
    Err(FarmError::from(AccessError::Golden {
        scene: run.spec.golden.scene.clone(),
        found: found.blake3,
        expected: run.spec.golden.blake3.clone(),
    }))
}

fn work_on<'a>(
    run: &'a Run,
    store: &'a Store,
    queue: &'a dyn Queue,
    shared_queue: Option<&'a SharedQueue<'a>>,
    options: &'a WorkOptions<'a>,
    on_event: &'a (dyn Fn(Event) + Sync),
) -> Result<Outcome, FarmError> {
    let worker = Worker {
        run,
        store,
        queue,
        shared_queue,
        options,
        on_event,
        start: Instant::now(),
        maker: options.who.maker(),
        photographs: PhotographCache::new(options.photographs_bytes),
        tasks: Mutex::new(Tasks::new(options.checkpoint)),
        jobs: Injector::new(),
        bell: Bell::default(),
        stop: StopSigns::default(),
        tally: Tally::begin(),
    };
    let began = LogTime::now();
    run_threads(&worker);
    let cancelled = worker.stop.is_cancelled();
    // A cancelled run publishes no tasks.
    let actions = if cancelled { worker.tasks().cancel() } else { worker.tasks().requeue_all() };
    // The store may just have failed, so its calls are not repeated. If the queue fails, the leases expire.
    let hurried = store.with_patience(Duration::ZERO);
    let requeued = worker.perform_in(if cancelled { store } else { &hurried }, actions);
    if shared_queue.is_some() {
        worker.tally.donated.add(requeued.unwrap_or(0));
    }
    if let Some(error) = worker.stop.take_failure() {
        return Err(error);
    }
    let scenes = worker.tally.scene_seconds.of(run);
    let stopped = worker.stop.reason(options.stop);
    let outcome = worker.tally.outcome(stopped);
    let is_child = shared_queue.is_some_and(|queue| queue.is_child);
    let since_1970 = began.clock.duration_since(SystemTime::UNIX_EPOCH);
    let named = |seconds: &[(&'static str, f64)]| {
        seconds.iter().map(|(stage, s)| ((*stage).to_owned(), *s)).collect()
    };
    let log = WorkLog {
        schema: WORK_LOG_SCHEMA.to_owned(),
        worker: options.who.worker.clone(),
        host: options.who.host.clone(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        tracer_version: TRACER_VERSION,
        is_child,
        threads: options.threads.max(1) as u32,
        started_unix_s: since_1970.unwrap_or_default().as_secs_f64(),
        wall_s: began.start.elapsed().as_secs_f64(),
        stopped: outcome.stopped.map(|stop| stop.name().to_owned()),
        merged: outcome.merged,
        shards_traced: outcome.traced,
        shards_resumed: outcome.resumed,
        scenes_loaded: outcome.loaded,
        thread_seconds: named(&outcome.seconds.all()),
        cpu_seconds: named(&outcome.seconds.cpu()),
        scenes,
    };
    log.leave(store);
    Ok(outcome)
}

fn run_threads(worker: &Worker) {
    let threads = worker.options.threads.max(1);
    let (sender, files) = bounded(threads);
    let (writer, orders) = bounded(threads);
    let deques: Vec<Deque<Band>> = (0..threads).map(|_| Deque::new_fifo()).collect();
    let pool = Pool {
        files,
        stealers: deques.iter().map(Deque::stealer).collect(),
        encoder: SrgbEncoder::new(),
    };
    let appetite = Appetite::default();
    let mut control = ControlPoll::default();
    worker.poll_control(&mut control);
    let (working, ended) = bounded(0);
    thread::scope(|scope| {
        let (pool, appetite) = (&pool, &appetite);
        start(scope, worker, move || worker.watch_control(control, &ended));
        let prefetcher = Prefetcher { worker, appetite, sender, readable: Cell::new(0) };
        let prefetch = move || {
            prefetcher.run();
            drop(prefetcher);
            worker.bell.ring_all();
        };
        start(scope, worker, prefetch);
        if let Some(shared) = worker.shared_queue {
            let keeper = LeaseKeeper { worker, shared, appetite };
            start(scope, worker, move || keeper.run());
        }
        let writing = Writer { worker, orders };
        let writing = start(scope, worker, move || writing.run());
        let compute = |(index, deque)| {
            let thread = ComputeThread { worker, pool, index, deque, writer: writer.clone() };
            start(scope, worker, move || thread.run())
        };
        let computing: Vec<_> = deques.into_iter().enumerate().map_while(compute).collect();
        // The writer exits after the last compute thread.
        drop(writer);
        let panics =
            computing.into_iter().map(|thread| thread.join().is_err()).filter(|panicked| *panicked);
        let panicked = panics.count() > 0 || writing.is_some_and(|thread| thread.join().is_err());
        worker.stop.over.store(true, Ordering::Release);
        drop(working);
        assert!(!panicked, "a thread of the farm panicked");
    });
}

/// Starts a thread. Stops the worker with an error if the system cannot.
fn start<'scope, T: Send + 'scope>(
    scope: &'scope ThreadScope<'scope, '_>,
    worker: &Worker,
    work: impl FnOnce() -> T + Send + 'scope,
) -> Option<ScopedJoinHandle<'scope, T>> {
    match thread::Builder::new().spawn_scoped(scope, work) {
        Ok(started) => Some(started),
        Err(source) => {
            let threads = worker.options.threads.max(1);
            worker.stop.break_down(FarmError::Threads { threads, source });
            worker.bell.ring_all();
            None
        }
    }
}
