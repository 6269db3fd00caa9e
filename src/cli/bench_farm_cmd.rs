//! `bench farm`

use super::args::Global;
use super::bench_farm_args::{BenchFarmArgs, Which};
use super::exit_code::{Exit, Failure};
use super::output::Output;
use super::{bench_farm_makespan, bench_farm_measure, bench_farm_resume};
use crate::bench::{align, thread_cpu_s};
use crate::farm::simulate::{
    Case, Fault, Fleet, KINDS, Kind, Outcome, Rules, Work, lower_bound_s, simulate, some_workers,
};
use anyhow::anyhow;
use serde_json::{Map, Value, json};
use std::fmt::Write;

pub(super) const SCHEMA: &str = "glasshouse.bench_farm/1";

/// Processes that are started at most.
const MOST_WORKERS: u32 = 256;

pub(super) fn run(args: &BenchFarmArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    if args.simulate {
        return simulated(args, output);
    }
    if args.workers > MOST_WORKERS {
        let what = format!(
            "at most {MOST_WORKERS} workers are started; more can be simulated (--simulate)"
        );
        return Err(usage(what));
    }
    let (mode, what) = match (args.makespan, args.resume) {
        (true, _) => (
            "makespan",
            "real workers on a queue, tasks that sleep, twice",
        ),
        (_, true) => (
            "resume",
            "a run that is half done would be made and begun again",
        ),
        _ => ("overhead", "real workers on a queue and inside one process"),
    };
    if global.dry_run {
        let object = json!({ "measured": true, "mode": mode, "dry_run": true });
        output.result(SCHEMA, object, &format!("would measure: {what}"));
        return Ok(Exit::Done);
    }
    match mode {
        "makespan" => bench_farm_makespan::run(args, global, output),
        "resume" => bench_farm_resume::run(args, global, output),
        _ => bench_farm_measure::run(args, global, output),
    }
}

fn simulated(args: &BenchFarmArgs, output: &Output) -> Result<Exit, Failure> {
    let case = case(args)?;
    let since_s = thread_cpu_s();
    let Some(outcome) = simulate(&case) else {
        let what = "the run would never end: no worker is left, or the faults outweigh the rules; \
                    leave more workers alive, or lengthen --lease-s";
        return Err(Failure::new(Exit::Failed, anyhow!(what)));
    };
    let cpu_s = thread_cpu_s() - since_s;
    output.result(
        SCHEMA,
        object(&case, &outcome, cpu_s),
        text(&case, &outcome, cpu_s).trim_end(),
    );
    Ok(Exit::Done)
}

fn usage(what: impl Into<String>) -> Failure {
    Failure::new(Exit::Usage, anyhow!(what.into()))
}

/// The case of the arguments, to be simulated or done.
pub(super) fn case(args: &BenchFarmArgs) -> Result<Case, Failure> {
    let lease_s = args
        .lease_s
        .unwrap_or(if args.simulate { 30.0 } else { 2.0 });
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
        rules: Rules {
            lease_s,
            reconcile_s: args.reconcile_s,
        },
        faults: Vec::new(),
    };
    let workers = args.workers;
    let chosen = |which: Which, salt: u64| match which {
        Which::One(worker) if worker >= workers => Err(usage(format!(
            "there is no worker {worker}: they are 0 to {}",
            workers - 1
        ))),
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
            faults.push(Fault::Stop {
                worker,
                at_s,
                for_s,
            });
        }
    }
    faults.extend(args.wipe.iter().map(|&at_s| Fault::Wipe { at_s }));
    let away = args.away.iter();
    faults.extend(away.map(|&(at_s, for_s)| Fault::Away { at_s, for_s }));
    case.faults.append(&mut faults);
    Ok(case)
}

/// How many workers each kind of fault meets.
fn fault_counts(case: &Case) -> [(&'static str, usize); 5] {
    let count = |is: fn(&Fault) -> bool| case.faults.iter().filter(|f| is(f)).count();
    [
        ("killed", count(|f| matches!(f, Fault::Kill { .. }))),
        ("slow", count(|f| matches!(f, Fault::Slow { .. }))),
        ("stopped", count(|f| matches!(f, Fault::Stop { .. }))),
        ("wiped", count(|f| matches!(f, Fault::Wipe { .. }))),
        ("away", count(|f| matches!(f, Fault::Away { .. }))),
    ]
}

fn name(kind: Kind) -> &'static str {
    KINDS.iter().find(|(k, _)| *k == kind).map_or("", |k| k.1)
}

fn object(case: &Case, o: &Outcome, cpu_s: f64) -> Value {
    let messages: Map<String, Value> = o
        .messages
        .iter()
        .map(|m| {
            let value = json!({ "count": m.count, "peak_per_s": m.peak_per_s });
            (name(m.kind).to_owned(), value)
        })
        .collect();
    let faults: Map<String, Value> = fault_counts(case)
        .iter()
        .map(|(name, count)| ((*name).to_owned(), json!(count)))
        .collect();
    json!({
        "simulated": true,
        "workers": case.fleet.workers, "scenes": case.work.scenes, "shards": case.work.shards, "seed": case.work.seed,
        "lease_s": case.rules.lease_s, "faults": faults,
        "makespan_s": o.makespan_s, "bound_s": o.bound_s, "over_bound": o.makespan_s / o.bound_s, "known_s": o.known_s,
        "loads": o.loads, "loads_per_scene": o.loads_per_scene,
        "shards_traced": o.shards_traced, "shards_traced_again": o.shards_traced_again,
        "gives": o.gives, "spans_given": o.spans_given, "asked_in_vain": o.asked_in_vain,
        "leases_ended": o.leases_ended, "wrong_acknowledgements": o.wrong_acknowledgements,
        "messages": messages, "peak_messages_per_s": o.peak_messages_per_s,
        "median_messages_per_s": o.median_messages_per_s, "most_in_stream": o.most_in_stream,
        "worker_listings": o.worker_listings, "coordinator_pages": o.coordinator_pages,
        "subject_pages": o.subject_pages, "reconciles": o.reconciles,
        "published_though_done": o.published_though_done,
        "events": o.events, "cpu_s": cpu_s,
    })
}

fn text(case: &Case, o: &Outcome, cpu_s: f64) -> String {
    let (fleet, work) = (&case.fleet, &case.work);
    let mut text = format!(
        "{} workers, {} scenes of {} shards, seed {}",
        fleet.workers, work.scenes, work.shards, work.seed
    );
    for (name, count) in fault_counts(case).iter().filter(|(_, n)| *n > 0) {
        let _ = write!(text, ", {name} {count}");
    }
    let _ = writeln!(
        text,
        " (simulated: {} events in {cpu_s:.1} CPU s)\n",
        o.events
    );
    let row = |name: &str, value: String| vec![name.to_owned(), value];
    let rows = [
        row("result", "value".to_owned()),
        row("lower bound", format!("{:.2} s", o.bound_s)),
        row(
            "makespan",
            format!(
                "{:.2} s ({:.3} x bound)",
                o.makespan_s,
                o.makespan_s / o.bound_s
            ),
        ),
        row("coordinator knows", format!("{:.2} s", o.known_s)),
        row(
            "loads",
            format!("{} ({:.3} a scene)", o.loads, o.loads_per_scene),
        ),
        row(
            "shards traced",
            format!("{} ({} again)", o.shards_traced, o.shards_traced_again),
        ),
        row(
            "requests to give",
            format!(
                "{} fulfilled ({} spans), {} in vain",
                o.gives, o.spans_given, o.asked_in_vain
            ),
        ),
        row("leases ended", o.leases_ended.to_string()),
        row(
            "wrong acknowledgements",
            o.wrong_acknowledgements.to_string(),
        ),
        row("most messages in the stream", o.most_in_stream.to_string()),
        row(
            "looks into the store by workers",
            o.worker_listings.to_string(),
        ),
        row(
            "coordinator",
            format!(
                "{} listings, {} pages of keys, {} of subjects",
                o.reconciles, o.coordinator_pages, o.subject_pages
            ),
        ),
        row("published though done", o.published_though_done.to_string()),
    ];
    text += &align(&rows, 1);
    text += "\n";
    let mut table = vec![
        ["message", "count", "most in a second"]
            .map(str::to_owned)
            .to_vec(),
    ];
    for m in &o.messages {
        let cells = [
            name(m.kind).to_owned(),
            m.count.to_string(),
            m.peak_per_s.to_string(),
        ];
        table.push(cells.to_vec());
    }
    let all: u64 = o.messages.iter().map(|m| m.count).sum();
    let last = [
        "all".to_owned(),
        all.to_string(),
        format!(
            "{} (median {})",
            o.peak_messages_per_s, o.median_messages_per_s
        ),
    ];
    table.push(last.to_vec());
    text += &align(&table, 1);
    text
}
