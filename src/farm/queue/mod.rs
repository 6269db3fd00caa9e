//! The queue: a set of messages with one task each. Workers lease tasks, renew the leases and finish them.
//!
//! A queue may lose, repeat or restore any message without changing the results, because only the store records
//! which scenes are done. Two implementations, one inside a process and one on NATS JetStream, pass the same tests
//! (`tests/farm/queues.rs`).

mod local;
#[cfg(feature = "nats")]
mod nats;
#[cfg(feature = "nats")]
mod nats_coordinator;
#[cfg(feature = "nats")]
mod nats_diagnosis;
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
use std::time::Duration;

/// A task in the queue.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Message {
    pub task: Task,
    /// Number of times that workers have passed the task on; the coordinator publishes 0.
    pub hops: u32,
}

/// A worker's temporary right to a task.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Lease {
    /// Identifies the lease in calls of [`Queue`].
    pub id: u64,
    pub message: Message,
    /// True if the queue has delivered the message before; the earlier worker has probably died.
    pub redelivered: bool,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Taken {
    Lease(Lease),
    Nothing,
    Ended,
    /// No lease, because the queue cannot be reached or used.
    Lost(QueueError),
    /// No lease: the queue delivered a message that names no task of this run. This call has removed it, and the
    /// coordinator publishes its scene again. Later calls may succeed.
    Removed(String),
}

/// An idle worker's request for a donation.
pub struct Request {
    /// Time that the requester takes to load a scene, if it has loaded one.
    pub load_s: Option<f64>,
    tell: Box<dyn FnOnce(Answer) + Send>,
}

/// The answer to a request.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Answer {
    /// Number of tasks that the donor published.
    pub tasks: u32,
    /// Time that the donor takes to load a scene, if it has loaded one.
    pub load_s: Option<f64>,
}

impl Request {
    pub fn answer(self, answer: Answer) {
        (self.tell)(answer);
    }
}

/// A failed call to the queue. Leases stay valid until they expire, so no task is lost.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum QueueError {
    /// A later call may succeed.
    #[error("the queue cannot be reached: {0}")]
    Away(String),
    /// No later call can succeed, unless someone changes the server or the command. The text has the remedy.
    #[error("the queue cannot be used: {0}")]
    Hopeless(String),
}

pub trait Queue: Send + Sync {
    /// Leases a task, and waits up to `wait` until one is available. A `wait` of zero returns at once.
    fn take(&self, wait: Duration) -> Taken;
    /// Publishes messages. On return the queue has them. Returns false if the queue already had one of them. Another
    /// worker may be about to finish that message, so the caller must not finish the lease that the messages replace.
    fn publish(&self, messages: &[Message]) -> Result<bool, QueueError>;
    fn renew(&self, lease: u64);
    /// Ends the lease of a task that is done or published again.
    fn finish(&self, lease: u64);
    /// Requests work from a busy worker. `load_s`: time that this worker takes to load a scene, s, if known.
    fn request(&self, load_s: Option<f64>) -> Answer;
    /// Starts (`able`) or stops receiving requests of other workers.
    fn accept_requests(&self, able: bool);
    /// Waits up to `wait` for another worker's request.
    fn requested(&self, wait: Duration) -> Option<Request>;
}

/// A message in the queue, as [`QueueKeeper::messages`] lists it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Listed {
    pub message: Message,
    /// True if the message waits for its first delivery. Otherwise a client holds it, or held it.
    pub waits: bool,
    /// True if the message's bytes name the task that its subject names. Otherwise it only keeps the subject from others,
    /// until a worker removes it.
    pub is_readable: bool,
}

pub trait QueueKeeper: Send + Sync {
    /// Creates the queue if needed. Returns true in the first call, and if any process created it since the last call.
    fn ensure(&self) -> Result<bool, QueueError>;
    fn state(&self) -> Result<QueueState, QueueError>;
    /// Returns the messages in the queue with subjects that name tasks of this run. All others are as good as absent: a
    /// worker removes them. The bytes of each message were read at least once.
    fn messages(&self) -> Result<Vec<Listed>, QueueError>;
    /// Publishes messages. A message that is already in the queue is not an error.
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
    /// True if no message waits and no worker holds one, even if [`QueueKeeper::messages`] still lists some.
    pub fn is_quiet(&self) -> bool {
        self.waiting == 0 && self.held == 0
    }
}
