//! Results of [`overhead`](super::overhead()).

use super::overhead::{ASLEEP_S, REAL};
use super::setup::Conditions;
use crate::bench::table::table;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;

/// The farm's own cost per shard.
#[derive(Clone, Debug, Serialize)]
pub struct Overhead {
    #[serde(flatten)]
    pub how: Conditions,
    /// Runs with shards that cost almost nothing or sleep.
    pub runs: Vec<OverheadRun>,
    pub real_shards: OverheadRun,
}

#[derive(Clone, Debug, Default, Serialize)]
pub struct OverheadRun {
    /// `nats` or `process`.
    pub queue: &'static str,
    /// Number of processes on `nats`, or of threads in one `process`.
    pub workers: u32,
    pub shards: u64,
    /// Mean sleep of a shard, s; 0 for shards that do not sleep.
    pub shard_s: f64,
    /// Time from ready workers to the last written tuple, s.
    pub wall_s: f64,
    pub shards_per_s: f64,
    /// CPU time that the farm adds to a shard, us.
    pub overhead_cpu_us_per_shard: f64,
    /// Worker time per shard in addition to the sleep, us.
    pub overhead_wall_us_per_shard: f64,
    /// The farm's share of all CPU seconds after start-up.
    pub overhead_cpu_share: f64,
    /// CPU seconds of all workers, by stage.
    pub cpu_seconds: BTreeMap<String, f64>,
    pub coordinator_cpu_s: f64,
    /// CPU seconds of the NATS server, if known.
    pub server_cpu_s: Option<f64>,
}

impl OverheadRun {
    /// Computes the figures that follow from the measured ones.
    pub(super) fn finished(mut self) -> Self {
        let shards = self.shards as f64;
        self.shards_per_s = shards / self.wall_s;
        self.overhead_cpu_us_per_shard = self.farm_cpu_s() / shards * 1e6;
        let worker_s = self.wall_s * f64::from(self.workers) / shards;
        self.overhead_wall_us_per_shard = (worker_s - self.shard_s) * 1e6;
        self.overhead_cpu_share = self.farm_cpu_s() / self.all_cpu_s();
        self
    }

    fn cpu_of(&self, stage: &str) -> f64 {
        self.cpu_seconds.get(stage).copied().unwrap_or(0.0)
    }

    /// Returns all CPU seconds except those of the start-up.
    fn all_cpu_s(&self) -> f64 {
        let workers: f64 = self.cpu_seconds.values().sum();
        workers - self.cpu_of("before") + self.coordinator_cpu_s + self.server_cpu_s.unwrap_or(0.0)
    }

    /// Returns the CPU seconds of reading and decoding inputs, and of merging, encoding and writing tuples.
    fn around_cpu_s(&self) -> f64 {
        let stages = ["read", "decode", "merge", "encode", "write"];
        stages.map(|stage| self.cpu_of(stage)).iter().sum()
    }

    /// Returns an upper bound of the farm's own CPU seconds: checkpoints, queue, leases, coordinator, NATS server, and
    /// all work of the store's threads for tuples.
    fn farm_cpu_s(&self) -> f64 {
        self.all_cpu_s() - self.cpu_of("trace") - self.around_cpu_s()
    }

    fn row(&self) -> Vec<String> {
        let ideal = f64::from(self.workers) / self.shard_s;
        let of_ideal = if self.shard_s > 0.0 {
            format!("{:.1} %", 100.0 * self.shards_per_s / ideal)
        } else {
            String::new()
        };
        vec![
            self.workers.to_string(),
            self.shards.to_string(),
            format!("{:.1}", self.shards_per_s),
            of_ideal,
            format!("{:.0}", self.overhead_cpu_us_per_shard),
            format!("{:.0}", self.overhead_wall_us_per_shard),
        ]
    }
}

impl Overhead {
    /// Formats the runs on one kind of queue, with or without sleep, as a table. Returns `None` without runs.
    fn table(&self, title: &str, asleep: bool, queue: &str) -> Option<String> {
        let is_row = |run: &&OverheadRun| (run.shard_s > 0.0) == asleep && run.queue == queue;
        let mut rows = self.runs.iter().filter(is_row).map(OverheadRun::row).peekable();
        let head =
            format!("{title} | shards | shards/s | of ideal | CPU us a shard | worker us a shard");
        rows.peek().is_some().then(|| table(&head, rows, 0))
    }
}

impl fmt::Display for Overhead {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "queue: {}\n", self.how)?;
        for (queue, who) in [("nats", "workers"), ("process", "threads")] {
            let titles = [
                (format!("{who}, shards that cost nothing"), false),
                (format!("{who}, shards that sleep {ASLEEP_S} s"), true),
            ];
            for (title, asleep) in titles {
                if let Some(table) = self.table(&title, asleep, queue) {
                    writeln!(f, "{table}")?;
                }
            }
        }
        let real = &self.real_shards;
        let share = |s: f64| 100.0 * s / real.all_cpu_s();
        write!(
            f,
            "{} shards of {} px and {} samples, {} workers: {:.2} CPU s: tracer {:.1} %, decoding and merging {:.1} %, \
             checkpoints and queue {:.2} % ({:.0} us a shard; with coordinator, server and the store's threads)",
            real.shards,
            REAL[0],
            REAL[1],
            real.workers,
            real.all_cpu_s(),
            share(real.cpu_of("trace")),
            share(real.around_cpu_s()),
            share(real.farm_cpu_s()),
            real.overhead_cpu_us_per_shard,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// In 2 s, four workers finish 100 shards that sleep 0.05 s each. The farm uses 1 of the 3.5 CPU seconds.
    #[test]
    fn derived_figures_follow_from_measured_ones() {
        let stages = [("before", 9.0), ("trace", 2.0), ("merge", 0.5), ("queue", 0.5)];
        let run = OverheadRun {
            queue: "nats",
            workers: 4,
            shards: 100,
            shard_s: 0.05,
            wall_s: 2.0,
            cpu_seconds: stages.map(|(stage, s)| (stage.to_owned(), s)).into(),
            coordinator_cpu_s: 0.25,
            server_cpu_s: Some(0.25),
            ..OverheadRun::default()
        }
        .finished();
        assert_eq!(run.shards_per_s, 50.0);
        assert_eq!(run.overhead_cpu_us_per_shard, 1e4);
        assert!((run.overhead_wall_us_per_shard - 3e4).abs() < 1e-6);
        assert!((run.overhead_cpu_share - 1.0 / 3.5).abs() < 1e-12);
        let overhead = Overhead {
            how: Conditions::new("overhead", "none", None),
            runs: vec![run.clone()],
            real_shards: run,
        };
        let text = overhead.to_string();
        assert!(text.contains("workers, shards that sleep 0.05 s"), "{text}");
        assert!(text.contains("62.5 %") && !text.contains("| threads"), "{text}");
        assert_eq!(serde_json::to_value(&overhead).unwrap()["mode"], "overhead");
    }
}
