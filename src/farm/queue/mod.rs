//! The queue: a set of messages, each a task, that workers lease, renew and finish.
//!
//! A queue is a hint. It may forget, repeat or bring back any message without changing the results, since only the store
//! knows which scenes are done. Two queues keep the same promises and pass the same tests (`tests/farm/queues.rs`): one
//! inside a process, and NATS JetStream.

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

pub use super::message::{MessageError, read_message, write_message};
use crate::run::Task;
use std::collections::BTreeSet;
use std::time::Duration;

/// A task in the queue, and how often it went from worker to worker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Message {
    pub task: Task,
    /// 0 as the coordinator publishes it.
    pub hops: u32,
}

/// A worker's right to a task.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Lease {
    /// Names it in the calls of [`Queue`].
    pub id: u64,
    pub message: Message,
    /// It was delivered before, so an earlier worker was lost with it.
    pub redelivered: bool,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Taken {
    Lease(Lease),
    Nothing,
    Ended,
    /// The queue is away, for this reason. It may come back.
    Lost(String),
}

/// An idle worker's request for a donation.
pub struct Request {
    /// Seconds in which the requester loads a scene, if it has loaded one.
    pub load_s: Option<f64>,
    tell: Box<dyn FnOnce(Answer) + Send>,
}

/// The answer to a request.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Answer {
    /// Number of tasks that the donor published.
    pub tasks: u32,
    /// Seconds in which the donor loads a scene, if it has loaded one.
    pub load_s: Option<f64>,
}

impl Request {
    pub fn answer(self, answer: Answer) {
        (self.tell)(answer);
    }
}

/// The queue is away. Leases stand until they end by themselves, so no task is lost.
#[derive(Debug, thiserror::Error)]
#[error("the queue cannot be reached: {0}")]
pub struct QueueError(pub String);

pub trait Queue: Send + Sync {
    /// Leases a task, waiting for one up to `wait`; with a `wait` of zero, one that is there now.
    fn take(&self, wait: Duration) -> Taken;
    /// Publishes messages. On return the queue has them. False if it had one of them before: the holder of that one may have
    /// checked its scene already, and be about to finish it.
    fn publish(&self, messages: &[Message]) -> Result<bool, QueueError>;
    fn renew(&self, lease: u64);
    /// Ends a lease whose task is done, or published again.
    fn finish(&self, lease: u64);
    /// Requests work of some busy worker. `load_s`: seconds in which this worker loads a scene, if known.
    fn request(&self, load_s: Option<f64>) -> Answer;
    /// Begins or ceases to receive the requests of other workers.
    fn accept_requests(&self, able: bool);
    /// Waits for another worker's request up to `wait`.
    fn requested(&self, wait: Duration) -> Option<Request>;
}

pub trait QueueKeeper: Send + Sync {
    /// Makes the queue if it is not there. True if any process has made it anew since the last call.
    fn ensure(&self) -> Result<bool, QueueError>;
    fn state(&self) -> Result<QueueState, QueueError>;
    /// The scenes of its messages.
    fn scenes(&self) -> Result<BTreeSet<u32>, QueueError>;
    /// Publishes messages. A message that the queue has already is no error.
    fn publish(&self, messages: &[Message]) -> Result<(), QueueError>;
    fn purge(&self) -> Result<(), QueueError>;
    fn remove(&self) -> Result<(), QueueError>;
}

/// Numbers of messages in a queue.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct QueueState {
    pub waiting: u64,
    pub held: u64,
}

impl QueueState {
    /// It delivers no message any more, even if it lists some.
    pub fn is_quiet(&self) -> bool {
        self.waiting == 0 && self.held == 0
    }
}
