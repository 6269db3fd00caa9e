//! The acts of the adversary.

use super::farm::{Farm, LEASE, RUN, SHARDS};
use super::queue::Holder;
use crate::farm::message::write_subject;
use crate::farm::queue::{Message, write_message};
use crate::run::Task;

impl Farm {
    pub(super) fn act_as_adversary(&mut self) {
        match self.draw(12) {
            0..3 => self.publish_forged(),
            3 => self.replay(),
            4..6 => {
                if let Some(number) = self.any_message(|_| true) {
                    self.note(|| format!("the adversary acknowledges {number}"));
                    self.queue.acknowledge(number);
                }
            }
            6..8 => {
                if let Some(number) = self.any_message(|holder| matches!(holder, Holder::Worker(_)))
                {
                    self.note(|| format!("the adversary gives back {number}"));
                    self.give_back(number);
                }
            }
            8..10 => {
                if let Some(kept) = self.queue.take(self.now, LEASE, Holder::Adversary) {
                    self.note(|| format!("the adversary withholds {}", kept.subject));
                }
            }
            10 => {
                if let Some(number) = self.any_message(|holder| holder == Holder::Adversary) {
                    self.note(|| format!("the adversary releases {number}"));
                    self.give_back(number);
                }
            }
            _ => {
                // Away with all messages, and garbage in their places.
                let subjects: Vec<String> =
                    self.queue.kept.values().map(|kept| kept.subject.clone()).collect();
                self.queue.kept.clear();
                for subject in subjects {
                    self.note(|| format!("the adversary publishes garbage as {subject}"));
                    self.queue.publish(subject, b"8 bytes!".to_vec());
                }
            }
        }
    }

    fn any_message(&mut self, is: impl Fn(Holder) -> bool) -> Option<u64> {
        let numbers: Vec<u64> = self
            .queue
            .kept
            .values()
            .filter(|kept| is(kept.holder))
            .map(|kept| kept.number)
            .collect();
        let k = self.draw(numbers.len());
        numbers.get(k).copied()
    }

    fn give_back(&mut self, number: u64) {
        if let Some(kept) = self.queue.kept.get_mut(&number) {
            kept.holder = Holder::Nobody;
        }
    }

    /// Publishes a task, mostly one that the run does not have, or garbage, on a subject of the run or another one.
    fn publish_forged(&mut self) {
        let scene = self.draw(self.shards.len() + 1) as u32;
        let (start, length) = (self.draw(SHARDS as usize + 3) as u32, self.draw(5) as u32);
        let hops = [0, 1, 7, u32::MAX][self.draw(4)];
        let message = Message { task: Task { scene, shards: start..start + length }, hops };
        let subject = match self.draw(4) {
            0 => "span.one.two.three".to_owned(),
            // The subject of a whole scene, which the coordinator uses.
            1 => format!("span.{}.0-{SHARDS}.{}", self.draw(self.shards.len()), self.draw(3)),
            _ => write_subject(&message),
        };
        let bytes = match self.draw(4) {
            0 => vec![0xff; self.draw(30)],
            1 => write_message(*b"another!", &message),
            _ => write_message(RUN, &message),
        };
        self.note(|| format!("the adversary publishes {message:?} as {subject}"));
        self.forged.push((subject.clone(), bytes.clone()));
        self.queue.publish(subject, bytes);
    }

    /// Publishes a message again, on its own subject or on that of another one.
    fn replay(&mut self) {
        let seen = self.queue.kept.values().map(|kept| (kept.subject.clone(), kept.bytes.clone()));
        self.forged.extend(seen);
        if self.forged.is_empty() {
            return;
        }
        let (a, b) = (self.draw(self.forged.len()), self.draw(self.forged.len()));
        let (subject, bytes) = (self.forged[a].0.clone(), self.forged[b].1.clone());
        self.note(|| format!("the adversary replays as {subject}"));
        self.queue.publish(subject, bytes);
    }
}
