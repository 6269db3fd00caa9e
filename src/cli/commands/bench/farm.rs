//! `bench farm`: measures the farm with real processes, or simulates it.

use crate::bench::cpu_name;
use crate::bench::farm::{FarmBenchError, Setup, makespan, overhead, resume, simulate};
use crate::cli::args::{Global, isa};
use crate::cli::exit_code::{Exit, Failure, exit_codes, failure};
use crate::cli::output::Output;
use crate::cli::progress::Progress;
use crate::cli::signals::Signals;
use crate::farm::simulate::{Case, Fault, Fleet, Rules, Work, lower_bound_s, some_workers};
use clap::Args as ClapArgs;
use serde::Serialize;
use std::fmt;

const SCHEMA: &str = "glasshouse.bench_farm/1";

/// Largest number of worker processes.
const MOST_WORKERS: u32 = 256;

#[derive(Debug, ClapArgs)]
pub(super) struct BenchFarmArgs {
    /// Simulate the farm in virtual time, without servers and tracer
    #[arg(long)]
    simulate: bool,
    /// Measure the makespan over its lower bound: real workers, shards that sleep, without faults and with one worker
    /// killed and one four times slower
    #[arg(long, conflicts_with_all = ["simulate", "resume"])]
    makespan: bool,
    /// Measure the time to resume a half-finished run of 320,000 shards
    #[arg(long, conflicts_with = "simulate")]
    resume: bool,
    /// NATS server to measure with [default: a temporary one, if nats-server is installed]
    #[arg(long, value_name = "URL", conflicts_with = "simulate")]
    queue: Option<String>,
    /// Number of measurements, with --makespan and --resume
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=100))]
    passes: u32,

    /// Number of workers, of one thread each; without a mode, 1, 2, 4, ... up to this number
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    workers: u32,
    /// Number of scenes [default: 50; 5000 with --resume, 16 without a mode]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    scenes: Option<u32>,
    /// Number of shards per scene [default: 16; 64 with --resume and without a mode]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4096))]
    shards: Option<u32>,
    /// Seed of the costs, the network's jitter, and the choices of donors and of the workers of a share
    #[arg(long, value_name = "K", default_value_t = 0)]
    seed: u64,
    /// Seconds per shard of the cheapest scenes (± 25 %); the most expensive take sixteen times as long
    #[arg(long, value_name = "S", default_value_t = 0.02, value_parser = parse_seconds)]
    shard_s: f64,
    /// Seconds to load a scene
    #[arg(long, value_name = "S", default_value_t = 0.2, value_parser = parse_seconds)]
    load_s: f64,

    /// Duration of a lease in seconds; workers renew a lease three times in this time [default: 30; 2 with --makespan]
    #[arg(long, value_name = "S", value_parser = parse_seconds)]
    lease_s: Option<f64>,
    /// Round trip from a worker to the queue, milliseconds
    #[arg(long, value_name = "MS", default_value_t = 1.0, value_parser = parse_seconds)]
    round_trip_ms: f64,
    /// Longest time between two listings of the store by the coordinator, in seconds
    #[arg(long, value_name = "S", default_value_t = 600.0, value_parser = parse_seconds)]
    reconcile_s: f64,

    /// Kill a worker at a second (0@3.1), or a share of all workers at times spread over the bound (5%); repeatable
    #[arg(long, value_name = "W@S|N%", value_parser = parse_which_at)]
    kill: Vec<(Which, Option<f64>)>,
    /// Slow down a worker (1x4: four times slower) or a share of all workers (10%x4); repeatable
    #[arg(long, value_name = "WxF|N%xF", value_parser = parse_slow)]
    slow: Vec<(Which, f64)>,
    /// Suspend a worker, like SIGSTOP and SIGCONT (2@5+60: at second 5 for 60 seconds), or a share (1%+60); repeatable
    #[arg(long, value_name = "W@S+S|N%+S", value_parser = parse_stop)]
    stop: Vec<(Which, Option<f64>, f64)>,
    /// Second at which the queue loses all its messages; repeatable
    #[arg(long, value_name = "S", value_parser = parse_seconds)]
    wipe: Vec<f64>,
    /// Disconnect the queue's server (20+60: from second 20 for 60 seconds); repeatable
    #[arg(long, value_name = "S+S", value_parser = parse_away)]
    away: Vec<(f64, f64)>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum Mode {
    Overhead,
    Makespan,
    Resume,
}

#[derive(Serialize)]
struct Planned {
    measured: bool,
    /// Absent for a simulation.
    #[serde(skip_serializing_if = "Option::is_none")]
    mode: Option<Mode>,
    dry_run: bool,
}

impl fmt::Display for Planned {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.mode {
            None => "would simulate a farm",
            Some(Mode::Overhead) => {
                "would measure the overhead of real workers on a queue and inside one process"
            }
            Some(Mode::Makespan) => {
                "would measure the makespan of real workers, without and with faults"
            }
            Some(Mode::Resume) => "would measure the time to resume a half-finished run",
        })
    }
}

pub(super) fn run(args: &BenchFarmArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    if args.simulate {
        let case = case(args)?;
        if global.dry_run {
            output.show(SCHEMA, &Planned { measured: false, mode: None, dry_run: true });
        } else {
            output.show(SCHEMA, &simulate(&case)?);
        }
        return Ok(Exit::Done);
    }
    if args.workers > MOST_WORKERS {
        return Err(failure!(
            Exit::Usage,
            "--workers must be at most {MOST_WORKERS}, except with --simulate"
        ));
    }
    let mode = match (args.makespan, args.resume) {
        (true, _) => Mode::Makespan,
        (_, true) => Mode::Resume,
        _ => Mode::Overhead,
    };
    if global.dry_run {
        output.show(SCHEMA, &Planned { measured: true, mode: Some(mode), dry_run: true });
        return Ok(Exit::Done);
    }
    let signals = Signals::catch();
    measure(args, mode, &signals, global, output).map_err(|failure| {
        let stopped = matches!(failure.error.downcast_ref(), Some(FarmBenchError::Stopped));
        if stopped { Failure::new(signals.exit(), failure.error) } else { failure }
    })
}

fn measure(
    args: &BenchFarmArgs,
    mode: Mode,
    signals: &Signals,
    global: &Global,
    output: &Output,
) -> Result<Exit, Failure> {
    let program = std::env::current_exe().map_err(|e| Failure::new(Exit::Failed, e))?;
    let unit = match mode {
        Mode::Resume => "scenes",
        Mode::Overhead | Mode::Makespan => "runs",
    };
    let progress = Progress::new(global, unit, 0);
    let setup = Setup {
        program: &program,
        queue: args.queue.as_deref(),
        cpu: cpu_name(),
        stop: signals.stop(),
        watcher: &progress,
    };
    match mode {
        Mode::Overhead => {
            let (scenes, shards) = (args.scenes.unwrap_or(16), args.shards.unwrap_or(64));
            let result = overhead(&setup, args.workers, scenes, shards)?;
            progress.finish();
            if !result.how.has_queue() {
                output.warning(
                    "nats-server is not installed: only the queue inside a process was measured",
                );
            }
            output.show(SCHEMA, &result);
        }
        Mode::Makespan => {
            let result = makespan(&setup, &case(args)?, args.passes)?;
            progress.finish();
            output.show(SCHEMA, &result);
            if !result.tuples_equal {
                return Err(failure!(
                    Exit::Failed,
                    "the farm's tuples differ from those of one process: this must never happen; please report it"
                ));
            }
        }
        Mode::Resume => {
            let (scenes, shards) = (args.scenes.unwrap_or(5000), args.shards.unwrap_or(64));
            let result = resume(&setup, scenes, shards, args.passes, isa(global)?)?;
            progress.finish();
            output.show(SCHEMA, &result);
        }
    }
    Ok(Exit::Done)
}

exit_codes! {
    FarmBenchError {
        (Plan | Run | Queue | Bench | Write) => its_own,
        NoQueue | OtherFault => Usage,
        _ => Failed,
    }
}

/// Builds the case to simulate or to measure, as the arguments describe it.
fn case(args: &BenchFarmArgs) -> Result<Case, Failure> {
    let lease_s = args.lease_s.unwrap_or(if args.simulate { 30.0 } else { 2.0 });
    let mut case = Case {
        work: Work {
            scenes: args.scenes.unwrap_or(50),
            shards: args.shards.unwrap_or(16),
            cheapest_shard_s: args.shard_s,
            load_s: args.load_s,
            seed: args.seed,
            ..Work::default()
        },
        fleet: Fleet {
            workers: args.workers,
            round_trip_s: args.round_trip_ms * 1e-3,
            ..Fleet::default()
        },
        rules: Rules { lease_s, reconcile_s: args.reconcile_s },
        faults: Vec::new(),
    };
    let workers = args.workers;
    let chosen = |which: Which, salt: u64| match which {
        Which::One(worker) if worker >= workers => {
            Err(failure!(Exit::Usage, "no worker {worker}: the workers are 0 to {}", workers - 1))
        }
        Which::One(worker) => Ok(vec![(worker, 0.0)]),
        Which::Share(share) => Ok(some_workers(workers, share, args.seed ^ (salt << 32))),
    };
    let mut faults = Vec::new();
    for (k, &(which, times)) in (1..).zip(&args.slow) {
        faults
            .extend(chosen(which, k)?.into_iter().map(|(worker, _)| Fault::Slow { worker, times }));
    }
    case.faults = std::mem::take(&mut faults);
    let spread_s = lower_bound_s(&case).unwrap_or(0.0);
    for (k, &(which, at_s)) in (1001..).zip(&args.kill) {
        for (worker, drawn) in chosen(which, k)? {
            faults.push(Fault::Kill { worker, at_s: at_s.unwrap_or(drawn * spread_s) });
        }
    }
    for (k, &(which, at_s, for_s)) in (2001..).zip(&args.stop) {
        for (worker, drawn) in chosen(which, k)? {
            let at_s = at_s.unwrap_or(drawn * spread_s);
            faults.push(Fault::Stop { worker, at_s, for_s });
        }
    }
    faults.extend(args.wipe.iter().map(|&at_s| Fault::Wipe { at_s }));
    let away = args.away.iter();
    faults.extend(away.map(|&(at_s, for_s)| Fault::Away { at_s, for_s }));
    case.faults.append(&mut faults);
    Ok(case)
}

/// A worker's index, or a share of all workers.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Which {
    One(u32),
    /// Share of all workers, 0..=1.
    Share(f64),
}

fn parse_seconds(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|s: &f64| (0.0..=1e7).contains(s))
        .ok_or_else(|| format!("{text:?} is not a number from 0 to ten million"))
}

fn parse_which(text: &str) -> Result<Which, String> {
    if let Some(percent) = text.strip_suffix('%') {
        let percent = parse_seconds(percent)?;
        if percent > 100.0 {
            return Err(format!("{text} is more than 100 % of the workers"));
        }
        return Ok(Which::Share(percent / 100.0));
    }
    text.parse()
        .map(Which::One)
        .map_err(|_| format!("{text:?} is neither a worker's number (from 0) nor a share like 5%"))
}

/// Parses a worker with a time, or a share without one; the times of a share are random.
fn parse_which_at(text: &str) -> Result<(Which, Option<f64>), String> {
    match text.split_once('@') {
        Some((which, at)) => match parse_which(which)? {
            Which::Share(_) => Err("the times of a share are random: write only N%".to_owned()),
            one @ Which::One(_) => Ok((one, Some(parse_seconds(at)?))),
        },
        None => match parse_which(text)? {
            Which::One(_) => Err(format!("time missing: write {text}@SECOND")),
            share @ Which::Share(_) => Ok((share, None)),
        },
    }
}

fn parse_slow(text: &str) -> Result<(Which, f64), String> {
    let (which, times) =
        text.split_once('x').ok_or("factor missing: write WORKERxTIMES, like 1x4")?;
    let times = parse_seconds(times)?;
    if times < 1.0 {
        return Err("the factor must be 1 or more".to_owned());
    }
    Ok((parse_which(which)?, times))
}

fn parse_stop(text: &str) -> Result<(Which, Option<f64>, f64), String> {
    let (which, for_s) = text
        .rsplit_once('+')
        .ok_or("duration missing: write WORKER@SECOND+SECONDS, like 2@5+60")?;
    let (which, at_s) = parse_which_at(which)?;
    Ok((which, at_s, parse_seconds(for_s)?))
}

fn parse_away(text: &str) -> Result<(f64, f64), String> {
    let (at, how_long) =
        text.split_once('+').ok_or("duration missing: write SECOND+SECONDS, like 20+60")?;
    Ok((parse_seconds(at)?, parse_seconds(how_long)?))
}
