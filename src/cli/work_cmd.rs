//! `work RUN`

use super::args::{CacheArgs, Global, IsaChoice, Only, QueueArgs, WorkArgs};
use super::exit_code::{Exit, Failure};
use super::isolate::{self, Children};
use super::output::Output;
use super::progress::Progress;
use super::queue_cmd;
use super::signals::Signals;
use super::store_env;
use crate::farm::queue::{LocalQueue, Message, Queue};
use crate::farm::{Fault, Outcome, SharedQueue, WorkOptions, work, work_shared, work_span};
use crate::run::{Event, Observer, Run, WorkerName, run_status};
use crate::run::{Stop, Task};
use crate::store::Store;
use render::line::Roots;
use render::trace::Isa;
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

/// Threads to use.
pub(super) fn threads(global: &Global) -> usize {
    let cores = || std::thread::available_parallelism().map_or(1, usize::from);
    global.threads.map_or_else(cores, usize::from)
}

/// Kernels to use.
pub(super) fn isa(global: &Global) -> Result<Isa, Failure> {
    match global.isa {
        IsaChoice::Auto => Ok(Isa::detect()),
        IsaChoice::Baseline => Ok(Isa::Baseline),
        IsaChoice::Avx2 if Isa::detect() == Isa::Avx2 => Ok(Isa::Avx2),
        IsaChoice::Avx2 => Err(Failure::new(
            Exit::Usage,
            anyhow::anyhow!("this machine has no AVX2; use --isa auto"),
        )),
    }
}

pub(super) fn run(args: &WorkArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    queue_cmd::fetch_run(&args.run, &args.queue)?;
    let roots = Roots::parse(&args.roots.roots)?;
    let mut run = Run::open(&args.run, &roots)?;
    run.inputs = store_env::inputs_of(&run, &args.cache);
    if global.dry_run {
        let store = queue_cmd::store(&args.run, &args.queue)?;
        let status = Observer::new(&run, &store).look()?.counts;
        let left = status.shards - status.shards_done;
        output.result(
            "glasshouse.work/1",
            json!({ "run": args.run, "dry_run": true, "shards_left": left, "quarantined": status.quarantined }),
            &format!("{left} of {} shards would be traced", status.shards),
        );
        return Ok(Exit::Done);
    }
    let how = How {
        deadline: args
            .time_limit
            .and_then(|limit| Instant::now().checked_add(limit)),
        run: &args.run,
        roots: &args.roots.roots,
        cache: Some(&args.cache),
        queue: Some(&args.queue),
        hang: args.hang_s,
        checkpoint: args.checkpoint.checkpoint_s,
        name: args.name.clone().unwrap_or_else(queue_cmd::worker_name),
        faults: &args.faults,
    };
    let store = queue_cmd::store(&args.run, &args.queue)?;
    run.take_inputs_from(&store, &roots);
    let (outcome, exit, wall) = match (&args.only, &args.queue.queue) {
        (Some(only), _) => work_only(&run, &store, only, &how, global, output)?,
        (None, None) => work_on(&run, &how, global, output)?,
        (None, Some(_)) => work_for(&run, &store, &args.queue, &how, global, output)?,
    };
    output.result(
        "glasshouse.work/1",
        outcome_json(&outcome, &args.run, wall),
        &summary(&outcome, wall),
    );
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
            name: queue_cmd::worker_name(),
            faults: &[],
        }
    }

    fn options<'s>(&self, global: &Global, stop: &'s AtomicBool) -> Result<WorkOptions<'s>, Failure>
    where
        'a: 's,
    {
        let mut options = WorkOptions::new(threads(global), isa(global)?, stop);
        options.deadline = self.deadline;
        options.who = WorkerName {
            worker: self.name.clone(),
            host: queue_cmd::host_name(),
        };
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
    let options = WorkOptions {
        sandbox: Some(&children),
        ..how.options(global, signals.stop())?
    };
    let outcome = work(run, &options, &|event| progress.event(event, output));
    progress.finish();
    progress.note_narrow_scenes(output);
    let outcome = outcome?;
    let exit = match outcome.stopped {
        Some(Stop::Asked) => signals.exit(),
        Some(Stop::TimeLimit) if !run_status(run).is_finished() => Exit::TryAgain,
        Some(Stop::Cancelled) => Exit::Incomplete,
        _ if !outcome.quarantined.is_empty() => Exit::Incomplete,
        _ => Exit::Done,
    };
    if output.verbose {
        let seconds: Vec<String> = outcome
            .seconds
            .all()
            .iter()
            .map(|(stage, s)| format!("{stage} {s:.2} s"))
            .collect();
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
    let options = WorkOptions {
        sandbox: Some(&children),
        ..how.options(global, signals.stop())?
    };
    let queue = queue_cmd::worker(run, args, &how.name)?;
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

/// A child: works on one task, and says that it goes on (see [`super::isolate`]).
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
    let task = Task {
        scene: scene as u32,
        shards: only.shards.clone(),
    };
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
    let outcome = work_span(run, store, &shared, &options, &last_words)?;
    let exit = match outcome.stopped {
        Some(_) => signals.exit(),
        None => Exit::Done,
    };
    Ok((outcome, exit, start.elapsed()))
}

/// Between two signs of life of a child.
const SIGNS_EVERY: Duration = Duration::from_millis(500);

/// The outcome as JSON.
pub(super) fn outcome_json(outcome: &Outcome, run: &Path, wall: Duration) -> Value {
    let object = |seconds: &[(&str, f64)]| -> serde_json::Map<String, Value> {
        let entry = |(stage, s): &(&str, f64)| ((*stage).to_owned(), json!(s));
        seconds.iter().map(entry).collect()
    };
    let quarantined: Vec<Value> = outcome
        .quarantined
        .iter()
        .map(|(scene, reason)| json!({ "scene": scene, "reason": reason }))
        .collect();
    json!({
        "run": run,
        "merged": outcome.merged,
        "already_merged": outcome.already_merged,
        "shards_traced": outcome.traced,
        "shards_resumed": outcome.resumed,
        "scenes_loaded": outcome.loaded,
        "spans_given": outcome.donated,
        "quarantined": quarantined,
        "stopped": outcome.stopped.map(Stop::name),
        "wall_s": wall.as_secs_f64(),
        "thread_seconds": object(&outcome.seconds.all()),
        "cpu_seconds": object(&outcome.seconds.cpu()),
    })
}

/// The outcome in a sentence.
pub(super) fn summary(outcome: &Outcome, wall: Duration) -> String {
    let mut text = format!(
        "{} tuples in {:.1} s ({} shards traced, {} taken up",
        outcome.merged,
        wall.as_secs_f64(),
        outcome.traced,
        outcome.resumed
    );
    if outcome.already_merged > 0 {
        let _ = write!(text, "; {} tuples were there", outcome.already_merged);
    }
    text += ")";
    if !outcome.quarantined.is_empty() {
        let _ = write!(
            text,
            "; {} scenes in quarantine, see `glasshouse status RUN` (`glasshouse retry RUN SCENE` tries one again)",
            outcome.quarantined.len()
        );
    }
    match outcome.stopped {
        Some(Stop::Asked) => text += "; stopped by a signal, the same command goes on",
        Some(Stop::TimeLimit) => text += "; time is up, the same command goes on",
        Some(Stop::Drained) => text += "; ended because too many scenes failed here",
        Some(Stop::Cancelled) => {
            text +=
                "; the run is cancelled, after `glasshouse resume RUN` the same command goes on";
        }
        None => {}
    }
    text
}
