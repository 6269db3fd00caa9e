//! What is counted: messages by kind, in all and in the second with the most.

/// Kinds of messages to and from the queue's server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub enum Kind {
    /// A message into the stream, and its confirmation.
    Publish,
    /// A request for a message.
    Pull,
    /// A message to a worker.
    Deliver,
    /// A task is done.
    Acknowledge,
    /// A lease is lengthened.
    Renew,
    /// An idle worker requests a donation.
    Ask,
    /// The answer of a giver, or that there is none.
    Answer,
    /// A worker begins or ceases to listen to those requests.
    Listen,
}

impl Kind {
    /// As tables and JSON name it.
    pub fn name(self) -> &'static str {
        KINDS[self as usize].1
    }
}

/// All of them, in this order, with their names.
pub(super) const KINDS: [(Kind, &str); 8] = [
    (Kind::Publish, "publish"),
    (Kind::Pull, "pull"),
    (Kind::Deliver, "deliver"),
    (Kind::Acknowledge, "acknowledge"),
    (Kind::Renew, "renew"),
    (Kind::Ask, "ask"),
    (Kind::Answer, "answer"),
    (Kind::Listen, "listen"),
];

/// Messages of each kind in each second.
#[derive(Clone, Debug, Default)]
pub(super) struct Tally {
    seconds: Vec<[u32; KINDS.len()]>,
}

impl Tally {
    pub(super) fn count(&mut self, kind: Kind, now_us: u64) {
        let second = (now_us / 1_000_000) as usize;
        if second >= self.seconds.len() {
            self.seconds.resize(second + 1, [0; KINDS.len()]);
        }
        self.seconds[second][kind as usize] += 1;
    }

    /// Of a kind: all, and in the second with the most.
    pub(super) fn of(&self, kind: Kind) -> (u64, u32) {
        let of_second = |s: &[u32; KINDS.len()]| s[kind as usize];
        let all = self.seconds.iter().map(|s| u64::from(of_second(s))).sum();
        (all, self.seconds.iter().map(of_second).max().unwrap_or(0))
    }

    /// Of all kinds, in the second with the most.
    pub(super) fn peak(&self) -> u32 {
        let of_second = |s: &[u32; KINDS.len()]| s.iter().sum();
        self.seconds.iter().map(of_second).max().unwrap_or(0)
    }

    /// Of all kinds, the median of the seconds up to `end_s`.
    pub(super) fn median(&self, end_s: f64) -> u32 {
        let end = (end_s as usize).clamp(1, self.seconds.len().max(1));
        let mut sums: Vec<u32> = self.seconds.iter().take(end).map(|s| s.iter().sum()).collect();
        sums.sort_unstable();
        sums.get(sums.len() / 2).copied().unwrap_or(0)
    }
}
