//! What a simulation reports.

use super::engine::Sim;
use super::tally::{KINDS, Kind};
use serde::{Serialize, Serializer};

/// What is counted on the way.
#[derive(Clone, Debug, Default)]
pub(super) struct Counts {
    pub(super) events: u64,
    pub(super) last_tuple_us: u64,
    pub(super) loads: u64,
    pub(super) shards_traced: u64,
    pub(super) shards_traced_again: u64,
    pub(super) gives: u64,
    pub(super) spans_given: u64,
    pub(super) asked_in_vain: u64,
    pub(super) leases_ended: u64,
    pub(super) wrong_acknowledgements: u64,
    pub(super) most_messages: usize,
    pub(super) worker_listings: u64,
    pub(super) coordinator_pages: u64,
    pub(super) coordinator_polls: u64,
    pub(super) subject_pages: u64,
    pub(super) reconciles: u64,
    pub(super) published_though_done: u64,
}

/// Messages of a kind.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Messages {
    #[serde(skip)]
    pub kind: Kind,
    pub count: u64,
    /// In the second with the most.
    pub peak_per_s: u32,
}

/// What a simulation reports.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Outcome {
    /// Seconds until the last tuple was in the store.
    pub makespan_s: f64,
    /// Seconds until the coordinator knew.
    pub known_s: f64,
    /// Seconds that no schedule can beat: (work + one load a scene) / speed that was there.
    pub bound_s: f64,
    pub loads: u64,
    pub loads_per_scene: f64,
    pub shards_traced: u64,
    /// Of them, those that the store had already.
    pub shards_traced_again: u64,
    /// Requests to give that were fulfilled.
    pub gives: u64,
    pub spans_given: u64,
    /// Requests to give without effect.
    pub asked_in_vain: u64,
    pub leases_ended: u64,
    /// Acknowledgements that removed a message of another scene, after the stream was made anew.
    pub wrong_acknowledgements: u64,
    /// Messages to and from the queue's server; by kind in JSON.
    #[serde(serialize_with = "by_kind")]
    pub messages: Vec<Messages>,
    /// All kinds, in the second with the most.
    pub peak_messages_per_s: u32,
    /// All kinds, median of the seconds of the makespan.
    pub median_messages_per_s: u32,
    /// Most messages in the stream.
    pub most_in_stream: u64,
    /// Requests to the store by workers: a look when a span is opened, and one when a part of a scene is finished.
    pub worker_listings: u64,
    /// Pages of 1000 keys that the coordinator listed.
    pub coordinator_pages: u64,
    /// Pages of the queue's subjects that it listed.
    pub subject_pages: u64,
    /// How often it listed.
    pub reconciles: u64,
    /// Spans that it published though their scene was done.
    pub published_though_done: u64,
    /// Events of the simulation.
    pub events: u64,
}

fn by_kind<S: Serializer>(messages: &[Messages], to: S) -> Result<S::Ok, S::Error> {
    to.collect_map(messages.iter().map(|m| (m.kind.name(), m)))
}

impl Sim<'_> {
    pub(super) fn outcome(&self, bound_s: f64) -> Outcome {
        let c = &self.counts;
        let makespan_s = c.last_tuple_us as f64 * 1e-6;
        let of_kind = |&(kind, _): &(Kind, &str)| {
            let (count, peak_per_s) = self.tally.of(kind);
            Messages { kind, count, peak_per_s }
        };
        Outcome {
            makespan_s,
            known_s: self.coordinator.finished_us.unwrap_or(self.now_us) as f64 * 1e-6,
            bound_s,
            loads: c.loads,
            loads_per_scene: c.loads as f64 / f64::from(self.case.work.scenes),
            shards_traced: c.shards_traced,
            shards_traced_again: c.shards_traced_again,
            gives: c.gives,
            spans_given: c.spans_given,
            asked_in_vain: c.asked_in_vain,
            leases_ended: c.leases_ended,
            wrong_acknowledgements: c.wrong_acknowledgements,
            messages: KINDS.iter().map(of_kind).collect(),
            peak_messages_per_s: self.tally.peak(),
            median_messages_per_s: self.tally.median(makespan_s),
            most_in_stream: c.most_messages as u64,
            worker_listings: c.worker_listings,
            coordinator_pages: c.coordinator_pages,
            subject_pages: c.subject_pages,
            reconciles: c.reconciles,
            published_though_done: c.published_though_done,
            events: c.events,
        }
    }
}
