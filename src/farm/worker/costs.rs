//! What a worker's work costs, for guessing what is left.

/// What loading and tracing cost so far.
#[derive(Clone, Copy, Debug)]
pub(in crate::farm) struct Costs {
    /// A thread's seconds for a shard, of all scenes so far.
    pub(in crate::farm) shard_s: f64,
    /// Threads that share a task's shards.
    pub(in crate::farm) threads: f64,
    /// Seconds to load a scene.
    pub(in crate::farm) load_s: f64,
    /// It was measured, not guessed.
    pub(in crate::farm) load_is_known: bool,
}

/// Workers whose loads differ by less are equally fast.
const ALIKE: f64 = 2.0;
/// No worker is believed to be faster or slower than another one by more than this factor.
const MOST_TIMES: f64 = 8.0;

impl Costs {
    /// Unless it is guessed.
    pub(in crate::farm) fn known_load_s(self) -> Option<f64> {
        self.load_is_known.then_some(self.load_s)
    }

    /// How much longer a worker that loads a scene in `load_s` needs for the same work; 1 if that is not known or hardly
    /// different: loads differ, too.
    pub(in crate::farm) fn slowness(self, load_s: Option<f64>) -> f64 {
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
    fn loads_tell_who_is_slower() {
        let costs = Costs { shard_s: 1.0, threads: 1.0, load_s: 0.2, load_is_known: true };
        let of = |load_s| costs.slowness(Some(load_s));
        assert_eq!([of(0.2), of(0.3), of(0.15)], [1.0, 1.0, 1.0]);
        assert_eq!([of(0.8), of(0.05), of(100.0)], [4.0, 0.25, 8.0]);
        assert_eq!(costs.slowness(None), 1.0);
        let guessed = Costs { load_is_known: false, ..costs };
        assert_eq!((guessed.slowness(Some(9.0)), guessed.known_load_s()), (1.0, None));
    }
}
