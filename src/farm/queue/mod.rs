//! Which worker does what: a set of messages, each a task, that workers lease, renew and finish.
//!
//! A queue is a hint. It may forget, repeat or bring back any message, and the results do not change: the store alone tells
//! what is done. Two queues keep the same promises and pass the same tests (`tests/farm/queues.rs`): one inside a
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

/// A task that this worker has, until its lease ends.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Lease {
    /// Names it in the calls of [`Queue`].
    pub id: u64,
    pub message: Message,
    /// An earlier holder was lost with it.
    pub redelivered: bool,
}

/// What [`Queue::take`] found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Taken {
    Lease(Lease),
    Nothing,
    Ended,
    /// The queue cannot be reached, for this reason. It may come back.
    Lost(String),
}

/// Another worker has nothing to do, and requests a donation.
pub struct Request {
    /// Seconds in which it loads a scene, if it has loaded one.
    pub load_s: Option<f64>,
    tell: Box<dyn FnOnce(Answer) + Send>,
}

/// What a worker says to a request.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Answer {
    /// Tasks that it published.
    pub tasks: u32,
    /// Seconds in which it loads a scene, if it has loaded one.
    pub load_s: Option<f64>,
}

impl Request {
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
    /// Leases a task, waiting for one up to `wait`; with a `wait` of zero, one that is there now.
    fn take(&self, wait: Duration) -> Taken;
    /// Publishes messages. On return the queue has them; one that it has already is no error.
    fn publish(&self, messages: &[Message]) -> Result<(), QueueError>;
    fn renew(&self, lease: u64);
    /// Gives a lease back: all of its task is done, or published again.
    fn finish(&self, lease: u64);
    /// Requests work of some busy worker, telling in how many seconds this one loads a scene, if that is known.
    fn request(&self, load_s: Option<f64>) -> Answer;
    /// Says whether this worker may be requested to donate.
    fn accept_requests(&self, able: bool);
    /// Waits for another worker's request.
    fn requested(&self, wait: Duration) -> Option<Request>;
}

/// The coordinator's end of a queue.
pub trait QueueKeeper: Send + Sync {
    /// Makes the queue if it is not there. True if it is another than at the last call, whoever made it.
    fn ensure(&self) -> Result<bool, QueueError>;
    /// How much is in it.
    fn look(&self) -> Result<QueueState, QueueError>;
    /// Scenes that have a message in it.
    fn scenes(&self) -> Result<BTreeSet<u32>, QueueError>;
    /// Publishes messages. On return the queue has them; one that it has already is no error.
    fn publish(&self, messages: &[Message]) -> Result<(), QueueError>;
    fn purge(&self) -> Result<(), QueueError>;
    fn remove(&self) -> Result<(), QueueError>;
}

/// How much is in a queue.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct QueueState {
    pub waiting: u64,
    /// Messages that are leased.
    pub held: u64,
}

impl QueueState {
    /// No worker will get anything more from it, whatever is said to be in it.
    pub fn is_quiet(&self) -> bool {
        self.waiting == 0 && self.held == 0
    }
}
