//! Simulates a farm in virtual time and formats its figures.

use super::error::FarmBenchError;
use crate::bench::clock::cpu_s;
use crate::bench::table::table;
use crate::farm::simulate::{self as sim, Case, Fault, Outcome, Work};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;

#[derive(Clone, Debug, Serialize)]
pub struct Simulation {
    simulated: bool,
    #[serde(flatten)]
    size: CaseSize,
    /// Number of faults of each kind.
    faults: BTreeMap<&'static str, u32>,
    over_bound: f64,
    #[serde(flatten)]
    pub outcome: Outcome,
    cpu_s: f64,
}

/// Size, seed and lease of a simulated or measured case.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct CaseSize {
    workers: u32,
    scenes: u32,
    shards: u32,
    seed: u64,
    pub(super) lease_s: f64,
}

impl CaseSize {
    pub(super) fn of(case: &Case) -> Self {
        let Work { scenes, shards, seed, .. } = case.work;
        Self { workers: case.fleet.workers, scenes, shards, seed, lease_s: case.rules.lease_s }
    }
}

impl fmt::Display for CaseSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { workers, scenes, shards, seed, .. } = self;
        write!(f, "{workers} workers, {scenes} scenes of {shards} shards, seed {seed}")
    }
}

/// Counts the faults of each kind.
fn fault_counts(faults: &[Fault]) -> BTreeMap<&'static str, u32> {
    let kinds = ["killed", "slow", "stopped", "wiped", "away"];
    let mut counts = BTreeMap::from(kinds.map(|kind| (kind, 0)));
    for fault in faults {
        let kind = match fault {
            Fault::Kill { .. } => "killed",
            Fault::Slow { .. } => "slow",
            Fault::Stop { .. } => "stopped",
            Fault::Wipe { .. } => "wiped",
            Fault::Away { .. } => "away",
        };
        *counts.entry(kind).or_default() += 1;
    }
    counts
}

pub fn simulate(case: &Case) -> Result<Simulation, FarmBenchError> {
    let (outcome, cpu_s) = cpu_s(|| sim::simulate(case));
    let outcome = outcome.ok_or(FarmBenchError::NeverEnds)?;
    Ok(Simulation {
        simulated: true,
        size: CaseSize::of(case),
        faults: fault_counts(&case.faults),
        over_bound: outcome.makespan_s / outcome.bound_s,
        outcome,
        cpu_s,
    })
}

impl Simulation {
    fn figures(&self) -> String {
        let o = &self.outcome;
        let rows = [
            ("lower bound", format!("{:.2} s", o.bound_s)),
            ("makespan", format!("{:.2} s ({:.3} x bound)", o.makespan_s, self.over_bound)),
            ("coordinator found all tuples", format!("{:.2} s", o.known_s)),
            ("loads", format!("{} ({:.3} a scene)", o.loads, o.loads_per_scene)),
            ("shards traced", format!("{} ({} again)", o.shards_traced, o.shards_traced_again)),
            (
                "requests for donations",
                format!(
                    "{} fulfilled ({} tasks), {} in vain",
                    o.donations, o.tasks_donated, o.requests_in_vain
                ),
            ),
            ("leases ended", o.leases_ended.to_string()),
            ("wrong acknowledgements", o.wrong_acknowledgements.to_string()),
            ("most messages in the stream", o.most_in_stream.to_string()),
            ("listings of partials by workers", o.worker_listings.to_string()),
            (
                "coordinator",
                format!(
                    "{} listings, {} pages of keys, {} of subjects",
                    o.reconciles, o.coordinator_pages, o.subject_pages
                ),
            ),
            ("finished tasks published", o.published_though_done.to_string()),
        ];
        let rows = rows.into_iter().map(|(name, value)| vec![name.to_owned(), value]);
        table("result | value", rows, 1)
    }

    fn messages(&self) -> String {
        let o = &self.outcome;
        let row =
            |name: &str, count: u64, peak: String| vec![name.to_owned(), count.to_string(), peak];
        let kinds = o.messages.iter().map(|m| row(m.name, m.count, m.peak_per_s.to_string()));
        let peak = format!("{} (median {})", o.peak_messages_per_s, o.median_messages_per_s);
        let all = row("all", o.messages.iter().map(|m| m.count).sum(), peak);
        table("message | count | most in a second", kinds.chain([all]), 1)
    }
}

impl fmt::Display for Simulation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.size)?;
        for (kind, count) in self.faults.iter().filter(|(_, count)| **count > 0) {
            write!(f, ", {kind} {count}")?;
        }
        let Outcome { events, .. } = self.outcome;
        writeln!(f, " (simulated: {events} events in {:.1} CPU s)\n", self.cpu_s)?;
        write!(f, "{}\n{}", self.figures(), self.messages().trim_end())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::farm::simulate::{Fleet, Rules};

    fn case(faults: Vec<Fault>) -> Case {
        Case { work: Work::default(), fleet: Fleet::default(), rules: Rules::default(), faults }
    }

    #[test]
    fn text_and_json_have_the_same_figures() {
        let slow = Fault::Slow { worker: 1, times: 4.0 };
        let simulation = simulate(&case(vec![slow])).unwrap();
        let value = serde_json::to_value(&simulation).unwrap();
        assert_eq!(value["simulated"], true);
        assert_eq!(value["faults"]["slow"], 1);
        assert_eq!(value["faults"]["killed"], 0);
        let loads = value["loads"].as_u64().unwrap();
        let text = simulation.to_string();
        assert!(text.starts_with("8 workers, 50 scenes of 16 shards, seed 0, slow 1 ("));
        assert!(text.contains(&format!("{loads} (")), "{text}");
        let pulls = &value["messages"]["pull"];
        assert!(pulls["count"].as_u64() >= pulls["peak_per_s"].as_u64());
    }

    #[test]
    fn a_farm_without_workers_never_ends() {
        let kill = |worker| Fault::Kill { worker, at_s: 1.0 };
        let error = simulate(&case((0..8).map(kill).collect())).unwrap_err();
        assert!(error.to_string().contains("no worker is left"), "{error}");
    }
}
