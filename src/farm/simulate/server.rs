//! The queue's server: pulls, messages, leases, requests to give.

use super::driver::message_of;
use super::engine::{Event, Sim, WorkerId, us};
use super::queue::Expiry;
use super::tally::Kind;
use crate::farm::queue::Message;

/// A pull waits at the server for so many seconds.
const PULL_S: f64 = 30.0;

impl Sim<'_> {
    pub(super) fn at_server(&mut self, event: Event) {
        match event {
            Event::Pull { worker, waits } => self.pull_arrives(worker, waits),
            Event::Publish { worker } => self.publish_arrives(worker),
            Event::Acknowledge { sequence, stream } => {
                self.tally.count(Kind::Acknowledge, self.now_us);
                // Nothing tells the server that another stream is meant.
                if self.queue.acknowledge(sequence) && stream != self.stream {
                    self.counts.wrong_acknowledgements += 1;
                }
            }
            Event::Renew { worker } => self.renewal_arrives(worker),
            Event::Ask { worker } => self.request_arrives(worker),
            Event::LeaseEnds { sequence, stream } if stream == self.stream => {
                match self.queue.expire(sequence, self.now_us) {
                    Expiry::At(end_us) => self.after(end_us - self.now_us, event),
                    Expiry::Ended => {
                        self.counts.leases_ended += 1;
                        self.serve_waiting_pulls();
                    }
                    Expiry::NotHeld => {}
                }
            }
            _ => {}
        }
    }

    /// That pull of that worker has no answer yet.
    pub(super) fn pull_is_open(&self, worker: WorkerId, pull: u32) -> bool {
        let worker = &self.workers[worker as usize];
        worker.is_alive && worker.open_pull == Some(pull)
    }

    fn pull_arrives(&mut self, worker: WorkerId, waits: bool) {
        self.tally.count(Kind::Pull, self.now_us);
        let Some(pull) = self.workers[worker as usize].open_pull else {
            return;
        };
        if !self.workers[worker as usize].is_alive {
            return;
        }
        if waits {
            self.waiting_pulls.push_back((worker, pull));
            let expires_us = us(PULL_S);
            self.after(expires_us, Event::PullEnds { worker, pull });
            self.serve_waiting_pulls();
        } else if !self.deliver(worker) {
            self.after(self.way_us(), Event::Empty { worker });
        }
    }

    pub(super) fn pull_ends(&mut self, worker: WorkerId, pull: u32) {
        if self.pull_is_open(worker, pull) {
            self.after(self.way_us(), Event::Empty { worker });
        }
    }

    /// Gives messages to those who wait, first come first served.
    pub(super) fn serve_waiting_pulls(&mut self) {
        while self.queue.waiting() > 0 {
            let Some((worker, pull)) = self.waiting_pulls.pop_front() else {
                return;
            };
            if self.pull_is_open(worker, pull) {
                self.deliver(worker);
            }
        }
    }

    /// Sends the next message to a worker; false if there is none.
    fn deliver(&mut self, worker: WorkerId) -> bool {
        let lease_us = us(self.case.rules.lease_s);
        let Some(delivery) = self.queue.take(self.now_us + lease_us) else {
            return false;
        };
        self.tally.count(Kind::Deliver, self.now_us);
        let lease_ends = Event::LeaseEnds { sequence: delivery.sequence, stream: self.stream };
        self.after(lease_us, lease_ends);
        let receiver = &mut self.workers[worker as usize];
        receiver.open_pull = None;
        receiver.inbox = Some((delivery, self.stream));
        // It looks into the store before it counts the span as its own.
        let delay_us = self.way_us() + us(self.case.fleet.store_s);
        self.after(delay_us, Event::Delivered { worker });
        true
    }

    /// Into the stream, if there is one.
    pub(super) fn store_message(&mut self, message: &Message) -> bool {
        self.tally.count(Kind::Publish, self.now_us);
        if !self.stream_is_there {
            return false;
        }
        self.queue.publish(message);
        self.counts.most_messages = self.counts.most_messages.max(self.queue.len());
        true
    }

    fn publish_arrives(&mut self, worker: WorkerId) {
        let outbox = self.workers[worker as usize].outbox.clone();
        let mut all_stored = true;
        for offer in &outbox {
            all_stored &= self.store_message(&offer.message);
        }
        self.serve_waiting_pulls();
        let event =
            if all_stored { Event::Confirmed { worker } } else { Event::NotConfirmed { worker } };
        self.after(self.way_us(), event);
    }

    fn renewal_arrives(&mut self, worker: WorkerId) {
        let end_us = self.now_us + us(self.case.rules.lease_s);
        for lease in self.workers[worker as usize].tasks.leases() {
            let (sequence, stream) = message_of(lease);
            self.tally.count(Kind::Renew, self.now_us);
            if stream == self.stream {
                self.queue.renew(sequence, end_us);
            }
        }
    }

    /// One of those who listen gets it, whichever.
    fn request_arrives(&mut self, worker: WorkerId) {
        self.tally.count(Kind::Ask, self.now_us);
        let count = self.listeners.len() as u64;
        let event = if count == 0 {
            self.tally.count(Kind::Answer, self.now_us);
            Event::NoGiver { worker }
        } else {
            let k = self.draw_below(count) as usize;
            let giver = self.listeners[k];
            Event::Asked { giver, asker: worker }
        };
        self.after(self.way_us(), event);
    }

    /// A worker begins to listen to requests, or ceases.
    pub(super) fn listen(&mut self, worker: WorkerId, listens: bool) {
        let place = self.workers[worker as usize].listens;
        match (place, listens) {
            (None, true) => {
                self.workers[worker as usize].listens = Some(self.listeners.len() as u32);
                self.listeners.push(worker);
            }
            (Some(place), false) => {
                self.workers[worker as usize].listens = None;
                self.listeners.swap_remove(place as usize);
                if let Some(&moved) = self.listeners.get(place as usize) {
                    self.workers[moved as usize].listens = Some(place);
                }
            }
            _ => return,
        }
        self.tally.count(Kind::Listen, self.now_us);
    }
}
