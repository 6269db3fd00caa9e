//! `bench farm`: the farm measured with real processes, or simulated.

use crate::bench::cpu_name;
use crate::bench::farm::{FarmBenchError, Setup, makespan, overhead, resume, simulate};
use crate::cli::args::{Global, isa};
use crate::cli::exit_code::{Exit, Failure};
use crate::cli::output::Output;
use crate::cli::progress::Progress;
use crate::cli::signals::Signals;
use crate::farm::simulate::{Case, Fault, Fleet, Rules, Work, lower_bound_s, some_workers};
use anyhow::anyhow;
use clap::Args as ClapArgs;
use serde::Serialize;
use std::fmt;

const SCHEMA: &str = "glasshouse.bench_farm/1";

/// Processes that are started at most.
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
    /// Measure the time until a run of 320,000 shards that is half done goes on
    #[arg(long, conflicts_with = "simulate")]
    resume: bool,
    /// NATS server to measure with [default: a temporary one, if nats-server is installed]
    #[arg(long, value_name = "URL", conflicts_with = "simulate")]
    queue: Option<String>,
    /// Measurements, with --makespan and --resume
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=100))]
    passes: u32,

    /// Workers, of one thread each; without any mode 1, 2, 4, ... up to this number
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    workers: u32,
    /// Scenes [default: 50; 5000 with --resume, 16 without any mode]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    scenes: Option<u32>,
    /// Shards a scene [default: 16; 64 with --resume and without any mode]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4096))]
    shards: Option<u32>,
    /// Seed of the costs, the network's jitter and the choice among workers that can give
    #[arg(long, value_name = "K", default_value_t = 0)]
    seed: u64,
    /// Seconds for a shard of the cheapest scenes (25 % more or less); the dearest cost sixteen times as much
    #[arg(long, value_name = "S", default_value_t = 0.02, value_parser = parse_seconds)]
    shard_s: f64,
    /// Seconds to load a scene
    #[arg(long, value_name = "S", default_value_t = 0.2, value_parser = parse_seconds)]
    load_s: f64,

    /// Lease of a span in seconds, renewed three times as often [default: 30; 2 with --makespan]
    #[arg(long, value_name = "S", value_parser = parse_seconds)]
    lease_s: Option<f64>,
    /// Milliseconds from a worker to the queue and back
    #[arg(long, value_name = "MS", default_value_t = 1.0, value_parser = parse_seconds)]
    round_trip_ms: f64,
    /// Longest time between two listings of the store by the coordinator, in seconds
    #[arg(long, value_name = "S", default_value_t = 600.0, value_parser = parse_seconds)]
    reconcile_s: f64,

    /// Kill a worker at a second (0@3.1), or a share of all workers at times spread over the bound (5%); repeatable
    #[arg(long, value_name = "W@S|N%", value_parser = parse_kill)]
    kill: Vec<Kill>,
    /// Slow a worker (1x4: four times slower) or a share of all workers (10%x4) down; repeatable
    #[arg(long, value_name = "WxF|N%xF", value_parser = parse_slow)]
    slow: Vec<Slow>,
    /// Stop a worker as SIGSTOP and SIGCONT do (2@5+60: at second 5 for 60 seconds), or a share of them (1%+60); repeatable
    #[arg(long, value_name = "W@S+S|N%+S", value_parser = parse_stop)]
    stop: Vec<Stop>,
    /// Second at which the queue forgets everything; repeatable
    #[arg(long, value_name = "S", value_parser = parse_seconds)]
    wipe: Vec<f64>,
    /// Take the queue's server away (20+60: from second 20 for 60 seconds); repeatable
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

impl fmt::Display for Mode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Overhead => "real workers on a queue and inside one process",
            Self::Makespan => "real workers on a queue, tasks that sleep, twice",
            Self::Resume => "a run that is half done would be made and resumed",
        })
    }
}

/// The result with `--dry-run`.
#[derive(Serialize)]
struct Planned {
    measured: bool,
    mode: Mode,
    dry_run: bool,
}

impl fmt::Display for Planned {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "would measure: {}", self.mode)
    }
}

pub(super) fn run(args: &BenchFarmArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    if args.simulate {
        output.show(SCHEMA, &simulate(&case(args)?)?);
        return Ok(Exit::Done);
    }
    if args.workers > MOST_WORKERS {
        let what = format!(
            "at most {MOST_WORKERS} workers are started; more can be simulated (--simulate)"
        );
        return Err(usage(what));
    }
    let mode = match (args.makespan, args.resume) {
        (true, _) => Mode::Makespan,
        (_, true) => Mode::Resume,
        _ => Mode::Overhead,
    };
    if global.dry_run {
        let planned = Planned { measured: true, mode, dry_run: true };
        output.show(SCHEMA, &planned);
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
                    "there is no nats-server on this machine: only the queue inside a process was measured",
                );
            }
            output.show(SCHEMA, &result);
        }
        Mode::Makespan => {
            let result = makespan(&setup, &case(args)?, args.passes)?;
            progress.finish();
            output.show(SCHEMA, &result);
            if !result.tuples_equal {
                let what = "the farm's tuples are not those of one process: this must never happen; please report it";
                return Err(Failure::new(Exit::Failed, anyhow!(what)));
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

fn usage(what: impl Into<String>) -> Failure {
    Failure::new(Exit::Usage, anyhow!(what.into()))
}

impl From<FarmBenchError> for Failure {
    fn from(error: FarmBenchError) -> Self {
        use FarmBenchError as E;
        match error {
            E::NoQueue | E::OtherFault => Self::new(Exit::Usage, error),
            E::Plan(error) => error.into(),
            E::Run(error) => error.into(),
            E::Queue(error) => error.into(),
            E::Bench(error) => error.into(),
            E::Write(error) => error.into(),
            _ => Self::new(Exit::Failed, error),
        }
    }
}

/// The case of the arguments, to be simulated or done.
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
            Err(usage(format!("there is no worker {worker}: they are 0 to {}", workers - 1)))
        }
        Which::One(worker) => Ok(vec![(worker, 0.0)]),
        Which::Share(share) => Ok(some_workers(workers, share, args.seed ^ (salt << 32))),
    };
    let mut faults = Vec::new();
    for (k, slow) in (1..).zip(&args.slow) {
        for (worker, _) in chosen(slow.which, k)? {
            let times = slow.times;
            faults.push(Fault::Slow { worker, times });
        }
    }
    case.faults = std::mem::take(&mut faults);
    let spread_s = lower_bound_s(&case).unwrap_or(0.0);
    for (k, kill) in (1001..).zip(&args.kill) {
        for (worker, drawn) in chosen(kill.which, k)? {
            let at_s = kill.at_s.unwrap_or(drawn * spread_s);
            faults.push(Fault::Kill { worker, at_s });
        }
    }
    for (k, stop) in (2001..).zip(&args.stop) {
        for (worker, drawn) in chosen(stop.which, k)? {
            let at_s = stop.at_s.unwrap_or(drawn * spread_s);
            let for_s = stop.for_s;
            faults.push(Fault::Stop { worker, at_s, for_s });
        }
    }
    faults.extend(args.wipe.iter().map(|&at_s| Fault::Wipe { at_s }));
    let away = args.away.iter();
    faults.extend(away.map(|&(at_s, for_s)| Fault::Away { at_s, for_s }));
    case.faults.append(&mut faults);
    Ok(case)
}

/// A worker's number, or a share of all.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Which {
    One(u32),
    /// 0..=1.
    Share(f64),
}

/// `--kill`; a share has its times drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Kill {
    which: Which,
    at_s: Option<f64>,
}

/// `--slow`
#[derive(Clone, Copy, Debug, PartialEq)]
struct Slow {
    which: Which,
    times: f64,
}

/// `--stop`; a share has its times drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Stop {
    which: Which,
    at_s: Option<f64>,
    for_s: f64,
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
            return Err(format!("{text} is more than all workers"));
        }
        return Ok(Which::Share(percent / 100.0));
    }
    text.parse()
        .map(Which::One)
        .map_err(|_| format!("{text:?} is neither a worker's number, from 0, nor a share like 5%"))
}

/// A worker needs a time, a share must not have one.
fn parse_which_at(text: &str) -> Result<(Which, Option<f64>), String> {
    match text.split_once('@') {
        Some((which, at)) => match parse_which(which)? {
            Which::Share(_) => Err("the times of a share are drawn: write N% alone".to_owned()),
            one @ Which::One(_) => Ok((one, Some(parse_seconds(at)?))),
        },
        None => match parse_which(text)? {
            Which::One(_) => Err(format!("when? write {text}@SECOND")),
            share @ Which::Share(_) => Ok((share, None)),
        },
    }
}

fn parse_kill(text: &str) -> Result<Kill, String> {
    let (which, at_s) = parse_which_at(text)?;
    Ok(Kill { which, at_s })
}

fn parse_slow(text: &str) -> Result<Slow, String> {
    let (which, times) =
        text.split_once('x').ok_or("how much slower? write WORKERxTIMES, like 1x4")?;
    let times = parse_seconds(times)?;
    if times < 1.0 {
        return Err("1 or more times slower".to_owned());
    }
    Ok(Slow { which: parse_which(which)?, times })
}

fn parse_stop(text: &str) -> Result<Stop, String> {
    let (which, for_s) =
        text.rsplit_once('+').ok_or("for how long? write WORKER@SECOND+SECONDS, like 2@5+60")?;
    let (which, at_s) = parse_which_at(which)?;
    Ok(Stop { which, at_s, for_s: parse_seconds(for_s)? })
}

fn parse_away(text: &str) -> Result<(f64, f64), String> {
    let (at, how_long) =
        text.split_once('+').ok_or("for how long? write SECOND+SECONDS, like 20+60")?;
    Ok((parse_seconds(at)?, parse_seconds(how_long)?))
}
