//! What the machine asks of its driver.

use crate::farm::queue::Message;
use crate::run::Task;
use std::ops::Range;

/// Names a leased task inside its worker; never used again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(in crate::farm) struct TaskId(pub(super) u64);

/// Something to do. The actions of one event are done in order, and the first that cannot be done ends them: a lease is
/// never given back before what it covers is in the store or in another message.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::farm) enum Action {
    /// Put these partials into the store; tell [`stored`](super::Tasks::stored) of each.
    Store { task: TaskId, shards: Vec<u32> },
    /// Make the scene's tuple from what is in memory and put it into the store; then tell
    /// [`merged`](super::Tasks::merged).
    Merge { task: TaskId },
    /// Are all of the scene's partials in the store? Tell [`scene_checked`](super::Tasks::scene_checked).
    CheckScene { task: TaskId },
    /// Fetch the partials of other workers; then tell [`gathered`](super::Tasks::gathered).
    Gather { task: TaskId },
    /// Leave a note of which worker made these shards.
    LeaveNote { task: Task },
    /// Set the scene aside.
    Quarantine { scene: u32, reason: String },
    /// Remove the scene's partials: its tuple is in the store.
    RemovePartials { scene: u32 },
    /// Remove the record number `n` of the attempt at these shards: it has ended in order.
    ForgetAttempt { task: Task, n: u32 },
    /// Put messages into the queue, and wait until it has them.
    Publish { messages: Vec<Message> },
    /// Give the lease back to the queue.
    Finish { lease: u64 },
}

/// Shards to publish for an idle worker. When the queue has the message, tell [`donated`](super::Tasks::donated).
#[derive(Clone, Debug, PartialEq)]
pub(in crate::farm) struct Offer {
    pub(in crate::farm) task: TaskId,
    pub(in crate::farm) message: Message,
}

impl Offer {
    pub(in crate::farm) fn shards(&self) -> Range<u32> {
        self.message.task.shards.clone()
    }
}
