//! The tasks that a worker has leased, as a pure state machine: events in, actions out. It knows no clock (time is a value
//! that comes with events), no lock, no store, no thread and no queue. A worker's threads, the simulator and the property
//! tests drive this one.
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
//! [`state::next`] is the table of all transitions. A task ends once: what is told of it later is ignored.

mod action;
mod donate;
mod end;
mod shards;
mod state;
#[cfg(test)]
mod tests;

pub(in crate::farm) use action::{Action, Offer, TaskId};
pub(in crate::farm) use state::TaskState;

use super::costs::Costs;
use crate::farm::queue::{Lease, Message};
use crate::run::Task;
use shards::{Shards, rows};
use state::{Next, TaskEvent, next};
use std::collections::BTreeMap;
use std::ops::Range;
use std::time::Duration;

/// Time since the worker started.
pub(in crate::farm) type Time = Duration;

/// All leased tasks; `P` is what the driver keeps with one whose scene is loaded.
#[derive(Clone, Debug)]
pub(in crate::farm) struct Tasks<P> {
    entries: BTreeMap<TaskId, Entry<P>>,
    last: u64,
    /// Partials of a scene that is here as a whole wait in memory for so long, for its other shards.
    checkpoint: Duration,
    /// No new shard starts.
    stopping: bool,
}

#[derive(Clone, Debug)]
struct Entry<P> {
    lease: u64,
    message: Message,
    state: TaskState,
    shards: Shards,
    company: Company,
    /// Number of the attempt's record.
    attempt: Option<u32>,
    /// When something of it was done last.
    progress: Time,
    /// Since when the oldest shard is in memory alone.
    in_memory_since: Option<Time>,
    /// A thread's seconds, and shards that were traced in them.
    traced: (f64, f64),
    payload: Option<P>,
}

/// Whether other processes have parts of the same scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Company {
    /// All of the scene was traced here.
    Alone,
    /// The store had something of it.
    Before,
    /// Another worker may wait for the shards of this task.
    Now,
}

impl<P> Entry<P> {
    /// Estimated seconds for one of its shards. Scenes differ by more than ten times: what others cost says little of what
    /// is left of this one.
    fn shard_s(&self, costs: Costs) -> f64 {
        let (seconds, shards) = self.traced;
        let of_thread = if shards > 0.0 { seconds / shards } else { costs.shard_s };
        of_thread / costs.threads
    }

    fn message(&self, shards: Range<u32>) -> Message {
        let scene = self.message.task.scene;
        Message { task: Task { scene, shards }, hops: self.message.hops + 1 }
    }

    /// What another worker has to do if this one stops: all that is not in the store. If nothing is, it still has to be
    /// found out whether the scene is complete.
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
    pub(in crate::farm) fn new(checkpoint: Duration) -> Self {
        Self { entries: BTreeMap::new(), last: 0, checkpoint, stopping: false }
    }

    /// A task was leased. None if it is here already: its lease ended, and the queue gave it to the same worker again.
    pub(in crate::farm) fn lease(&mut self, lease: &Lease, now: Time) -> Option<TaskId> {
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
            company: Company::Alone,
            attempt: None,
            progress: now,
            in_memory_since: None,
            traced: (0.0, 0.0),
            payload: None,
        };
        self.entries.insert(TaskId(self.last), entry);
        Some(TaskId(self.last))
    }

    /// Earlier attempts at its scene failed: it is not donated. False if it was.
    pub(in crate::farm) fn pin(&mut self, task: TaskId) -> bool {
        self.to(task, TaskEvent::Pinned)
    }

    /// The attempt at it is recorded under the number `n`. False if it was donated.
    pub(in crate::farm) fn attempted(&mut self, task: TaskId, n: u32) -> bool {
        let entry = self.entries.get_mut(&task);
        entry.map(|entry| entry.attempt = Some(n)).is_some()
    }

    /// A compute thread begins to load its scene. False if it was donated.
    pub(in crate::farm) fn load(&mut self, task: TaskId, now: Time) -> bool {
        self.progress(task, now);
        self.to(task, TaskEvent::LoadBegins)
    }

    /// A child process begins to trace it. False if it was donated.
    pub(in crate::farm) fn sandbox(&mut self, task: TaskId, now: Time) -> bool {
        self.progress(task, now);
        self.to(task, TaskEvent::SandboxBegins)
    }

    /// Its scene of `count` shards is loaded, and those are in memory that the store had `found`.
    pub(in crate::farm) fn loaded(
        &mut self,
        task: TaskId,
        count: u32,
        found: &[u32],
        payload: P,
    ) -> Vec<Action> {
        if !self.to(task, TaskEvent::Loaded) {
            return Vec::new();
        }
        let Some(entry) = self.entries.get_mut(&task) else {
            return Vec::new();
        };
        let own = &entry.message.task.shards;
        entry.shards = Shards::new(count, own, found);
        entry.payload = Some(payload);
        let company = if *own != (0..count) {
            Company::Now
        } else if found.is_empty() {
            Company::Alone
        } else {
            Company::Before
        };
        entry.company = entry.company.max(company);
        self.settle(task)
    }

    /// Its shards that no thread has begun.
    pub(in crate::farm) fn waiting(&self, task: TaskId) -> Vec<u32> {
        let entry = self.entries.get(&task);
        entry.map_or_else(Vec::new, |entry| entry.shards.waiting())
    }

    /// Whether to trace a band of a shard.
    pub(in crate::farm) fn begin(&mut self, task: TaskId, shard: u32) -> bool {
        let stopping = self.stopping;
        let entry = self.entries.get_mut(&task);
        entry.is_some_and(|entry| entry.shards.begin(shard, stopping))
    }

    /// A thread took so many seconds for a part of a shard.
    pub(in crate::farm) fn spent(&mut self, task: TaskId, seconds: f64, part: f64) {
        if let Some(entry) = self.entries.get_mut(&task) {
            entry.traced.0 += seconds;
            entry.traced.1 += part;
        }
    }

    /// A shard is traced and in memory. It is written at once if another worker may wait for it, or after a while: with
    /// luck the tuple comes first.
    pub(in crate::farm) fn traced(&mut self, task: TaskId, shard: u32, now: Time) -> Vec<Action> {
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
        if stopping || entry.company == Company::Now || now.saturating_sub(since) >= checkpoint {
            return self.store(task);
        }
        settled
    }

    /// Writes what is in memory alone.
    fn store(&mut self, task: TaskId) -> Vec<Action> {
        let entry = self.entries.get_mut(&task);
        let Some(entry) = entry.filter(|entry| entry.state == TaskState::Tracing) else {
            return Vec::new();
        };
        entry.in_memory_since = None;
        let shards = entry.shards.write();
        if shards.is_empty() {
            return Vec::new();
        }
        vec![Action::Store { task, shards }]
    }

    /// A partial is in the store.
    pub(in crate::farm) fn stored(&mut self, task: TaskId, shard: u32) -> Vec<Action> {
        if let Some(entry) = self.entries.get_mut(&task) {
            entry.shards.stored(shard);
        }
        self.settle(task)
    }

    /// Whether the store has all of the scene's shards.
    pub(in crate::farm) fn scene_checked(&mut self, task: TaskId, all: bool) -> Vec<Action> {
        if !all {
            return self.end(task, TaskEvent::OthersMissing);
        }
        if !self.to(task, TaskEvent::OthersStored) {
            return Vec::new();
        }
        vec![Action::Gather { task }]
    }

    /// The other workers' shards are in memory, but those `missing`, which are damaged or gone.
    pub(in crate::farm) fn gathered(&mut self, task: TaskId, missing: &[u32]) -> Vec<Action> {
        if missing.is_empty() {
            let complete = self.to(task, TaskEvent::Gathered);
            return if complete { vec![Action::Merge { task }] } else { Vec::new() };
        }
        let Some(entry) = self.entries.get(&task) else {
            return Vec::new();
        };
        let of = |&shard: &u32| entry.message(shard..shard + 1);
        let messages = missing.iter().map(of).collect();
        let mut actions = self.end(task, TaskEvent::Damaged);
        if let Some(finish) = actions.pop() {
            actions.extend([Action::Publish { messages }, finish]);
        }
        actions
    }

    /// What to publish for an idle worker that loads a scene in `load_s`.
    pub(in crate::farm) fn offers(&self, costs: Costs, load_s: Option<f64>) -> Vec<Offer> {
        let slowness = costs.slowness(load_s);
        let load_s = load_s.unwrap_or(costs.load_s);
        let chosen = donate::choose(&self.candidates(costs), slowness, load_s).into_iter();
        let offer = |(task, shards)| Offer { task, message: self.entries[&task].message(shards) };
        chosen.map(offer).collect()
    }

    /// The queue has these shards for another worker. Those that were begun meanwhile are finished here, too; what waits
    /// in memory is written, for the other worker may wait for it.
    pub(in crate::farm) fn donated(&mut self, task: TaskId, shards: Range<u32>) -> Vec<Action> {
        let ended = self.end(task, TaskEvent::Donated);
        if !ended.is_empty() {
            return ended;
        }
        if let Some(entry) = self.entries.get_mut(&task) {
            entry.shards.leave(shards);
            entry.company = Company::Now;
        }
        let mut actions = self.settle(task);
        if actions.is_empty() {
            actions = self.store(task);
        }
        actions
    }

    /// No new shard starts from now on.
    pub(in crate::farm) fn stop(&mut self) {
        self.stopping = true;
    }

    /// Writes all that is in memory alone.
    pub(in crate::farm) fn store_all(&mut self) -> Vec<Action> {
        let tasks: Vec<TaskId> = self.entries.keys().copied().collect();
        tasks.into_iter().flat_map(|task| self.store(task)).collect()
    }

    /// Something of it was done.
    pub(in crate::farm) fn progress(&mut self, task: TaskId, now: Time) {
        if let Some(entry) = self.entries.get_mut(&task) {
            entry.progress = now;
        }
    }

    /// An opened task of which nothing was done for `hang`.
    pub(in crate::farm) fn hung(&self, now: Time, hang: Duration) -> Option<&Task> {
        let hangs = |e: &&Entry<P>| !e.state.waits() && now.saturating_sub(e.progress) > hang;
        self.entries.values().find(hangs).map(|e| &e.message.task)
    }

    pub(in crate::farm) fn leases(&self) -> Vec<u64> {
        self.entries.values().map(|entry| entry.lease).collect()
    }

    pub(in crate::farm) fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// It has not ended.
    pub(in crate::farm) fn has(&self, task: TaskId) -> bool {
        self.entries.contains_key(&task)
    }

    /// As it was leased.
    pub(in crate::farm) fn task(&self, task: TaskId) -> Option<&Task> {
        self.entries.get(&task).map(|entry| &entry.message.task)
    }

    /// All of its scene was traced here.
    pub(in crate::farm) fn is_alone(&self, task: TaskId) -> bool {
        let entry = self.entries.get(&task);
        entry.is_some_and(|entry| entry.company == Company::Alone)
    }

    /// What came with [`loaded`](Self::loaded).
    pub(in crate::farm) fn payload(&self, task: TaskId) -> Option<&P> {
        self.entries.get(&task)?.payload.as_ref()
    }

    /// Goes to the state that the table names. False if it names none.
    fn to(&mut self, task: TaskId, event: TaskEvent) -> bool {
        let Some(entry) = self.entries.get_mut(&task) else {
            return false;
        };
        match next(entry.state, event) {
            Some(Next::To(state)) => {
                entry.state = state;
                true
            }
            _ => false,
        }
    }

    /// After a change of shards: is the scene complete here, or the task's own part in the store?
    fn settle(&mut self, task: TaskId) -> Vec<Action> {
        let Some(entry) = self.entries.get(&task) else {
            return Vec::new();
        };
        let all_here = entry.shards.are_all_here();
        let own_stored = entry.shards.undone().next().is_none();
        if all_here && self.to(task, TaskEvent::AllHere) {
            vec![Action::Merge { task }]
        } else if own_stored && self.to(task, TaskEvent::OwnStored) {
            vec![Action::CheckScene { task }]
        } else {
            Vec::new()
        }
    }
}
