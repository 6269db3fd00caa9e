//! Formats a view for `/metrics`, in Prometheus's text format, version 0.0.4.

use super::view::{FarmView, WorkerState, WorkerView};
use crate::run::RunState;
use std::collections::BTreeMap;
use std::fmt::Write;

/// The content type that scrapers expect.
pub(super) const CONTENT_TYPE: &str = "text/plain; version=0.0.4; charset=utf-8";

/// Formats all metrics of a view. A metric with an unknown value has no sample.
pub(super) fn metrics(view: &FarmView) -> String {
    let mut out = Out(String::new());
    out.family("run_info", "gauge", "The run; always 1.");
    let labels = [("name", view.name.as_str()), ("run", &view.run), ("version", &view.version)];
    out.sample("run_info", &labels, 1.0);
    out.family("run_state", "gauge", "1 for the current state of the run.");
    for state in RunState::ALL {
        let is_it = u8::from(state == view.state);
        out.sample("run_state", &[("state", state.name())], is_it.into());
    }
    let counts = [
        ("scenes", "Number of scenes in the run.", view.scenes.total),
        ("scenes_done", "Number of scenes with a tuple.", view.scenes.done),
        ("scenes_quarantined", "Number of scenes in quarantine.", view.quarantined),
        ("shards", "Number of shards in the run.", view.shards.total),
        ("shards_done", "Number of finished shards.", view.shards.done),
    ];
    for (name, help, count) in counts {
        out.one(name, help, Some(count as f64));
    }
    out.one(
        "scenes_per_second",
        "Finished scenes per second, over the last minutes.",
        view.rate_scenes_per_s,
    );
    out.one(
        "eta_seconds",
        "Seconds until the last tuple, by the rate of shards, or else by the rate of scenes.",
        view.eta_s,
    );
    let connected = Some(u8::from(view.queue.connected).into());
    out.one("queue_connected", "1 if the coordinator is connected to the queue.", connected);
    let waiting = view.queue.spans_waiting.map(|n| n as f64);
    out.one("queue_spans_waiting", "Number of tasks that no worker holds.", waiting);
    let held = view.queue.spans_held.map(|n| n as f64);
    out.one("queue_spans_held", "Number of tasks that workers hold.", held);
    workers(&mut out, &view.workers);
    let newest = view.recent.iter().map(|tuple| tuple.age_s);
    out.one(
        "last_tuple_age_seconds",
        "Seconds since the coordinator found the newest tuple; 0 if the tuple is older than the coordinator.",
        newest.min_by(f64::total_cmp),
    );
    out.0
}

fn workers(out: &mut Out, workers: &[WorkerView]) {
    out.family("workers", "gauge", "Number of workers in each state.");
    for state in WorkerState::ALL {
        let count = workers.iter().filter(|w| w.state == state).count();
        out.sample("workers", &[("state", state.name())], count as f64);
    }
    // A scraper rejects the whole page if a series occurs twice. If two workers have the same name and host, the worker
    // with the latest progress remains.
    let mut named: BTreeMap<[&str; 2], &WorkerView> = BTreeMap::new();
    for worker in workers {
        let place = named.entry([&worker.name, &worker.host]).or_insert(worker);
        if worker.last_progress_s < place.last_progress_s {
            *place = worker;
        }
    }
    out.family("worker_last_progress_seconds", "gauge", "Seconds since a worker made progress.");
    for ([name, host], worker) in &named {
        let labels = [("worker", *name), ("host", *host)];
        out.sample("worker_last_progress_seconds", &labels, worker.last_progress_s);
    }
    out.family(
        "worker_shards_done_total",
        "counter",
        "Number of shards of the tuples that a worker has made since the coordinator started.",
    );
    for ([name, host], worker) in &named {
        let labels = [("worker", *name), ("host", *host)];
        out.sample("worker_shards_done_total", &labels, worker.shards_done as f64);
    }
    out.family("worker_info", "gauge", "A worker's version and state; always 1.");
    for ([name, host], worker) in &named {
        let (version, state) = (worker.version.as_str(), worker.state.name());
        let labels = [("worker", *name), ("host", *host), ("version", version), ("state", state)];
        out.sample("worker_info", &labels, 1.0);
    }
}

struct Out(String);

/// Escapes the value of a label.
fn label(text: &str) -> String {
    let text = text.replace('\\', "\\\\").replace('"', "\\\"");
    text.replace('\n', "\\n")
}

impl Out {
    fn family(&mut self, name: &str, kind: &str, help: &str) {
        let _ = writeln!(self.0, "# HELP glasshouse_{name} {help}");
        let _ = writeln!(self.0, "# TYPE glasshouse_{name} {kind}");
    }

    fn sample(&mut self, name: &str, labels: &[(&str, &str)], value: f64) {
        let pair = |(key, text): &(&str, &str)| format!("{key}=\"{}\"", label(text));
        let pairs: Vec<String> = labels.iter().map(pair).collect();
        let labels =
            if pairs.is_empty() { String::new() } else { format!("{{{}}}", pairs.join(",")) };
        let value = if value.is_finite() { value.to_string() } else { "NaN".to_owned() };
        let _ = writeln!(self.0, "glasshouse_{name}{labels} {value}");
    }

    /// Adds a gauge without labels, if its value is known.
    fn one(&mut self, name: &str, help: &str, value: Option<f64>) {
        if let Some(value) = value {
            self.family(name, "gauge", help);
            self.sample(name, &[], value);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_escaped() {
        assert_eq!(label("a\\b\"c\nd"), "a\\\\b\\\"c\\nd");
    }
}
