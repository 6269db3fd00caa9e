//! `work RUN`

use super::args::{Global, IsaChoice, WorkArgs};
use super::exit_code::{Exit, Failure};
use super::output::Output;
use super::progress::Progress;
use super::queue_cmd;
use super::signals::Signals;
use crate::farm::{Outcome, Run, SharedQueue, Stop, WorkOptions, run_status, work, work_shared};
use crate::manifest::Roots;
use crate::trace::Isa;
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::Path;
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
    let run = Run::open(&args.run, &Roots::parse(&args.roots.roots)?)?;
    if global.dry_run {
        let status = run_status(&run);
        let left = status.shards - status.shards_done;
        output.result(
            "glasshouse.work/1",
            json!({ "run": args.run, "dry_run": true, "shards_left": left, "quarantined": status.quarantined }),
            &format!("{left} of {} shards would be traced", status.shards),
        );
        return Ok(Exit::Done);
    }
    let deadline = args
        .time_limit
        .and_then(|limit| Instant::now().checked_add(limit));
    let (outcome, exit, wall) = match &args.queue.queue {
        None => work_on(&run, global, output, deadline)?,
        Some(_) => work_for(&run, args, global, output, deadline)?,
    };
    output.result(
        "glasshouse.work/1",
        outcome_json(&outcome, &args.run, wall),
        &summary(&outcome, wall),
    );
    Ok(exit)
}

/// Traces and merges with progress and signals. Also `run`'s middle part.
pub(super) fn work_on(
    run: &Run,
    global: &Global,
    output: &Output,
    deadline: Option<Instant>,
) -> Result<(Outcome, Exit, Duration), Failure> {
    let signals = Signals::catch();
    let progress = Progress::new(global, "shards", 0);
    let start = Instant::now();
    let options = WorkOptions {
        threads: threads(global),
        isa: isa(global)?,
        stop: signals.stop(),
        deadline,
    };
    let outcome = work(run, &options, &|event| progress.event(event, output));
    progress.finish();
    progress.note_narrow_scenes(output);
    let outcome = outcome?;
    let exit = match outcome.stopped {
        Some(Stop::Asked) => signals.exit(),
        Some(Stop::TimeLimit) if !run_status(run).is_finished() => Exit::TryAgain,
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
    args: &WorkArgs,
    global: &Global,
    output: &Output,
    deadline: Option<Instant>,
) -> Result<(Outcome, Exit, Duration), Failure> {
    let signals = Signals::catch();
    let progress = Progress::new(global, "shards", 0);
    let start = Instant::now();
    let options = WorkOptions {
        threads: threads(global),
        isa: isa(global)?,
        stop: signals.stop(),
        deadline,
    };
    let store = queue_cmd::store(&args.run, &args.queue)?;
    let name = args.name.clone().unwrap_or_else(queue_cmd::worker_name);
    let queue = queue_cmd::worker(run, &args.queue, &name)?;
    let on_hung = |reason: &str| {
        output.warning(reason);
        Exit::Failed.now();
    };
    let shared = SharedQueue {
        queue: &queue,
        lease: args.queue.lease_s,
        hang: args.hang_s,
        on_hung: &on_hung,
        worker: name,
    };
    let outcome = work_shared(run, &store, &shared, &options, &|event| {
        progress.event(event, output);
    });
    progress.finish();
    let outcome = outcome?;
    let exit = match outcome.stopped {
        Some(Stop::Asked) => signals.exit(),
        Some(Stop::TimeLimit) => Exit::TryAgain,
        None => Exit::Done,
    };
    Ok((outcome, exit, start.elapsed()))
}

/// The outcome as JSON.
pub(super) fn outcome_json(outcome: &Outcome, run: &Path, wall: Duration) -> Value {
    let seconds: serde_json::Map<String, Value> = outcome
        .seconds
        .all()
        .iter()
        .map(|(stage, s)| ((*stage).to_owned(), json!(s)))
        .collect();
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
        "spans_given": outcome.given,
        "quarantined": quarantined,
        "stopped": outcome.stopped.map(|stop| match stop {
            Stop::Asked => "signal",
            Stop::TimeLimit => "time_limit",
        }),
        "wall_s": wall.as_secs_f64(),
        "thread_seconds": seconds,
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
            "; {} scenes in quarantine, see quarantine/*.json in the run (delete a record to try its scene again)",
            outcome.quarantined.len()
        );
    }
    match outcome.stopped {
        Some(Stop::Asked) => text += "; stopped by a signal, the same command goes on",
        Some(Stop::TimeLimit) => text += "; time is up, the same command goes on",
        None => {}
    }
    text
}
