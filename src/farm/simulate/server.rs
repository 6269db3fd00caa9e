//! A model of the queue's server: pulls, messages, leases, and requests for donations.

use super::driver::message_of;
use super::outcome::Kind;
use super::queue::Expiry;
use super::state::{Event, ServerEvent, Sim, WorkerEvent, WorkerId, us};
use crate::farm::queue::Message;

/// Longest time that a pull waits at the server, s.
const PULL_S: f64 = 30.0;

impl Sim<'_> {
    pub(super) fn at_server(&mut self, event: ServerEvent) {
        match event {
            ServerEvent::Pull { worker, waits } => self.pull_arrives(worker, waits),
            ServerEvent::Publish(worker) => self.publish_arrives(worker),
            ServerEvent::Acknowledge { sequence, stream } => {
                self.tally.count(Kind::Acknowledge, self.now_us);
                // An acknowledgement does not name its stream.
                if self.queue.acknowledge(sequence) && stream != self.stream {
                    self.outcome.wrong_acknowledgements += 1;
                }
            }
            ServerEvent::Renew(worker) => self.renewal_arrives(worker),
            ServerEvent::Request(worker) => self.request_arrives(worker),
            ServerEvent::LeaseEnds { sequence, stream } if stream == self.stream => {
                match self.queue.expire(sequence, self.now_us) {
                    Expiry::At(end_us) => self.after(end_us - self.now_us, Event::AtServer(event)),
                    Expiry::Ended => {
                        self.outcome.leases_ended += 1;
                        self.serve_waiting_pulls();
                    }
                    Expiry::NotHeld => {}
                }
            }
            ServerEvent::LeaseEnds { .. } => {}
        }
    }

    /// True if the worker is alive and this pull has no answer yet.
    pub(super) fn pull_is_open(&self, worker: WorkerId, pull: u32) -> bool {
        let worker = &self.workers[worker as usize];
        !worker.is_dead && worker.open_pull == Some(pull)
    }

    fn pull_arrives(&mut self, worker: WorkerId, waits: bool) {
        self.tally.count(Kind::Pull, self.now_us);
        let w = &self.workers[worker as usize];
        let Some(pull) = w.open_pull.filter(|_| !w.is_dead) else {
            return;
        };
        if waits {
            self.waiting_pulls.push_back((worker, pull));
            self.after(us(PULL_S), Event::PullEnds { worker, pull });
            self.serve_waiting_pulls();
        } else if !self.deliver(worker) {
            self.reply(worker, WorkerEvent::Empty);
        }
    }

    pub(super) fn pull_ends(&mut self, worker: WorkerId, pull: u32) {
        if self.pull_is_open(worker, pull) {
            self.reply(worker, WorkerEvent::Empty);
        }
    }

    /// Delivers messages to waiting pulls, first come first served.
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

    /// Sends the next message to a worker. Returns false if no message waits.
    fn deliver(&mut self, worker: WorkerId) -> bool {
        let lease_us = us(self.case.rules.lease_s);
        let Some(delivery) = self.queue.take(self.now_us + lease_us) else {
            return false;
        };
        self.tally.count(Kind::Deliver, self.now_us);
        let (sequence, stream) = (delivery.sequence, self.stream);
        self.after(lease_us, Event::AtServer(ServerEvent::LeaseEnds { sequence, stream }));
        let receiver = &mut self.workers[worker as usize];
        receiver.open_pull = None;
        receiver.inbox = Some((delivery, stream));
        // The worker checks the store before it adds the task.
        let delay_us = self.way_us() + us(self.case.fleet.store_s);
        self.at_worker_after(delay_us, worker, WorkerEvent::Delivered);
        true
    }

    /// Adds a message to the stream. Returns false if the stream already had it, and `None` if the stream is gone.
    pub(super) fn store_message(&mut self, message: &Message) -> Option<bool> {
        self.tally.count(Kind::Publish, self.now_us);
        self.stream_is_there.then(|| {
            let is_new = self.queue.publish(message);
            let most = &mut self.outcome.most_in_stream;
            *most = (*most).max(self.queue.len() as u64);
            is_new
        })
    }

    fn publish_arrives(&mut self, worker: WorkerId) {
        let outbox = self.workers[worker as usize].outbox.clone();
        let mut all = true;
        for offer in &outbox {
            all &= self.store_message(&offer.message).is_some();
        }
        self.serve_waiting_pulls();
        self.reply(worker, WorkerEvent::Confirmed { all });
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

    fn request_arrives(&mut self, worker: WorkerId) {
        self.tally.count(Kind::Request, self.now_us);
        let count = self.listeners.len() as u64;
        if count == 0 {
            self.tally.count(Kind::Answer, self.now_us);
            self.reply(worker, WorkerEvent::NoDonor);
        } else {
            let k = self.draw_below(count) as usize;
            let donor = self.listeners[k];
            self.reply(donor, WorkerEvent::Requested { by: worker });
        }
    }

    /// Subscribes a worker to requests, or unsubscribes it.
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
