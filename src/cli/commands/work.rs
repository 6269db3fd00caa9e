//! `work RUN`: traces and merges scenes, alone, for a farm, or as a worker's child.

use crate::cli::args::{
    CacheArgs, FARM, Global, MemoryArgs, QueueArgs, RootArgs, bytes_of_gb, isa, parse_duration,
    threads, typed,
};
use crate::cli::exit_code::{Exit, Failure, failure};
use crate::cli::isolate::{self, Children, Only};
use crate::cli::output::{Output, as_map, reasons};
use crate::cli::progress::Progress;
use crate::cli::queue;
use crate::cli::signals::Signals;
use crate::cli::store_env;
use crate::cli::watchdog;
use crate::farm::queue::{LocalQueue, Message, Queue};
use crate::farm::{Fault, Outcome, SharedQueue, WorkOptions, work, work_shared};
use crate::run::{Event, Quarantined, Run, Scope, Snapshot, Stop, Task, WorkerName};
use crate::store::Store;
use clap::Args as ClapArgs;
use glasshouse_line::Roots;
use glasshouse_line::ids::SceneId;
use serde::Serialize;
use std::borrow::Cow;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

#[derive(Debug, ClapArgs)]
pub(super) struct WorkArgs {
    /// Folder of the run
    run: PathBuf,
    /// Time after which no shard starts (90, 90s, 55m, 2h); the command then exits with 75 if work is left
    #[arg(long, value_name = "TIME", value_parser = parse_duration)]
    time_limit: Option<Duration>,
    #[command(flatten)]
    roots: RootArgs,
    #[command(flatten)]
    queue: QueueArgs,
    #[command(flatten)]
    cache: CacheArgs,
    #[command(flatten)]
    memory: MemoryArgs,
    /// Name of this worker in messages and receipts [default: host and process]
    #[arg(long, value_name = "NAME", help_heading = FARM)]
    name: Option<String>,
    /// Trace only these shards, as the child process of a worker
    #[arg(long, value_name = "SCENE:A-B", hide = true)]
    only: Option<Only>,
    /// Fault to inject: abort:SCENE, hang:SCENE, wrong:SCENE, slow:FACTOR; repeatable
    #[arg(long = "fault", value_name = "FAULT", hide = true)]
    faults: Vec<crate::farm::Fault>,
}

pub(super) fn run(args: &WorkArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    queue::fetch_run(&args.run, &args.queue)?;
    let roots = Roots::parse(&args.roots.roots)?;
    let mut run = Run::open(&args.run, &roots)?;
    run.inputs = store_env::inputs_of(&run, &args.cache, args.queue.store_patience_s);
    if global.dry_run {
        let store = queue::store(&args.run, &args.queue)?;
        let status = Snapshot::take(&run, &store, Scope::COUNTS)?.counts();
        let planned = Planned {
            run: args.run.to_string_lossy(),
            dry_run: true,
            shards_left: status.shards - status.shards_done,
            quarantined: &status.quarantined,
            shards: status.shards,
        };
        output.show("glasshouse.work/1", &planned);
        return Ok(Exit::Done);
    }
    let deadline = args.time_limit.and_then(|limit| Instant::now().checked_add(limit));
    if let Some(deadline) = deadline {
        watchdog::set_deadline(deadline);
    }
    let how = How {
        deadline,
        run: &args.run,
        roots: &args.roots.roots,
        cache: Some(&args.cache),
        queue: Some(&args.queue),
        hang: global.hang_s,
        memory: args.memory,
        name: args.name.clone().unwrap_or_else(queue::worker_name),
        faults: &args.faults,
    };
    let store = queue::store(&args.run, &args.queue)?;
    run.take_inputs_from(&store, &roots);
    let (outcome, exit, wall) = match (&args.only, &args.queue.queue) {
        (Some(only), _) => work_only(&run, &store, only, &how, global, output)?,
        (None, None) => work_on(&run, &how, global, output)?,
        (None, Some(_)) => work_for(&run, &store, &args.queue, &how, global, output)?,
    };
    output.show("glasshouse.work/1", &Worked::new(&outcome, &args.run, wall));
    Ok(exit)
}

/// Options of the work on a run.
pub(super) struct How<'a> {
    deadline: Option<Instant>,
    run: &'a Path,
    roots: &'a [String],
    cache: Option<&'a CacheArgs>,
    queue: Option<&'a QueueArgs>,
    hang: Duration,
    memory: MemoryArgs,
    name: String,
    faults: &'a [Fault],
}

impl<'a> How<'a> {
    /// Returns the options of the command `run`: no deadline, cache, queue or faults.
    pub(super) fn alone(
        run: &'a Path,
        roots: &'a [String],
        memory: MemoryArgs,
        global: &Global,
    ) -> Self {
        Self {
            deadline: None,
            run,
            roots,
            cache: None,
            queue: None,
            hang: global.hang_s,
            memory,
            name: queue::worker_name(),
            faults: &[],
        }
    }

    fn options<'s>(&self, global: &Global, stop: &'s AtomicBool) -> Result<WorkOptions<'s>, Failure>
    where
        'a: 's,
    {
        let mut options = WorkOptions::new(threads(global), isa(global)?, stop);
        options.deadline = self.deadline;
        options.who = WorkerName { worker: self.name.clone(), host: queue::host_name() };
        options.hang = self.hang;
        options.checkpoint = self.memory.checkpoint_s;
        options.photographs_bytes = bytes_of_gb(self.memory.photographs_gb);
        options.faults = self.faults;
        Ok(options)
    }

    fn children(&self, global: &Global) -> Children<'_> {
        Children {
            run: self.run,
            roots: self.roots,
            cache: self.cache,
            queue: self.queue,
            threads: threads(global),
            isa: typed(&global.isa),
            hang: self.hang,
            name: &self.name,
            faults: self.faults,
        }
    }
}

fn is_finished(run: &Run) -> Result<bool, Failure> {
    let store = Store::local(run.root())?;
    Ok(Snapshot::take(run, &store, Scope::DONE)?.is_finished())
}

/// Traces and merges a local run; shows the progress and stops on a signal.
pub(super) fn work_on(
    run: &Run,
    how: &How,
    global: &Global,
    output: &Output,
) -> Result<(Outcome, Exit, Duration), Failure> {
    let signals = Signals::catch();
    let progress = Progress::new(global, "shards", 0);
    let start = Instant::now();
    let children = how.children(global);
    let options = WorkOptions { sandbox: Some(&children), ..how.options(global, signals.stop())? };
    let outcome = work(run, &options, &|event| progress.event(event, output));
    progress.finish();
    progress.note_narrow_scenes(output);
    let outcome = outcome?;
    let exit = match outcome.stopped {
        Some(Stop::Asked) => signals.exit(),
        Some(Stop::TimeLimit) if !is_finished(run)? => Exit::TryAgain,
        Some(Stop::Cancelled) => Exit::Incomplete,
        _ if !outcome.quarantined.is_empty() => Exit::Incomplete,
        _ => Exit::Done,
    };
    if output.verbose {
        let seconds: Vec<String> =
            outcome.seconds.all().iter().map(|(stage, s)| format!("{stage} {s:.2} s")).collect();
        output.note(&format!("seconds of all threads: {}", seconds.join(", ")));
    }
    Ok((outcome, exit, start.elapsed()))
}

/// Works on a farm's run until the run is over or this worker must stop.
fn work_for(
    run: &Run,
    store: &Store,
    args: &QueueArgs,
    how: &How,
    global: &Global,
    output: &Output,
) -> Result<(Outcome, Exit, Duration), Failure> {
    let signals = Signals::catch();
    let progress = Progress::new(global, "shards", 0);
    let start = Instant::now();
    let children = how.children(global);
    let options = WorkOptions { sandbox: Some(&children), ..how.options(global, signals.stop())? };
    let queue = queue::worker(run, args, &how.name)?;
    let on_hung = |reason: &str| {
        output.warning(reason);
        Exit::Failed.now();
    };
    let shared = SharedQueue {
        queue: &queue,
        lease: args.lease_s,
        on_hung: &on_hung,
        on_sign: &|| {},
        is_child: false,
    };
    let outcome = work_shared(run, store, &shared, &options, &|event| {
        progress.event(event, output);
    });
    progress.finish();
    let outcome = outcome?;
    let exit = match outcome.stopped {
        Some(Stop::Asked) => signals.exit(),
        Some(Stop::TimeLimit) => Exit::TryAgain,
        Some(Stop::Drained) => Exit::Failed,
        Some(Stop::Cancelled) => Exit::Incomplete,
        None => Exit::Done,
    };
    Ok((outcome, exit, start.elapsed()))
}

/// Works on one task as a child process and prints signs of life (see [`crate::cli::isolate`]).
fn work_only(
    run: &Run,
    store: &Store,
    only: &Only,
    how: &How,
    global: &Global,
    output: &Output,
) -> Result<(Outcome, Exit, Duration), Failure> {
    let scene = run.lines.iter().position(|l| l.id.as_str() == only.scene);
    let scene =
        scene.ok_or_else(|| failure!(Exit::Usage, "the run has no scene {}", only.scene))?;
    let signals = Signals::catch();
    let start = Instant::now();
    let options = how.options(global, signals.stop())?;
    let queue = LocalQueue::new(None);
    let task = Task { scene: scene as u32, shards: only.shards.clone() };
    let worker = queue.worker();
    worker.publish(&[Message { task, hops: 0 }])?;
    let shared = SharedQueue {
        queue: &worker,
        lease: SIGNS_EVERY * 3,
        on_hung: &|reason| {
            Output::tell_parent(&format!("{}{reason}", isolate::HUNG));
            Exit::Failed.now();
        },
        is_child: true,
        on_sign: &|| Output::tell_parent(isolate::SIGN),
    };
    let progress = Progress::new(global, "shards", 0);
    let on_event = |event: Event| {
        if matches!(event, Event::Aborts { .. }) {
            progress.event(event, output);
        }
    };
    let outcome = work_shared(run, store, &shared, &options, &on_event)?;
    let exit = if outcome.stopped.is_some() { signals.exit() } else { Exit::Done };
    Ok((outcome, exit, start.elapsed()))
}

/// Time between a child's signs of life.
const SIGNS_EVERY: Duration = Duration::from_millis(500);

#[derive(Serialize)]
struct Planned<'a> {
    run: Cow<'a, str>,
    dry_run: bool,
    shards_left: u64,
    quarantined: &'a [Quarantined],
    #[serde(skip)]
    shards: u64,
}

impl fmt::Display for Planned<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} of {} shards would be traced", self.shards_left, self.shards)
    }
}

#[derive(Serialize)]
pub(super) struct Worked<'a> {
    run: Cow<'a, str>,
    merged: u64,
    already_merged: u64,
    shards_traced: u64,
    shards_resumed: u64,
    scenes_loaded: u64,
    spans_given: u64,
    #[serde(serialize_with = "reasons")]
    quarantined: &'a [(SceneId, String)],
    stopped: Option<&'static str>,
    wall_s: f64,
    #[serde(serialize_with = "as_map")]
    thread_seconds: Vec<(&'static str, f64)>,
    #[serde(serialize_with = "as_map")]
    cpu_seconds: Vec<(&'static str, f64)>,
    #[serde(skip)]
    stop: Option<Stop>,
}

impl<'a> Worked<'a> {
    pub(super) fn new(outcome: &'a Outcome, run: &'a Path, wall: Duration) -> Self {
        Self {
            run: run.to_string_lossy(),
            merged: outcome.merged,
            already_merged: outcome.already_merged,
            shards_traced: outcome.traced,
            shards_resumed: outcome.resumed,
            scenes_loaded: outcome.loaded,
            spans_given: outcome.donated,
            quarantined: &outcome.quarantined,
            stopped: outcome.stopped.map(Stop::name),
            wall_s: wall.as_secs_f64(),
            thread_seconds: outcome.seconds.all().to_vec(),
            cpu_seconds: outcome.seconds.cpu(),
            stop: outcome.stopped,
        }
    }
}

impl fmt::Display for Worked<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { merged, already_merged, shards_traced, shards_resumed, wall_s, .. } = self;
        write!(
            f,
            "{merged} tuples in {wall_s:.1} s ({shards_traced} shards traced, {shards_resumed} resumed"
        )?;
        if *already_merged > 0 {
            write!(f, "; {already_merged} tuples existed before")?;
        }
        f.write_str(")")?;
        if !self.quarantined.is_empty() {
            write!(
                f,
                "; {} scenes in quarantine: `glasshouse status RUN` lists them; `glasshouse retry RUN SCENE` tries one again",
                self.quarantined.len()
            )?;
        }
        f.write_str(match self.stop {
            Some(Stop::Asked) => "; stopped by a signal; run the same command to resume",
            Some(Stop::TimeLimit) => "; time limit reached; run the same command to resume",
            Some(Stop::Drained) => "; ended because too many scenes failed on this machine",
            Some(Stop::Cancelled) => {
                "; the run is cancelled: run `glasshouse resume RUN`, then the same command to continue"
            }
            None => "",
        })
    }
}
