//! The queue of a single process: no server, and the same promises.

use super::{Answer, Ask, Delivery, Queue, QueueError, QueueKeeper, QueueState, Taken, Waiting};
use crossbeam::channel::{Receiver, Sender, bounded, unbounded};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::time::{Duration, Instant};

/// A queue inside a process. Clones are the same queue.
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
    waiting: VecDeque<Message>,
    held: BTreeMap<u64, (Message, Option<Instant>)>,
    /// All that waits or is held.
    there: BTreeSet<Key>,
    next_ticket: u64,
    /// Workers that have something to give, by number.
    able: BTreeMap<u64, Sender<Ask>>,
    next_worker: u64,
    next_asked: u64,
    /// A keeper has looked.
    seen: bool,
}

struct Message {
    waiting: Waiting,
    deliveries: u32,
}

/// Scene, first shard, one past the last, times handed on.
type Key = [u32; 4];

fn key(waiting: &Waiting) -> Key {
    let span = &waiting.span;
    [
        span.scene,
        span.shards.start,
        span.shards.end,
        waiting.handed_on,
    ]
}

/// One worker's end of it.
pub struct LocalWorker {
    queue: LocalQueue,
    number: u64,
    asks: (Sender<Ask>, Receiver<Ask>),
}

impl LocalQueue {
    /// An empty queue. Without a `lease` what is held stays held: for a process that is its only worker.
    pub fn new(lease: Option<Duration>) -> Self {
        Self {
            shared: Arc::new(Shared {
                lease,
                state: Mutex::default(),
                changed: Condvar::new(),
            }),
        }
    }

    /// Another worker's end.
    pub fn worker(&self) -> LocalWorker {
        let mut state = self.state();
        state.next_worker += 1;
        LocalWorker {
            queue: self.clone(),
            number: state.next_worker,
            asks: unbounded(),
        }
    }

    /// Publishes spans whose holder was lost by an earlier process.
    pub fn publish_suspects(&self, waiting: &[Waiting]) {
        self.put(waiting, 1);
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.shared
            .state
            .lock()
            .expect("no holder of this lock panics")
    }

    fn put(&self, waiting: &[Waiting], deliveries: u32) {
        let mut state = self.state();
        for waiting in waiting {
            if state.there.insert(key(waiting)) {
                state.waiting.push_back(Message {
                    waiting: waiting.clone(),
                    deliveries,
                });
            }
        }
        self.shared.changed.notify_all();
    }
}

impl State {
    /// What was held too long waits again, before all else.
    fn expire(&mut self, now: Instant) {
        let late: Vec<u64> = self
            .held
            .iter()
            .filter(|(_, (_, end))| end.is_some_and(|end| end <= now))
            .map(|(&ticket, _)| ticket)
            .collect();
        for ticket in late.into_iter().rev() {
            if let Some((message, _)) = self.held.remove(&ticket) {
                self.waiting.push_front(message);
            }
        }
    }
}

impl Queue for LocalWorker {
    fn take(&self, wait: Duration) -> Taken {
        let deadline = Instant::now() + wait;
        let mut state = self.queue.state();
        loop {
            let now = Instant::now();
            state.expire(now);
            if let Some(mut message) = state.waiting.pop_front() {
                message.deliveries += 1;
                state.next_ticket += 1;
                let ticket = state.next_ticket;
                let delivery = Delivery {
                    ticket,
                    waiting: message.waiting.clone(),
                    suspect: message.deliveries > 1,
                };
                let end = self.queue.shared.lease.map(|lease| now + lease);
                state.held.insert(ticket, (message, end));
                return Taken::Span(delivery);
            }
            if state.held.is_empty() {
                return Taken::Ended;
            }
            if now >= deadline {
                return Taken::Nothing;
            }
            let next_end = state.held.values().filter_map(|(_, end)| *end).min();
            let until = next_end.map_or(deadline, |end| end.min(deadline));
            let waited = self
                .queue
                .shared
                .changed
                .wait_timeout(state, until.saturating_duration_since(now));
            state = waited.expect("no holder of this lock panics").0;
        }
    }

    fn publish(&self, waiting: &[Waiting]) -> Result<(), QueueError> {
        self.queue.put(waiting, 0);
        Ok(())
    }

    fn renew(&self, ticket: u64) {
        let lease = self.queue.shared.lease;
        if let Some((_, end)) = self.queue.state().held.get_mut(&ticket) {
            *end = lease.map(|lease| Instant::now() + lease);
        }
    }

    fn finish(&self, ticket: u64) {
        let mut state = self.queue.state();
        if let Some((message, _)) = state.held.remove(&ticket) {
            state.there.remove(&key(&message.waiting));
        }
        drop(state);
        self.queue.shared.changed.notify_all();
    }

    fn ask(&self, load_s: Option<f64>) -> Answer {
        let (sender, answer) = bounded(1);
        let asked = {
            let mut state = self.queue.state();
            state.next_asked += 1;
            // In turns, as a server spreads the questions over those who may be asked.
            let turn = state.next_asked;
            let others: Vec<&Sender<Ask>> = state
                .able
                .iter()
                .filter(|(number, _)| **number != self.number)
                .map(|(_, asks)| asks)
                .collect();
            let Some(asks) = others.get(turn as usize % others.len().max(1)) else {
                return Answer::default();
            };
            let ask = Ask {
                load_s,
                tell: Box::new(move |answer| {
                    let _ = sender.send(answer);
                }),
            };
            asks.send(ask).is_ok()
        };
        if asked {
            let answer = answer.recv_timeout(Duration::from_secs(2));
            answer.unwrap_or_default()
        } else {
            Answer::default()
        }
    }

    fn offer(&self, able: bool) {
        let mut state = self.queue.state();
        if able {
            state.able.insert(self.number, self.asks.0.clone());
        } else {
            state.able.remove(&self.number);
        }
    }

    fn asked(&self, wait: Duration) -> Option<Ask> {
        self.asks.1.recv_timeout(wait).ok()
    }
}

impl Drop for LocalWorker {
    fn drop(&mut self) {
        self.offer(false);
    }
}

impl QueueKeeper for LocalQueue {
    fn ensure(&self) -> Result<bool, QueueError> {
        Ok(!std::mem::replace(&mut self.state().seen, true))
    }

    fn look(&self) -> Result<QueueState, QueueError> {
        let mut state = self.state();
        state.expire(Instant::now());
        Ok(QueueState {
            waiting: state.waiting.len() as u64,
            held: state.held.len() as u64,
        })
    }

    fn scenes(&self) -> Result<BTreeSet<u32>, QueueError> {
        Ok(self
            .state()
            .there
            .iter()
            .map(|[scene, ..]| *scene)
            .collect())
    }

    fn publish(&self, waiting: &[Waiting]) -> Result<(), QueueError> {
        self.put(waiting, 0);
        Ok(())
    }

    fn purge(&self) -> Result<(), QueueError> {
        let mut state = self.state();
        state.waiting.clear();
        state.held.clear();
        state.there.clear();
        Ok(())
    }

    fn remove(&self) -> Result<(), QueueError> {
        self.purge()
    }
}
