//! The actions that the machine requests from its driver.

use crate::farm::queue::Message;
use crate::run::Task;
use std::ops::Range;

/// Identifier of a leased task inside its worker; never reused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) struct TaskId(pub(super) u64);

/// An action for the driver, which performs the actions of one event in order and stops at the first failure, so that a
/// lease is finished only after its shards are in the store or in another message, or its scene is in quarantine.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Action {
    /// Put these partials into the store; report each with [`stored`](super::Tasks::stored).
    Store { task: TaskId, shards: Vec<u32> },
    /// Make the scene's tuple from memory and put it into the store; then report [`merged`](super::Tasks::merged).
    Merge { task: TaskId },
    /// Check whether the store has all of the scene's partials; report [`scene_checked`](super::Tasks::scene_checked).
    CheckScene { task: TaskId },
    /// Fetch the partials of other workers; then report [`gathered`](super::Tasks::gathered).
    Gather { task: TaskId },
    /// Put the scene into quarantine.
    Quarantine { scene: u32, reason: String },
    /// Remove the scene's partials: its tuple is in the store.
    RemovePartials { scene: u32 },
    /// Remove record number `n` of the attempts at these shards: this attempt has ended properly.
    ForgetAttempt { task: Task, n: u32 },
    /// Publish messages in place of a lease, and finish the lease once the queue has confirmed them. If the queue
    /// already had one, let the lease expire, so that the task is delivered again. Otherwise, the scene could lose its
    /// last message: the worker with the earlier message finishes it if it found the scene incomplete before this
    /// worker stored its last shards.
    Replace { lease: u64, messages: Vec<Message> },
    /// Finish the lease, so that the queue removes its message.
    Finish { lease: u64 },
}

/// Shards to publish for an idle worker. Report [`donated`](super::Tasks::donated) after the queue's confirmation.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Offer {
    pub(crate) task: TaskId,
    pub(crate) message: Message,
}

impl Offer {
    pub(crate) fn shards(&self) -> Range<u32> {
        self.message.task.shards.clone()
    }
}
