//! Results of a simulation, counted during the simulation.

use serde::{Serialize, Serializer};

/// Kinds of messages to and from the queue's server.
#[derive(Clone, Copy, Debug)]
pub(super) enum Kind {
    Publish,
    Pull,
    Deliver,
    Acknowledge,
    Renew,
    /// An idle worker requests a donation.
    Request,
    Answer,
    /// A worker subscribes to requests, or unsubscribes.
    Listen,
}

/// Names of the kinds in tables and JSON, in the order of [`Kind`].
const KINDS: [&str; 8] =
    ["publish", "pull", "deliver", "acknowledge", "renew", "ask", "answer", "listen"];

#[derive(Debug, Default)]
pub(super) struct Tally(Vec<[u32; KINDS.len()]>);

impl Tally {
    pub(super) fn count(&mut self, kind: Kind, now_us: u64) {
        let second = (now_us / 1_000_000) as usize;
        if second >= self.0.len() {
            self.0.resize(second + 1, [0; KINDS.len()]);
        }
        self.0[second][kind as usize] += 1;
    }

    fn messages(&self) -> Vec<Messages> {
        let of = |(kind, &name): (usize, &&'static str)| {
            let count = self.0.iter().map(|s| u64::from(s[kind])).sum();
            let peak_per_s = self.0.iter().map(|s| s[kind]).max().unwrap_or(0);
            Messages { name, count, peak_per_s }
        };
        KINDS.iter().enumerate().map(of).collect()
    }

    /// Returns the maximum number of messages of all kinds per second, and the median over the seconds up to `end_s`.
    fn peak_and_median(&self, end_s: f64) -> (u32, u32) {
        let end = (end_s as usize).clamp(1, self.0.len().max(1));
        let mut sums: Vec<u32> = self.0.iter().map(|s| s.iter().sum()).collect();
        let peak = sums.iter().copied().max().unwrap_or(0);
        sums.truncate(end);
        sums.sort_unstable();
        (peak, sums.get(sums.len() / 2).copied().unwrap_or(0))
    }
}

/// Figures of the messages of one kind.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Messages {
    #[serde(skip)]
    pub name: &'static str,
    pub count: u64,
    pub peak_per_s: u32,
}

/// The result of a simulation.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Outcome {
    /// Time until the store has the last tuple, s.
    pub makespan_s: f64,
    /// Time until the coordinator has found all tuples, s.
    pub known_s: f64,
    pub bound_s: f64,
    pub loads: u64,
    pub loads_per_scene: f64,
    pub shards_traced: u64,
    /// Number of traces of shards that had been traced before.
    pub shards_traced_again: u64,
    /// Number of requests that a donor fulfilled.
    #[serde(rename = "gives")]
    pub donations: u64,
    #[serde(rename = "spans_given")]
    pub tasks_donated: u64,
    #[serde(rename = "asked_in_vain")]
    pub requests_in_vain: u64,
    pub leases_ended: u64,
    /// Number of acknowledgements that removed another message, because the stream had been created again.
    pub wrong_acknowledgements: u64,
    /// Messages to and from the queue's server; in JSON, an object with the kinds as keys.
    #[serde(serialize_with = "by_kind")]
    pub messages: Vec<Messages>,
    pub peak_messages_per_s: u32,
    /// Median number of messages per second of the makespan.
    pub median_messages_per_s: u32,
    pub most_in_stream: u64,
    /// Number of listings of partials by workers: after loading a scene, and after storing a part of a scene.
    pub worker_listings: u64,
    /// Number of pages of 1000 keys that the coordinator listed.
    pub coordinator_pages: u64,
    /// Number of pages of the queue's subjects that the coordinator listed.
    pub subject_pages: u64,
    pub reconciles: u64,
    /// Number of tasks of finished scenes that the coordinator published.
    pub published_though_done: u64,
    pub events: u64,
}

fn by_kind<S: Serializer>(messages: &[Messages], to: S) -> Result<S::Ok, S::Error> {
    to.collect_map(messages.iter().map(|m| (m.name, m)))
}

impl Outcome {
    pub(super) fn finish(&mut self, tally: &Tally, scenes: u32) {
        self.loads_per_scene = self.loads as f64 / f64::from(scenes);
        self.messages = tally.messages();
        (self.peak_messages_per_s, self.median_messages_per_s) =
            tally.peak_and_median(self.makespan_s);
    }
}
