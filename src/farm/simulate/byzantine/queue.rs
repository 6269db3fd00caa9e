//! The queue as its server keeps it: subjects and bytes, which it does not read.

use crate::farm::worker::tasks::Time;
use std::collections::BTreeMap;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Holder {
    Nobody,
    Worker(u32),
    /// The adversary, which renews its lease for ever.
    Adversary,
}

#[derive(Clone, Debug)]
pub(super) struct Kept {
    pub(super) number: u64,
    pub(super) subject: String,
    pub(super) bytes: Vec<u8>,
    pub(super) holder: Holder,
    pub(super) deliveries: u32,
    pub(super) lease_end: Time,
    /// Time from which the message may be delivered.
    pub(super) not_before: Time,
}

/// At most one message per subject, by number in the stream.
#[derive(Default)]
pub(super) struct Queue {
    pub(super) kept: BTreeMap<u64, Kept>,
    last: u64,
}

impl Queue {
    /// Returns false if the subject has a message.
    pub(super) fn publish(&mut self, subject: String, bytes: Vec<u8>) -> bool {
        if self.kept.values().any(|kept| kept.subject == subject) {
            return false;
        }
        self.last += 1;
        let kept = Kept {
            number: self.last,
            subject,
            bytes,
            holder: Holder::Nobody,
            deliveries: 0,
            lease_end: Time::ZERO,
            not_before: Time::ZERO,
        };
        self.kept.insert(self.last, kept);
        true
    }

    /// Delivers a message. One that was delivered before precedes those that were not.
    pub(super) fn take(&mut self, now: Time, lease: Time, holder: Holder) -> Option<Kept> {
        let waits = |kept: &&Kept| kept.holder == Holder::Nobody && kept.not_before <= now;
        let waiting = || self.kept.values().filter(waits);
        let next = waiting().find(|kept| kept.deliveries > 0).or_else(|| waiting().next());
        let number = next?.number;
        let kept = self.kept.get_mut(&number)?;
        kept.deliveries += 1;
        (kept.holder, kept.lease_end) = (holder, now + lease);
        Some(kept.clone())
    }

    /// Removes a message, whoever holds it.
    pub(super) fn acknowledge(&mut self, number: u64) {
        self.kept.remove(&number);
    }

    /// Ends leases, except those of the adversary.
    pub(super) fn expire(&mut self, now: Time) {
        for kept in self.kept.values_mut() {
            if matches!(kept.holder, Holder::Worker(_)) && kept.lease_end <= now {
                kept.holder = Holder::Nobody;
            }
        }
    }
}
