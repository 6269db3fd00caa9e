//! What `bench farm --makespan` tells.

use super::bench_cmd::{cpu_name, on_cpu};
use super::bench_farm_place::{Place, median};
use crate::bench::align;
use crate::farm::simulate::{Case, Fault, simulate};
use serde_json::{Value, json};
use std::fmt::Write;

/// One run of the farm.
pub(super) struct Pass {
    pub(super) bound_s: f64,
    pub(super) makespan_s: f64,
    pub(super) known_s: f64,
    pub(super) loads: u64,
    pub(super) spans_given: u64,
    pub(super) shards_traced: u64,
    pub(super) digest: String,
}

impl Pass {
    pub(super) fn over_bound(&self) -> f64 {
        self.makespan_s / self.bound_s
    }
}

fn medians(passes: &[Pass], of: impl Fn(&Pass) -> f64) -> f64 {
    median(&passes.iter().map(of).collect::<Vec<_>>())
}

fn loads_per_scene(case: &Case, pass: &Pass) -> f64 {
    pass.loads as f64 / f64::from(case.work.scenes)
}

fn fault_list(case: &Case) -> Vec<Value> {
    let value = |fault: &Fault| match fault {
        Fault::Kill { worker, at_s } => Some(json!({ "killed": worker, "at_s": at_s })),
        Fault::Slow { worker, times } => Some(json!({ "slow": worker, "times": times })),
        _ => None,
    };
    case.faults.iter().filter_map(value).collect()
}

pub(super) fn object(
    place: &Place,
    kinds: &[(&str, &Case)],
    passes: &[Vec<Pass>],
    equal: bool,
) -> Value {
    let case = kinds[0].1;
    let rows = kinds.iter().zip(passes);
    let rows: Vec<Value> = rows
        .map(|((_, case), passes)| {
            let each = |p: &Pass| {
                json!({
                    "makespan_s": p.makespan_s, "over_bound": p.over_bound(), "known_s": p.known_s, "loads": p.loads,
                    "spans_given": p.spans_given, "shards_traced": p.shards_traced,
                })
            };
            json!({
                "faults": fault_list(case), "bound_s": passes[0].bound_s,
                "simulated_over_bound": simulate(case).map(|o| o.makespan_s / o.bound_s),
                "over_bound": medians(passes, Pass::over_bound),
                "makespan_s": medians(passes, |p| p.makespan_s), "known_s": medians(passes, |p| p.known_s),
                "loads_per_scene": medians(passes, |p| loads_per_scene(case, p)),
                "passes": passes.iter().map(each).collect::<Vec<_>>(),
            })
        })
        .collect();
    json!({
        "measured": true, "mode": "makespan", "queue": place.queue_name(), "cpu": cpu_name(),
        "workers": case.fleet.workers, "scenes": case.work.scenes, "shards": case.work.shards, "seed": case.work.seed,
        "load_s": case.work.load_s, "lease_s": case.rules.lease_s,
        "runs": rows, "tuples_equal_those_of_one_process": equal,
    })
}

pub(super) fn text(
    place: &Place,
    kinds: &[(&str, &Case)],
    passes: &[Vec<Pass>],
    equal: bool,
) -> String {
    let case = kinds[0].1;
    let mut text = format!(
        "{} workers, {} scenes of {} shards that sleep, seed {}, leases of {} s, {}{}; medians of {}\n\n",
        case.fleet.workers,
        case.work.scenes,
        case.work.shards,
        case.work.seed,
        case.rules.lease_s,
        place.queue_name(),
        on_cpu(),
        passes[0].len()
    );
    let head = [
        "",
        "bound",
        "makespan",
        "over bound",
        "simulated",
        "loads a scene",
        "spans given",
        "shards traced",
    ];
    let mut rows = vec![head.map(str::to_owned).to_vec()];
    for ((what, case), passes) in kinds.iter().zip(passes) {
        let all: Vec<String> = passes
            .iter()
            .map(|p| format!("{:.3}", p.over_bound()))
            .collect();
        let simulated = simulate(case).map_or(f64::NAN, |o| o.makespan_s / o.bound_s);
        rows.push(vec![
            (*what).to_owned(),
            format!("{:.2} s", passes[0].bound_s),
            format!("{:.2} s", medians(passes, |p| p.makespan_s)),
            format!(
                "{:.3} ({})",
                medians(passes, Pass::over_bound),
                all.join(", ")
            ),
            format!("{simulated:.3}"),
            format!("{:.3}", medians(passes, |p| loads_per_scene(case, p))),
            format!("{:.0}", medians(passes, |p| p.spans_given as f64)),
            format!("{:.0}", medians(passes, |p| p.shards_traced as f64)),
        ]);
    }
    text += &align(&rows, 1);
    let faults = kinds.last().map_or(&[][..], |(_, case)| &case.faults);
    for fault in faults {
        let _ = match fault {
            Fault::Kill { worker, at_s } => writeln!(
                text,
                "worker {worker} was killed after {at_s:.2} s; its shards are not counted"
            ),
            Fault::Slow { worker, times } => {
                writeln!(text, "worker {worker} was {times} times slower")
            }
            _ => Ok(()),
        };
    }
    let same = if equal {
        "are bit by bit those"
    } else {
        "ARE NOT those"
    };
    let _ = writeln!(text, "the tuples of all runs {same} of one process");
    text
}
