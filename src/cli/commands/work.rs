//! `work RUN`

use crate::cli::args::{
    CacheArgs, CheckpointArgs, FARM, Global, IsaChoice, QueueArgs, RootArgs, isa, parse_duration,
    threads,
};
use crate::cli::exit_code::{Exit, Failure};
use crate::cli::isolate::{self, Children, Only};
use crate::cli::output::{Output, as_map, reasons};
use crate::cli::progress::Progress;
use crate::cli::queue;
use crate::cli::signals::Signals;
use crate::cli::store_env;
use crate::farm::queue::{LocalQueue, Message, Queue};
use crate::farm::{Fault, Outcome, SharedQueue, WorkOptions, work, work_shared};
use crate::run::{Event, Quarantined, Run, Scope, Snapshot, Stop, Task, WorkerName};
use crate::store::Store;
use clap::Args as ClapArgs;
use render::ids::SceneId;
use render::line::Roots;
use serde::Serialize;
use std::fmt;
use std::path::Path;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

#[derive(Debug, ClapArgs)]
pub(super) struct WorkArgs {
    /// Folder of the run
    run: PathBuf,
    /// Begin no shard after this time (90, 90s, 55m, 2h), then exit with 75 if work is left
    #[arg(long, value_name = "TIME", value_parser = parse_duration)]
    time_limit: Option<Duration>,
    #[command(flatten)]
    roots: RootArgs,
    #[command(flatten)]
    queue: QueueArgs,
    #[command(flatten)]
    cache: CacheArgs,
    #[command(flatten)]
    checkpoint: CheckpointArgs,
    /// A scene without any progress for this time counts as hung: the worker ends and leaves it to others
    #[arg(long, value_name = "S", default_value = "120", value_parser = parse_duration, help_heading = FARM)]
    hang_s: Duration,
    /// Name of this worker in messages and receipts [default: host and process]
    #[arg(long, value_name = "NAME", help_heading = FARM)]
    name: Option<String>,
    /// Only these shards of a scene, for a worker that fears them
    #[arg(long, value_name = "SCENE:A-B", hide = true)]
    only: Option<Only>,
    /// Misbehave: abort:SCENE, hang:SCENE, wrong:SCENE, slow:FACTOR (repeatable)
    #[arg(long = "fault", value_name = "FAULT", hide = true)]
    faults: Vec<crate::farm::Fault>,
}

pub(super) fn run(args: &WorkArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    queue::fetch_run(&args.run, &args.queue)?;
    let roots = Roots::parse(&args.roots.roots)?;
    let mut run = Run::open(&args.run, &roots)?;
    run.inputs = store_env::inputs_of(&run, &args.cache);
    if global.dry_run {
        let store = queue::store(&args.run, &args.queue)?;
        let status = Snapshot::take(&run, &store, Scope::COUNTS)?.counts();
        let planned = Planned {
            run: &args.run,
            dry_run: true,
            shards_left: status.shards - status.shards_done,
            quarantined: &status.quarantined,
            shards: status.shards,
        };
        output.show("glasshouse.work/1", &planned);
        return Ok(Exit::Done);
    }
    let how = How {
        deadline: args.time_limit.and_then(|limit| Instant::now().checked_add(limit)),
        run: &args.run,
        roots: &args.roots.roots,
        cache: Some(&args.cache),
        queue: Some(&args.queue),
        hang: args.hang_s,
        checkpoint: args.checkpoint.checkpoint_s,
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

/// How to work on a run.
pub(super) struct How<'a> {
    pub(super) deadline: Option<Instant>,
    /// Its folder.
    pub(super) run: &'a Path,
    pub(super) roots: &'a [String],
    pub(super) cache: Option<&'a CacheArgs>,
    pub(super) queue: Option<&'a QueueArgs>,
    pub(super) hang: Duration,
    pub(super) checkpoint: Duration,
    pub(super) name: String,
    pub(super) faults: &'a [Fault],
}

impl<'a> How<'a> {
    /// As `run` does.
    pub(super) fn alone(run: &'a Path, roots: &'a [String], checkpoint: Duration) -> Self {
        Self {
            deadline: None,
            run,
            roots,
            cache: None,
            queue: None,
            hang: Duration::from_mins(2),
            checkpoint,
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
        options.checkpoint = self.checkpoint;
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
            isa: match global.isa {
                IsaChoice::Auto => "auto",
                IsaChoice::Avx2 => "avx2",
                IsaChoice::Baseline => "baseline",
            },
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

/// Traces and merges with progress and signals. Also `run`'s middle part.
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

/// Works for a farm until its run is over.
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

/// A child: works on one task, and says that it goes on (see [`crate::cli::isolate`]).
fn work_only(
    run: &Run,
    store: &Store,
    only: &Only,
    how: &How,
    global: &Global,
    output: &Output,
) -> Result<(Outcome, Exit, Duration), Failure> {
    let scene = run.lines.iter().position(|l| l.id.as_str() == only.scene);
    let scene = scene.ok_or_else(|| {
        let error = anyhow::anyhow!("the run has no scene {}", only.scene);
        Failure::new(Exit::Usage, error)
    })?;
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
    let last_words = |event: Event| {
        if matches!(event, Event::Aborts { .. }) {
            progress.event(event, output);
        }
    };
    let outcome = work_shared(run, store, &shared, &options, &last_words)?;
    let exit = match outcome.stopped {
        Some(_) => signals.exit(),
        None => Exit::Done,
    };
    Ok((outcome, exit, start.elapsed()))
}

/// Between two signs of life of a child.
const SIGNS_EVERY: Duration = Duration::from_millis(500);

#[derive(Serialize)]
struct Planned<'a> {
    run: &'a Path,
    dry_run: bool,
    shards_left: u64,
    quarantined: &'a [Quarantined],
    #[serde(skip)]
    shards: u64,
}

impl fmt::Display for Planned<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (left, all) = (self.shards_left, self.shards);
        write!(f, "{left} of {all} shards would be traced")
    }
}

/// What a worker did.
#[derive(Serialize)]
pub(super) struct Worked<'a> {
    run: &'a Path,
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
            run,
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
        write!(
            f,
            "{} tuples in {:.1} s ({} shards traced, {} resumed",
            self.merged, self.wall_s, self.shards_traced, self.shards_resumed
        )?;
        if self.already_merged > 0 {
            write!(f, "; {} tuples were there", self.already_merged)?;
        }
        f.write_str(")")?;
        if !self.quarantined.is_empty() {
            write!(
                f,
                "; {} scenes in quarantine, see `glasshouse status RUN` (`glasshouse retry RUN SCENE` tries one again)",
                self.quarantined.len()
            )?;
        }
        f.write_str(match self.stop {
            Some(Stop::Asked) => "; stopped by a signal, the same command goes on",
            Some(Stop::TimeLimit) => "; time limit reached; run the same command to resume",
            Some(Stop::Drained) => "; ended because too many scenes failed here",
            Some(Stop::Cancelled) => {
                "; the run is cancelled, after `glasshouse resume RUN` the same command goes on"
            }
            None => "",
        })
    }
}
