//! Results of [`makespan`](super::makespan()).

use super::setup::Conditions;
use super::simulation::CaseSize;
use crate::bench::clock::median;
use crate::bench::table::table;
use crate::farm::simulate::{Case, Fault, simulate};
use serde::Serialize;
use serde_json::{Value, json};
use std::fmt;

#[derive(Clone, Debug, Serialize)]
pub struct Makespan {
    #[serde(flatten)]
    how: Conditions,
    #[serde(flatten)]
    size: CaseSize,
    load_s: f64,
    /// The passes without faults, then those with faults, if any.
    pub runs: Vec<MakespanRun>,
    /// True if the tuples of all runs equal those of one process bit for bit; false shows a defect.
    #[serde(rename = "tuples_equal_those_of_one_process")]
    pub tuples_equal: bool,
}

/// The passes of one case.
#[derive(Clone, Debug, Serialize)]
pub struct MakespanRun {
    #[serde(skip)]
    what: &'static str,
    faults: Vec<Value>,
    #[serde(skip)]
    fault_texts: Vec<String>,
    bound_s: f64,
    simulated_over_bound: Option<f64>,
    over_bound: f64,
    makespan_s: f64,
    known_s: f64,
    loads_per_scene: f64,
    pub passes: Vec<Pass>,
}

/// Figures of one run of the farm.
#[derive(Clone, Debug, Serialize)]
pub struct Pass {
    pub(super) makespan_s: f64,
    pub(super) over_bound: f64,
    pub(super) known_s: f64,
    pub(super) loads: u64,
    pub(super) spans_given: u64,
    pub(super) shards_traced: u64,
    #[serde(skip)]
    pub(super) digest: String,
}

/// Returns a fault as JSON and as text; `None` for faults that only the simulation has.
fn fault_row(fault: &Fault) -> Option<(Value, String)> {
    match *fault {
        Fault::Kill { worker, at_s } => Some((
            json!({ "killed": worker, "at_s": at_s }),
            format!("worker {worker} was killed after {at_s:.2} s; its shards are not counted"),
        )),
        Fault::Slow { worker, times } => Some((
            json!({ "slow": worker, "times": times }),
            format!("worker {worker} was {times} times slower"),
        )),
        _ => None,
    }
}

impl MakespanRun {
    pub(super) fn new(what: &'static str, case: &Case, bound_s: f64, passes: Vec<Pass>) -> Self {
        let of = |of: fn(&Pass) -> f64| median(&passes.iter().map(of).collect::<Vec<_>>());
        let (faults, fault_texts) = case.faults.iter().filter_map(fault_row).unzip();
        Self {
            what,
            faults,
            fault_texts,
            bound_s,
            simulated_over_bound: simulate(case).map(|o| o.makespan_s / o.bound_s),
            over_bound: of(|p| p.over_bound),
            makespan_s: of(|p| p.makespan_s),
            known_s: of(|p| p.known_s),
            loads_per_scene: of(|p| p.loads as f64) / f64::from(case.work.scenes),
            passes,
        }
    }

    fn row(&self) -> Vec<String> {
        let of = |of: fn(&Pass) -> u64| {
            median(&self.passes.iter().map(|p| of(p) as f64).collect::<Vec<_>>())
        };
        let each = self.passes.iter().map(|p| format!("{:.3}", p.over_bound));
        let each = each.collect::<Vec<_>>().join(", ");
        vec![
            self.what.to_owned(),
            format!("{:.2} s", self.bound_s),
            format!("{:.2} s", self.makespan_s),
            format!("{:.3} ({each})", self.over_bound),
            format!("{:.3}", self.simulated_over_bound.unwrap_or(f64::NAN)),
            format!("{:.3}", self.loads_per_scene),
            format!("{:.0}", of(|p| p.spans_given)),
            format!("{:.0}", of(|p| p.shards_traced)),
        ]
    }
}

impl Makespan {
    pub(super) fn new(
        how: Conditions,
        case: &Case,
        runs: Vec<MakespanRun>,
        tuples_equal: bool,
    ) -> Self {
        Self { how, size: CaseSize::of(case), load_s: case.work.load_s, runs, tuples_equal }
    }
}

impl fmt::Display for Makespan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{}; shards sleep, leases of {} s, {}; medians of {}\n",
            self.size,
            self.size.lease_s,
            self.how,
            self.runs.first().map_or(0, |run| run.passes.len()),
        )?;
        let head = " | bound | makespan | over bound | simulated | loads a scene | tasks donated | shards traced";
        f.write_str(&table(head, self.runs.iter().map(MakespanRun::row), 1))?;
        for fault in self.runs.last().iter().flat_map(|run| &run.fault_texts) {
            writeln!(f, "{fault}")?;
        }
        let same =
            if self.tuples_equal { "are bit for bit equal to those" } else { "DIFFER from those" };
        write!(f, "the tuples of all runs {same} of one process")
    }
}
