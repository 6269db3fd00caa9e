//! Who works on what: a set of spans that workers take, hold for a while, and finish.
//!
//! A queue is a hint. It may forget, repeat or bring back any span, and the results do not change: what is done is told
//! by the store alone. Two queues keep the same promises and pass the same tests (`tests/farm/queues.rs`): one inside a
//! process, and NATS JetStream.

mod local;
#[cfg(feature = "nats")]
mod nats;
#[cfg(feature = "nats")]
mod nats_coordinator;
#[cfg(feature = "nats")]
mod nats_probe;
#[cfg(feature = "nats")]
mod nats_worker;

pub use local::{LocalQueue, LocalWorker};
#[cfg(feature = "nats")]
pub use nats::NatsOptions;
#[cfg(feature = "nats")]
pub use nats_coordinator::NatsCoordinator;
#[cfg(feature = "nats")]
pub use nats_probe::{NatsAccount, NatsFacts, probe_nats};
#[cfg(feature = "nats")]
pub use nats_worker::NatsWorker;

pub use super::message::{MessageError, read_waiting, write_waiting};
use crate::run::Span;
use std::collections::BTreeSet;
use std::time::Duration;

/// Work that waits, and how often it was handed on from worker to worker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Waiting {
    /// The work.
    pub span: Span,
    /// 0 as the coordinator publishes it.
    pub handed_on: u32,
}

/// A span that this worker holds now, until its lease ends.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Delivery {
    /// Names it in the calls of [`Queue`].
    pub ticket: u64,
    /// The work.
    pub waiting: Waiting,
    /// An earlier holder was lost with it.
    pub suspect: bool,
}

/// What [`Queue::take`] found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Taken {
    /// Something to do.
    Span(Delivery),
    /// Nothing now.
    Nothing,
    /// Nothing any more.
    Ended,
    /// The queue cannot be reached, for this reason. It may come back.
    Lost(String),
}

/// Another worker has nothing to do.
pub struct Ask {
    /// Seconds in which it loads a scene, if it has loaded one.
    pub load_s: Option<f64>,
    tell: Box<dyn FnOnce(Answer) + Send>,
}

/// What a worker that was asked for work says.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Answer {
    /// Spans that it published.
    pub spans: u32,
    /// Seconds in which it loads a scene, if it has loaded one.
    pub load_s: Option<f64>,
}

impl Ask {
    /// Answers it.
    pub fn answer(self, answer: Answer) {
        (self.tell)(answer);
    }
}

/// The queue could not be told something. What is held stays held until its lease ends, so nothing is lost.
#[derive(Debug, thiserror::Error)]
#[error("the queue cannot be reached: {0}")]
pub struct QueueError(pub String);

/// One worker's end of a queue.
pub trait Queue: Send + Sync {
    /// Takes a span, waiting for one up to `wait`; with a `wait` of zero, one that is there now.
    fn take(&self, wait: Duration) -> Taken;
    /// Publishes spans. On return the queue has them; one that it has already is no error.
    fn publish(&self, waiting: &[Waiting]) -> Result<(), QueueError>;
    /// Begins the lease of a held span anew.
    fn renew(&self, ticket: u64);
    /// Gives a span up: all of it is done, or published again.
    fn finish(&self, ticket: u64);
    /// Asks some busy worker for work, telling in how many seconds this one loads a scene, if that is known.
    fn ask(&self, load_s: Option<f64>) -> Answer;
    /// Says whether this worker may be asked.
    fn offer(&self, able: bool);
    /// Waits for another worker's question.
    fn asked(&self, wait: Duration) -> Option<Ask>;
}

/// The coordinator's end of a queue.
pub trait QueueKeeper: Send + Sync {
    /// Makes the queue if it is not there. True if it is another than at the last call, whoever made it.
    fn ensure(&self) -> Result<bool, QueueError>;
    /// How much is in it.
    fn look(&self) -> Result<QueueState, QueueError>;
    /// Scenes of which a span waits or is held.
    fn scenes(&self) -> Result<BTreeSet<u32>, QueueError>;
    /// Publishes spans. On return the queue has them; one that it has already is no error.
    fn publish(&self, waiting: &[Waiting]) -> Result<(), QueueError>;
    /// Forgets all spans.
    fn purge(&self) -> Result<(), QueueError>;
    /// Removes the queue.
    fn remove(&self) -> Result<(), QueueError>;
}

/// How much is in a queue.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct QueueState {
    /// Spans that wait.
    pub waiting: u64,
    /// Spans that are held.
    pub held: u64,
}

impl QueueState {
    /// Nobody will get anything more from it, whatever is said to be in it.
    pub fn is_quiet(&self) -> bool {
        self.waiting == 0 && self.held == 0
    }
}
