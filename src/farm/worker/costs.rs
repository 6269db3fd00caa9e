//! Mean costs of a worker's tasks, to estimate the remaining time.

/// The mean costs of loading and tracing so far.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Costs {
    /// Time of a thread for a shard, s.
    pub(crate) shard_s: f64,
    /// Number of threads that share a task's shards.
    pub(crate) threads: f64,
    pub(crate) load_s: f64,
    /// True if `load_s` was measured, false if it is a guess.
    pub(crate) load_is_known: bool,
}

/// Factor between two load times below which the workers count as equally fast.
const ALIKE: f64 = 2.0;
/// Largest accepted factor between the speeds of two workers.
const MOST_TIMES: f64 = 8.0;

impl Costs {
    /// Returns the load time unless it is a guess.
    pub(crate) fn known_load_s(self) -> Option<f64> {
        self.load_is_known.then_some(self.load_s)
    }

    /// Returns the time of a worker that loads a scene in `load_s`, relative to this worker's time for the same work.
    /// Returns 1 if a load time is unknown, or if the difference may come from the scenes.
    pub(crate) fn slowness(self, load_s: Option<f64>) -> f64 {
        let times = match load_s {
            Some(load_s) if self.load_is_known => load_s / self.load_s.max(1e-6),
            _ => 1.0,
        };
        if (1.0 / ALIKE..ALIKE).contains(&times) {
            1.0
        } else {
            times.clamp(1.0 / MOST_TIMES, MOST_TIMES)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn load_times_identify_slow_workers() {
        let costs = Costs { shard_s: 1.0, threads: 1.0, load_s: 0.2, load_is_known: true };
        let of = |load_s| costs.slowness(Some(load_s));
        assert_eq!([of(0.2), of(0.3), of(0.15)], [1.0, 1.0, 1.0]);
        assert_eq!([of(0.8), of(0.05), of(100.0)], [4.0, 0.25, 8.0]);
        assert_eq!(costs.slowness(None), 1.0);
        let guessed = Costs { load_is_known: false, ..costs };
        assert_eq!((guessed.slowness(Some(9.0)), guessed.known_load_s()), (1.0, None));
    }
}
