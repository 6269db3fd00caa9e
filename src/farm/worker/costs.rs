//! The costs of a worker's work, to estimate the rest.

/// The mean costs of loading and tracing so far.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Costs {
    /// A thread's seconds for a shard.
    pub(crate) shard_s: f64,
    /// Threads that share a task's shards.
    pub(crate) threads: f64,
    pub(crate) load_s: f64,
    /// It was measured, not guessed.
    pub(crate) load_is_known: bool,
}

/// Workers whose loads differ by less are equally fast.
const ALIKE: f64 = 2.0;
/// The largest factor between two workers that is believed.
const MOST_TIMES: f64 = 8.0;

impl Costs {
    /// None if it is a guess.
    pub(crate) fn known_load_s(self) -> Option<f64> {
        self.load_is_known.then_some(self.load_s)
    }

    /// How many times as long a worker that loads a scene in `load_s` takes for the same work; 1 if that is not known, or too
    /// little to tell from the differences between scenes.
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
    fn load_times_tell_slow_workers() {
        let costs = Costs { shard_s: 1.0, threads: 1.0, load_s: 0.2, load_is_known: true };
        let of = |load_s| costs.slowness(Some(load_s));
        assert_eq!([of(0.2), of(0.3), of(0.15)], [1.0, 1.0, 1.0]);
        assert_eq!([of(0.8), of(0.05), of(100.0)], [4.0, 0.25, 8.0]);
        assert_eq!(costs.slowness(None), 1.0);
        let guessed = Costs { load_is_known: false, ..costs };
        assert_eq!((guessed.slowness(Some(9.0)), guessed.known_load_s()), (1.0, None));
    }
}
