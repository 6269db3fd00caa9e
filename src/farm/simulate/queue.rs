//! A model of the work queue: a JetStream work-queue stream with one durable pull consumer.
//!
//! The model behaves as measured on a real server. A message's name (its subject) is in the stream at most once. An
//! acknowledgement names a number in the stream, is accepted from any sender, and removes the message even while
//! another worker holds it. A message with an expired lease precedes those that were never delivered. A stream that is
//! created again counts from the start, so an old acknowledgement may remove a new message.

use crate::farm::queue::Message;
use crate::run::Task;
use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};
use std::ops::Range;

pub(super) type Sequence = u32;

const NONE: u32 = u32::MAX;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Waiting,
    Held,
    /// In the stream, but never delivered by the consumer (seen after a restart of an old server).
    #[cfg_attr(not(test), expect(dead_code, reason = "only tests create it"))]
    Zombie,
    Gone,
}

/// A message in the stream, in 32 bytes.
struct Entry {
    lease_end_us: u64,
    scene: u32,
    start: u32,
    end: u32,
    next: u32,
    hops: u32,
    delivered: bool,
    state: State,
}

/// A message on its way to a worker.
#[derive(Clone, Debug)]
pub(super) struct Delivered {
    pub(super) sequence: Sequence,
    pub(super) message: Message,
    /// True if the message was delivered before.
    pub(super) again: bool,
}

#[derive(Default)]
pub(super) struct Queue {
    messages: Vec<Entry>,
    first_of_scene: Vec<u32>,
    fresh: VecDeque<Sequence>,
    redelivered: BinaryHeap<Reverse<Sequence>>,
    waiting: usize,
    held: usize,
    zombies: usize,
}

impl Queue {
    pub(super) fn new(scenes: u32) -> Self {
        Self { first_of_scene: vec![NONE; scenes as usize], ..Self::default() }
    }

    /// Returns the number of messages that wait for delivery.
    pub(super) fn waiting(&self) -> usize {
        self.waiting
    }

    /// Returns the number of messages that workers hold.
    pub(super) fn held(&self) -> usize {
        self.held
    }

    pub(super) fn len(&self) -> usize {
        self.waiting + self.held + self.zombies
    }

    /// Adds a message. Returns false if the stream has a message with the same name.
    pub(super) fn publish(&mut self, message: &Message) -> bool {
        let scene = message.task.scene;
        let shards = &message.task.shards;
        let same =
            |m: &Entry| m.start == shards.start && m.end == shards.end && m.hops == message.hops;
        if self.of_scene(scene).any(|k| same(&self.messages[k as usize])) {
            return false;
        }
        let sequence = self.messages.len() as Sequence;
        let first = &mut self.first_of_scene[scene as usize];
        self.messages.push(Entry {
            lease_end_us: 0,
            scene,
            start: shards.start,
            end: shards.end,
            next: std::mem::replace(first, sequence),
            hops: message.hops,
            delivered: false,
            state: State::Waiting,
        });
        self.fresh.push_back(sequence);
        self.waiting += 1;
        true
    }

    /// Delivers the next message. Messages with an expired lease precede those never delivered.
    pub(super) fn take(&mut self, lease_end_us: u64) -> Option<Delivered> {
        loop {
            let sequence = match self.redelivered.pop() {
                Some(Reverse(sequence)) => sequence,
                None => self.fresh.pop_front()?,
            };
            let entry = &mut self.messages[sequence as usize];
            // The message was acknowledged while it waited.
            if entry.state != State::Waiting {
                continue;
            }
            entry.state = State::Held;
            let again = std::mem::replace(&mut entry.delivered, true);
            entry.lease_end_us = lease_end_us;
            self.waiting -= 1;
            self.held += 1;
            let task = Task { scene: entry.scene, shards: entry.start..entry.end };
            let message = Message { task, hops: entry.hops };
            return Some(Delivered { sequence, message, again });
        }
    }

    /// Extends the lease of a message that a worker holds.
    pub(super) fn renew(&mut self, sequence: Sequence, lease_end_us: u64) {
        if let Some(message) = self.messages.get_mut(sequence as usize)
            && message.state == State::Held
        {
            message.lease_end_us = lease_end_us;
        }
    }

    /// Removes a message, even if another worker holds it. Returns false if the stream does not have it.
    pub(super) fn acknowledge(&mut self, sequence: Sequence) -> bool {
        let Some(message) = self.messages.get_mut(sequence as usize) else {
            return false;
        };
        match message.state {
            State::Gone => return false,
            State::Waiting => self.waiting -= 1,
            State::Held => self.held -= 1,
            State::Zombie => self.zombies -= 1,
        }
        message.state = State::Gone;
        let scene = message.scene as usize;
        let next = message.next;
        if self.first_of_scene[scene] == sequence {
            self.first_of_scene[scene] = next;
        } else {
            let before =
                self.of_scene(scene as u32).find(|&k| self.messages[k as usize].next == sequence);
            if let Some(before) = before {
                self.messages[before as usize].next = next;
            }
        }
        true
    }

    pub(super) fn expire(&mut self, sequence: Sequence, now_us: u64) -> Expiry {
        match self.messages.get_mut(sequence as usize) {
            Some(message) if message.state == State::Held => {
                if message.lease_end_us > now_us {
                    return Expiry::At(message.lease_end_us);
                }
                message.state = State::Waiting;
                self.redelivered.push(Reverse(sequence));
                self.held -= 1;
                self.waiting += 1;
                Expiry::Ended
            }
            _ => Expiry::NotHeld,
        }
    }

    /// Returns the shards of each message of a scene.
    pub(super) fn ranges(&self, scene: u32) -> Vec<Range<u32>> {
        self.of_scene(scene).map(|k| &self.messages[k as usize]).map(|m| m.start..m.end).collect()
    }

    pub(super) fn wipe(&mut self) {
        *self = Self::new(self.first_of_scene.len() as u32);
    }

    fn of_scene(&self, scene: u32) -> impl Iterator<Item = u32> {
        let first = Some(self.first_of_scene[scene as usize]);
        std::iter::successors(first, |&k| self.messages.get(k as usize).map(|m| m.next))
            .take_while(|&k| k != NONE)
    }
}

/// The state of a lease at the time of its possible expiry.
pub(super) enum Expiry {
    /// The lease was renewed until this time, µs.
    At(u64),
    /// The lease has expired, and the message waits again.
    Ended,
    /// No worker holds the message.
    NotHeld,
}

#[cfg(test)]
impl Queue {
    pub(super) fn all_held(&self) -> Vec<Sequence> {
        let is_held = |&k: &Sequence| self.messages[k as usize].state == State::Held;
        (0..self.messages.len() as Sequence).filter(is_held).collect()
    }

    pub(super) fn all_gone(&self) -> Vec<Sequence> {
        let is_gone = |&k: &Sequence| self.messages[k as usize].state == State::Gone;
        (0..self.messages.len() as Sequence).filter(is_gone).collect()
    }

    /// Puts an acknowledged message back. The queue never delivers a `zombie`, and delivers any other message again.
    pub(super) fn resurrect(&mut self, sequence: Sequence, zombie: bool) {
        let message = &mut self.messages[sequence as usize];
        assert_eq!(message.state, State::Gone);
        message.next =
            std::mem::replace(&mut self.first_of_scene[message.scene as usize], sequence);
        if zombie {
            message.state = State::Zombie;
            self.zombies += 1;
        } else {
            message.state = State::Waiting;
            self.waiting += 1;
            self.redelivered.push(Reverse(sequence));
        }
    }
}
