//! A queue inside one process, without a server.

use super::{
    Answer, Lease, Listed, Message, Queue, QueueError, QueueKeeper, QueueState, Request, Taken,
};
use crossbeam::channel::{Receiver, Sender, bounded, unbounded};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::time::{Duration, Instant};

/// A queue inside a process. Clones share its messages.
#[derive(Clone)]
pub struct LocalQueue {
    shared: Arc<Shared>,
}

struct Shared {
    lease: Option<Duration>,
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Default)]
struct State {
    waiting: VecDeque<Entry>,
    held: BTreeMap<u64, (Entry, Option<Instant>)>,
    /// Keys of all messages, waiting or leased.
    there: BTreeSet<Key>,
    next_lease: u64,
    /// Workers that have shards to donate, by number.
    able: BTreeMap<u64, Sender<Request>>,
    next_worker: u64,
    next_request: u64,
    /// True after the first call of `ensure`.
    seen: bool,
}

struct Entry {
    message: Message,
    deliveries: u32,
}

/// Scene, first shard, one past the last shard, and hops.
type Key = [u32; 4];

fn key(message: &Message) -> Key {
    let task = &message.task;
    [task.scene, task.shards.start, task.shards.end, message.hops]
}

pub struct LocalWorker {
    queue: LocalQueue,
    number: u64,
    requests: (Sender<Request>, Receiver<Request>),
}

impl LocalQueue {
    /// Creates an empty queue. Without `lease`, leases never expire, which suits a run's only worker.
    pub fn new(lease: Option<Duration>) -> Self {
        Self {
            shared: Arc::new(Shared { lease, state: Mutex::default(), changed: Condvar::new() }),
        }
    }

    pub fn worker(&self) -> LocalWorker {
        let mut state = self.lock();
        state.next_worker += 1;
        LocalWorker { queue: self.clone(), number: state.next_worker, requests: unbounded() }
    }

    /// Publishes messages as redelivered, because an earlier process was lost with their tasks.
    pub fn publish_redelivered(&self, messages: &[Message]) {
        self.put(messages, 1);
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.shared.state.lock().expect("no holder of this lock panics")
    }

    /// Adds the messages that are not in the queue. Returns true if all are new.
    fn put(&self, messages: &[Message], deliveries: u32) -> bool {
        let mut state = self.lock();
        let mut all_new = true;
        for message in messages {
            let is_new = state.there.insert(key(message));
            if is_new {
                state.waiting.push_back(Entry { message: message.clone(), deliveries });
            }
            all_new &= is_new;
        }
        self.shared.changed.notify_all();
        all_new
    }
}

impl State {
    /// Moves messages with expired leases to the front of the queue.
    fn expire(&mut self, now: Instant) {
        let is_over =
            |_: &u64, (_, end): &mut (Entry, Option<Instant>)| end.is_some_and(|end| end <= now);
        let ended: Vec<Entry> = self.held.extract_if(.., is_over).map(|(_, (e, _))| e).collect();
        ended.into_iter().rev().for_each(|entry| self.waiting.push_front(entry));
    }
}

impl Queue for LocalWorker {
    fn take(&self, wait: Duration) -> Taken {
        let deadline = Instant::now() + wait;
        let mut state = self.queue.lock();
        loop {
            let now = Instant::now();
            state.expire(now);
            if let Some(mut entry) = state.waiting.pop_front() {
                entry.deliveries += 1;
                state.next_lease += 1;
                let id = state.next_lease;
                let leased =
                    Lease { id, message: entry.message.clone(), redelivered: entry.deliveries > 1 };
                let end = self.queue.shared.lease.map(|lease| now + lease);
                state.held.insert(id, (entry, end));
                return Taken::Lease(leased);
            }
            if state.held.is_empty() {
                return Taken::Ended;
            }
            if now >= deadline {
                return Taken::Nothing;
            }
            let next_end = state.held.values().filter_map(|(_, end)| *end).min();
            let until = next_end.map_or(deadline, |end| end.min(deadline));
            let waited =
                self.queue.shared.changed.wait_timeout(state, until.saturating_duration_since(now));
            state = waited.expect("no holder of this lock panics").0;
        }
    }

    fn publish(&self, messages: &[Message]) -> Result<bool, QueueError> {
        Ok(self.queue.put(messages, 0))
    }

    fn renew(&self, lease: u64) {
        let time = self.queue.shared.lease;
        if let Some((_, end)) = self.queue.lock().held.get_mut(&lease) {
            *end = time.map(|time| Instant::now() + time);
        }
    }

    fn finish(&self, lease: u64) {
        let mut state = self.queue.lock();
        if let Some((entry, _)) = state.held.remove(&lease) {
            state.there.remove(&key(&entry.message));
        }
        drop(state);
        self.queue.shared.changed.notify_all();
    }

    fn request(&self, load_s: Option<f64>) -> Answer {
        let (sender, answer) = bounded(1);
        let donor = {
            let mut state = self.queue.lock();
            state.next_request += 1;
            // Requests go to the donors in turn; a server also spreads them over its subscribers.
            let turn = state.next_request as usize;
            let others = state.able.iter().filter(|(number, _)| **number != self.number);
            let others: Vec<&Sender<Request>> = others.map(|(_, requests)| requests).collect();
            others.get(turn % others.len().max(1)).copied().cloned()
        };
        let tell = Box::new(move |answer| {
            let _ = sender.send(answer);
        });
        let sent = donor.is_some_and(|donor| donor.send(Request { load_s, tell }).is_ok());
        let answer = sent.then(|| answer.recv_timeout(Duration::from_secs(2)).unwrap_or_default());
        answer.unwrap_or_default()
    }

    fn accept_requests(&self, able: bool) {
        let mut state = self.queue.lock();
        if able {
            state.able.insert(self.number, self.requests.0.clone());
        } else {
            state.able.remove(&self.number);
        }
    }

    fn requested(&self, wait: Duration) -> Option<Request> {
        self.requests.1.recv_timeout(wait).ok()
    }
}

impl Drop for LocalWorker {
    fn drop(&mut self) {
        self.accept_requests(false);
    }
}

impl QueueKeeper for LocalQueue {
    fn ensure(&self) -> Result<bool, QueueError> {
        Ok(!std::mem::replace(&mut self.lock().seen, true))
    }

    fn state(&self) -> Result<QueueState, QueueError> {
        let mut state = self.lock();
        state.expire(Instant::now());
        Ok(QueueState { waiting: state.waiting.len() as u64, held: state.held.len() as u64 })
    }

    fn messages(&self) -> Result<Vec<Listed>, QueueError> {
        let state = self.lock();
        let held = state.held.values().map(|(entry, _)| (entry, true));
        let all = state.waiting.iter().map(|entry| (entry, false)).chain(held);
        let listed = all.map(|(entry, is_held)| Listed {
            message: entry.message.clone(),
            waits: !is_held && entry.deliveries == 0,
            is_readable: true,
        });
        Ok(listed.collect())
    }

    fn publish(&self, messages: &[Message]) -> Result<(), QueueError> {
        self.put(messages, 0);
        Ok(())
    }

    fn purge(&self) -> Result<(), QueueError> {
        let mut state = self.lock();
        state.waiting.clear();
        state.held.clear();
        state.there.clear();
        Ok(())
    }

    fn remove(&self) -> Result<(), QueueError> {
        self.purge()
    }
}
