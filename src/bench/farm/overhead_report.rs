//! What `bench farm` measured, and how it is told.

use super::bench_cmd::on_cpu;
use super::bench_farm_measure::{ASLEEP_S, REAL};
use super::bench_farm_place::Place;
use crate::bench::align;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fmt::Write;

/// A run of the farm.
pub(super) struct Measured {
    /// `nats` or `process`.
    pub(super) queue: &'static str,
    pub(super) workers: u32,
    pub(super) shards: u64,
    /// What each slept.
    pub(super) asleep_s: f64,
    pub(super) wall_s: f64,
    /// CPU seconds of all workers after their start, by stage.
    pub(super) cpu: BTreeMap<String, f64>,
    pub(super) coordinator_cpu_s: f64,
    /// None if nobody tells.
    pub(super) server_cpu_s: Option<f64>,
}

impl Measured {
    pub(super) fn cpu_of(&self, stage: &str) -> f64 {
        self.cpu.get(stage).copied().unwrap_or(0.0)
    }

    /// All CPU seconds but those of starting.
    pub(super) fn all_cpu_s(&self) -> f64 {
        let workers: f64 = self.cpu.values().sum();
        workers - self.cpu_of("before") + self.coordinator_cpu_s + self.server_cpu_s.unwrap_or(0.0)
    }

    /// Checkpoints, queue, leases, coordinator, and whatever the store's threads do for tuples: at least what the farm
    /// costs, at most a little more.
    pub(super) fn farm_cpu_s(&self) -> f64 {
        self.all_cpu_s() - self.cpu_of("trace") - self.around_cpu_s()
    }

    /// From files to the tracer, and from there to tuples.
    fn around_cpu_s(&self) -> f64 {
        let stages = ["read", "decode", "merge", "encode", "write"];
        stages.map(|stage| self.cpu_of(stage)).iter().sum()
    }

    pub(super) fn shards_per_s(&self) -> f64 {
        self.shards as f64 / self.wall_s
    }

    pub(super) fn farm_cpu_us(&self) -> f64 {
        self.farm_cpu_s() / self.shards as f64 * 1e6
    }

    /// A worker's time a shard, beyond what the shard slept.
    pub(super) fn wall_us(&self) -> f64 {
        (self.wall_s * f64::from(self.workers) / self.shards as f64 - self.asleep_s) * 1e6
    }

    pub(super) fn object(&self) -> Value {
        json!({
            "queue": self.queue, "workers": self.workers, "shards": self.shards, "shard_s": self.asleep_s,
            "wall_s": self.wall_s, "shards_per_s": self.shards_per_s(),
            "overhead_cpu_us_per_shard": self.farm_cpu_us(), "overhead_wall_us_per_shard": self.wall_us(),
            "overhead_cpu_share": self.farm_cpu_s() / self.all_cpu_s(),
            "cpu_seconds": self.cpu, "coordinator_cpu_s": self.coordinator_cpu_s, "server_cpu_s": self.server_cpu_s,
        })
    }
}

pub(super) fn text(place: &Place, measured: &[Measured], real: &Measured) -> String {
    let mut text = format!("queue: {}{}\n\n", place.queue_name(), on_cpu());
    let mut tables = |title: &str, asleep: bool, queue: &str| {
        let rows: Vec<&Measured> = measured
            .iter()
            .filter(|m| (m.asleep_s > 0.0) == asleep && m.queue == queue)
            .collect();
        if rows.is_empty() {
            return;
        }
        let head = [
            title,
            "shards",
            "shards/s",
            "of ideal",
            "CPU us a shard",
            "worker us a shard",
        ];
        let mut table = vec![head.map(str::to_owned).to_vec()];
        for m in rows {
            let ideal = f64::from(m.workers) / m.asleep_s;
            table.push(vec![
                m.workers.to_string(),
                m.shards.to_string(),
                format!("{:.1}", m.shards_per_s()),
                if asleep {
                    format!("{:.1} %", 100.0 * m.shards_per_s() / ideal)
                } else {
                    String::new()
                },
                format!("{:.0}", m.farm_cpu_us()),
                format!("{:.0}", m.wall_us()),
            ]);
        }
        let _ = writeln!(text, "{}", align(&table, 0));
    };
    for (queue, who) in [("nats", "workers"), ("process", "threads")] {
        tables(&format!("{who}, shards that cost nothing"), false, queue);
        let title = format!("{who}, shards that sleep {ASLEEP_S} s");
        tables(&title, true, queue);
    }
    let share = |s: f64| 100.0 * s / real.all_cpu_s();
    let _ = writeln!(
        text,
        "{} shards of {} px and {} samples, {} workers: {:.2} CPU s, of which tracer {:.1} %, decoding and merging {:.1} %, \
         checkpoints and queue {:.2} % ({:.0} us a shard; with coordinator, server and the store's threads)",
        real.shards,
        REAL[0],
        REAL[1],
        real.workers,
        real.all_cpu_s(),
        share(real.cpu_of("trace")),
        share(real.around_cpu_s()),
        share(real.farm_cpu_s()),
        real.farm_cpu_us(),
    );
    text
}
