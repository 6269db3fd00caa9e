//! The tasks that a worker has leased, as a pure state machine: events in, actions out. It has no clock (events bring
//! the time), lock, store, thread or queue. A worker's threads, the simulator and the property tests all drive it.
//!
//! ```text
//!  lease -> Queued -> Pinned
//!              |  \     |  \
//!              |   +----+   +-> Sandboxed -> ends
//!              v        v
//!           donated   Loading -> Tracing -> Complete -> (tuple stored) ends
//!                                   |          ^
//!                                   v          | gathered
//!                                Partial -> Gathering
//!                                   |
//!                                   v
//!                      ends: another worker has the rest
//! ```
//!
//! [`state::next`] is the table of all transitions. A task ends once, and later events of the task are ignored.

mod action;
mod donate;
mod end;
mod shards;
mod state;
#[cfg(test)]
mod tests;

pub(crate) use action::{Action, Offer, TaskId};

use super::costs::Costs;
use crate::farm::queue::{Lease, Message};
use crate::run::Task;
use shards::{Shards, rows};
use state::{Next, TaskEvent, TaskState, next};
use std::collections::BTreeMap;
use std::ops::Range;
use std::time::Duration;

/// Time since the worker started.
pub(crate) type Time = Duration;

/// All leased tasks; `P` is the driver's data of a task with a loaded scene.
#[derive(Clone, Debug, Default)]
pub(crate) struct Tasks<P> {
    entries: BTreeMap<TaskId, Entry<P>>,
    last: u64,
    /// Longest time that partials of a scene stay in memory only, unless other workers share the scene.
    checkpoint: Duration,
    stopping: bool,
}

#[derive(Clone, Debug)]
struct Entry<P> {
    lease: u64,
    message: Message,
    state: TaskState,
    shards: Shards,
    /// True if another worker may wait for the shards of this task.
    is_shared: bool,
    attempt: Option<u32>,
    /// The time of the last progress.
    progress: Time,
    /// True while the worker examines the task and reads the files of its scene.
    is_taken_in: bool,
    /// Time at which the oldest unwritten shard was traced.
    in_memory_since: Option<Time>,
    /// Time of all threads, s, and the number of shards traced in it.
    traced: (f64, f64),
    payload: Option<P>,
}

impl<P> Entry<P> {
    /// Estimates the time of one shard, s. Scenes differ more than tenfold, so the task's own times replace the mean.
    fn shard_s(&self, costs: Costs) -> f64 {
        let (seconds, shards) = self.traced;
        let of_thread = if shards > 0.0 { seconds / shards } else { costs.shard_s };
        of_thread / costs.threads
    }

    fn message(&self, shards: Range<u32>) -> Message {
        let scene = self.message.task.scene;
        Message { task: Task { scene, shards }, hops: self.message.hops.saturating_add(1) }
    }

    /// Returns the messages for another worker if this one stops: the task's shards that are not in the store, or the
    /// whole task if the scene is not loaded, or if all are stored and the check for a complete scene remains.
    fn rest(&self) -> Vec<Message> {
        let rows = rows(self.shards.undone());
        if rows.is_empty() {
            vec![self.message(self.message.task.shards.clone())]
        } else {
            rows.into_iter().map(|row| self.message(row)).collect()
        }
    }
}

impl<P> Tasks<P> {
    pub(crate) fn new(checkpoint: Duration) -> Self {
        Self { entries: BTreeMap::new(), last: 0, checkpoint, stopping: false }
    }

    /// Adds a leased task. Returns `None` if its lease expired and the queue delivered it here again.
    pub(crate) fn lease(&mut self, lease: &Lease, now: Time) -> Option<TaskId> {
        let same = |e: &Entry<P>| e.lease == lease.id && e.message == lease.message;
        if self.entries.values().any(same) {
            return None;
        }
        self.last += 1;
        let entry = Entry {
            lease: lease.id,
            message: lease.message.clone(),
            state: TaskState::Queued,
            shards: Shards::default(),
            is_shared: false,
            attempt: None,
            progress: now,
            is_taken_in: false,
            in_memory_since: None,
            traced: (0.0, 0.0),
            payload: None,
        };
        self.entries.insert(TaskId(self.last), entry);
        Some(TaskId(self.last))
    }

    /// Notes that the worker begins or ends to examine the task and to read the files of its scene.
    pub(crate) fn take_in(&mut self, task: TaskId, begins: bool, now: Time) {
        if let Some(entry) = self.entries.get_mut(&task) {
            (entry.is_taken_in, entry.progress) = (begins, now);
        }
    }

    /// True if the worker holds another lease of the same shards.
    pub(crate) fn holds_another(&self, task: TaskId) -> bool {
        let of = |entry: &Entry<P>| entry.message.task.clone();
        let own = self.entries.get(&task).map(of);
        self.entries.iter().any(|(other, entry)| *other != task && Some(of(entry)) == own)
    }

    /// Returns the tasks with a record of an attempt, and the number of the record.
    pub(crate) fn attempts(&self) -> Vec<(TaskId, Task, u32)> {
        let of = |(id, entry): (&TaskId, &Entry<P>)| {
            Some((*id, entry.message.task.clone(), entry.attempt?))
        };
        self.entries.iter().filter_map(of).collect()
    }

    /// Prevents the donation of a task with a scene that may fail. Returns false if the task was donated meanwhile.
    pub(crate) fn pin(&mut self, task: TaskId) -> bool {
        self.to(task, TaskEvent::Pinned).is_some()
    }

    /// Notes the number `n` of the attempt's record. Returns false if the task was donated meanwhile.
    pub(crate) fn attempted(&mut self, task: TaskId, n: u32) -> bool {
        let entry = self.entries.get_mut(&task);
        entry.map(|entry| entry.attempt = Some(n)).is_some()
    }

    /// Records that a compute thread loads the scene. Returns false if the task was donated meanwhile.
    pub(crate) fn load(&mut self, task: TaskId, now: Time) -> bool {
        self.progress(task, now);
        self.to(task, TaskEvent::LoadBegins).is_some()
    }

    /// Records that a child process traces the task. Returns false if the task was donated meanwhile.
    pub(crate) fn sandbox(&mut self, task: TaskId, now: Time) -> bool {
        self.progress(task, now);
        self.to(task, TaskEvent::SandboxBegins).is_some()
    }

    /// Handles the loaded scene of `count` shards; the store has the shards in `found`.
    pub(crate) fn loaded(
        &mut self,
        task: TaskId,
        count: u32,
        found: &[u32],
        payload: P,
    ) -> Vec<Action> {
        let Some(entry) = self.to(task, TaskEvent::Loaded) else {
            return Vec::new();
        };
        let own = &entry.message.task.shards;
        entry.shards = Shards::new(count, own, found);
        entry.payload = Some(payload);
        entry.is_shared |= *own != (0..count);
        self.settle(task)
    }

    /// Returns the shards that no thread has started.
    pub(crate) fn waiting(&self, task: TaskId) -> Vec<u32> {
        let entry = self.entries.get(&task);
        entry.map_or_else(Vec::new, |entry| entry.shards.waiting())
    }

    /// True if the caller must trace a band of the shard.
    pub(crate) fn begin(&mut self, task: TaskId, shard: u32) -> bool {
        let stopping = self.stopping;
        let entry = self.entries.get_mut(&task);
        entry.is_some_and(|entry| entry.shards.begin(shard, stopping))
    }

    /// Adds the time that a thread took for a part of a shard.
    pub(crate) fn spent(&mut self, task: TaskId, seconds: f64, part: f64) {
        if let Some(entry) = self.entries.get_mut(&task) {
            entry.traced.0 += seconds;
            entry.traced.1 += part;
        }
    }

    /// Handles a shard that is traced and in memory. The shard is written at once if this worker stops or another one
    /// may wait for the shard, and otherwise at the checkpoint, unless the scene is complete by then.
    pub(crate) fn traced(&mut self, task: TaskId, shard: u32, now: Time) -> Vec<Action> {
        let (stopping, checkpoint) = (self.stopping, self.checkpoint);
        let Some(entry) = self.entries.get_mut(&task) else {
            return Vec::new();
        };
        if !entry.shards.traced(shard) {
            return Vec::new();
        }
        let since = *entry.in_memory_since.get_or_insert(now);
        let settled = self.settle(task);
        let Some(entry) = self.entries.get(&task).filter(|_| settled.is_empty()) else {
            return settled;
        };
        if stopping || entry.is_shared || now.saturating_sub(since) >= checkpoint {
            return self.store(task);
        }
        settled
    }

    /// Writes a task's shards that are only in memory.
    fn store(&mut self, task: TaskId) -> Vec<Action> {
        let entry = self.entries.get_mut(&task);
        let Some(entry) = entry.filter(|entry| entry.state == TaskState::Tracing) else {
            return Vec::new();
        };
        entry.in_memory_since = None;
        let shards = entry.shards.write();
        if shards.is_empty() { Vec::new() } else { vec![Action::Store { task, shards }] }
    }

    pub(crate) fn stored(&mut self, task: TaskId, shard: u32) -> Vec<Action> {
        if let Some(entry) = self.entries.get_mut(&task) {
            entry.shards.stored(shard);
        }
        self.settle(task)
    }

    /// Handles the result of checking whether the store has all of the scene's shards.
    pub(crate) fn scene_checked(&mut self, task: TaskId, all: bool) -> Vec<Action> {
        if !all {
            return self.end(task, TaskEvent::OthersMissing);
        }
        let gathers = self.to(task, TaskEvent::OthersStored);
        gathers.map(|_| Action::Gather { task }).into_iter().collect()
    }

    /// Handles the fetched shards of other workers. Those in `missing` are damaged or gone.
    pub(crate) fn gathered(&mut self, task: TaskId, missing: &[u32]) -> Vec<Action> {
        if missing.is_empty() {
            let complete = self.to(task, TaskEvent::Gathered);
            return complete.map(|_| Action::Merge { task }).into_iter().collect();
        }
        let Some(entry) = self.entries.get(&task) else {
            return Vec::new();
        };
        let of = |&shard: &u32| entry.message(shard..shard + 1);
        let messages = missing.iter().map(of).collect();
        let mut actions = self.end(task, TaskEvent::Damaged);
        if let Some(Action::Finish { lease }) = actions.pop() {
            actions.push(Action::Replace { lease, messages });
        }
        actions
    }

    /// Returns the messages to publish for an idle worker that loads a scene in `load_s`.
    pub(crate) fn offers(&self, costs: Costs, load_s: Option<f64>) -> Vec<Offer> {
        let offer = |(task, shards)| Offer { task, message: self.entries[&task].message(shards) };
        self.choose(costs, load_s).into_iter().map(offer).collect()
    }

    /// Gives up shards that the queue has confirmed for another worker. This worker still finishes started ones, and
    /// writes those in memory, because the other worker may wait for them.
    pub(crate) fn donated(&mut self, task: TaskId, shards: Range<u32>) -> Vec<Action> {
        let ended = self.end(task, TaskEvent::Donated);
        if !ended.is_empty() {
            return ended;
        }
        if let Some(entry) = self.entries.get_mut(&task) {
            entry.shards.leave(shards);
            entry.is_shared = true;
        }
        let mut actions = self.settle(task);
        if actions.is_empty() {
            actions = self.store(task);
        }
        actions
    }

    pub(crate) fn stop(&mut self) {
        self.stopping = true;
    }

    /// Writes all shards that are only in memory.
    pub(crate) fn store_all(&mut self) -> Vec<Action> {
        let tasks: Vec<TaskId> = self.entries.keys().copied().collect();
        tasks.into_iter().flat_map(|task| self.store(task)).collect()
    }

    pub(crate) fn progress(&mut self, task: TaskId, now: Time) {
        if let Some(entry) = self.entries.get_mut(&task) {
            entry.progress = now;
        }
    }

    /// Returns a task without progress for more than `hang` that is opened, or whose intake does not end, if any.
    pub(crate) fn hung(&self, now: Time, hang: Duration) -> Option<&Task> {
        let hangs = |e: &&Entry<P>| {
            (e.is_taken_in || !e.state.waits()) && now.saturating_sub(e.progress) > hang
        };
        self.entries.values().find(hangs).map(|e| &e.message.task)
    }

    pub(crate) fn leases(&self) -> Vec<u64> {
        self.entries.values().map(|entry| entry.lease).collect()
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// True if the task has not ended.
    pub(crate) fn has(&self, task: TaskId) -> bool {
        self.entries.contains_key(&task)
    }

    /// Returns the task's scene, or `None` after the task has ended.
    pub(crate) fn scene(&self, task: TaskId) -> Option<u32> {
        self.entries.get(&task).map(|entry| entry.message.task.scene)
    }

    pub(crate) fn payload(&self, task: TaskId) -> Option<&P> {
        self.entries.get(&task)?.payload.as_ref()
    }

    /// Moves a task to its next state. Returns `None` if the table has none.
    fn to(&mut self, task: TaskId, event: TaskEvent) -> Option<&mut Entry<P>> {
        let entry = self.entries.get_mut(&task)?;
        let Some(Next::To(state)) = next(entry.state, event) else {
            return None;
        };
        entry.state = state;
        Some(entry)
    }

    /// Checks, after a change of shards, whether the whole scene is in memory or the task's own part is in the store.
    fn settle(&mut self, task: TaskId) -> Vec<Action> {
        let Some(entry) = self.entries.get(&task) else {
            return Vec::new();
        };
        let all_here = entry.shards.are_all_here();
        let own_stored = entry.shards.undone().next().is_none();
        if all_here && self.to(task, TaskEvent::AllHere).is_some() {
            vec![Action::Merge { task }]
        } else if own_stored && self.to(task, TaskEvent::OwnStored).is_some() {
            vec![Action::CheckScene { task }]
        } else {
            Vec::new()
        }
    }
}
