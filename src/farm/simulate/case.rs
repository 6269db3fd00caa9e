//! A case to simulate: the work, the fleet, the rules and the faults.

pub(super) use glasshouse_line::hash::splitmix64 as mix;

/// Scenes and their costs.
#[derive(Clone, Debug, PartialEq)]
pub struct Work {
    pub scenes: u32,
    pub shards: u32,
    /// Mean time of a worker of speed 1 for a shard of the cheapest scenes, s. Shards vary by up to 25 % either way.
    pub cheapest_shard_s: f64,
    /// Number of doublings from the cheapest scenes to the dearest (4: costs of 1, 2, 4, 8 and 16, equally frequent).
    pub doublings: u32,
    /// Number of scenes at the end that have the highest cost. High costs at the end are the worst case.
    pub dearest_last: u32,
    /// Time of a worker of speed 1 to load a scene, s.
    pub load_s: f64,
    /// Seed of the costs, the jitter and the choice of donors.
    pub seed: u64,
}

impl Work {
    /// Returns the time of a worker of speed 1 for a shard, µs. Seed 0 gives the costs of the measured prototype.
    pub fn shard_us(&self, scene: u32, shard: u32) -> u64 {
        let seed = if self.seed == 0 { 0 } else { mix(self.seed) };
        let drawn = mix(u64::from(scene) ^ seed) % u64::from(self.doublings + 1);
        let is_last = scene + self.dearest_last >= self.scenes;
        let doublings = if is_last { u64::from(self.doublings) } else { drawn };
        // The prototype's stride was 100; scenes with more shards need a larger one.
        let stride = u64::from(self.shards.max(100));
        let key = (u64::from(scene) * stride + u64::from(shard) + 7) ^ seed;
        let percent = 75 + mix(key) % 50;
        let base_us = (self.cheapest_shard_s * 1e6) as u64;
        ((base_us << doublings) * percent / 100).max(1)
    }
}

/// Workers, and the delays between them and the servers.
#[derive(Clone, Debug, PartialEq)]
pub struct Fleet {
    pub workers: u32,
    /// Time from a worker to the queue's server and back, s.
    pub round_trip_s: f64,
    /// Time of a small request to the store (a listing, a put), s.
    pub store_s: f64,
    /// Time that the store takes to list a page of 1000 keys, s.
    pub page_s: f64,
    /// Number of messages that the queue confirms to a publisher per second.
    pub publishes_per_s: f64,
}

/// Intervals in the rules of the farm.
#[derive(Clone, Debug, PartialEq)]
pub struct Rules {
    /// Time after which an unrenewed lease expires, s. Workers renew a lease after every third of it.
    pub lease_s: f64,
    /// Longest time between two reconciliations by the coordinator, s.
    pub reconcile_s: f64,
}

/// A fault of a worker, or of the queue's server.
#[derive(Clone, Debug, PartialEq)]
pub enum Fault {
    Kill {
        worker: u32,
        at_s: f64,
    },
    /// All work of this worker takes longer by the factor `times`.
    Slow {
        worker: u32,
        times: f64,
    },
    /// The worker freezes for a while and then continues.
    Stop {
        worker: u32,
        at_s: f64,
        for_s: f64,
    },
    /// The queue loses its stream with all messages.
    Wipe {
        at_s: f64,
    },
    /// The queue's server cannot be reached. It keeps its messages; overdue leases expire on its return.
    Away {
        at_s: f64,
        for_s: f64,
    },
}

#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    pub work: Work,
    pub fleet: Fleet,
    pub rules: Rules,
    pub faults: Vec<Fault>,
}

impl Default for Fleet {
    fn default() -> Self {
        let (round_trip_s, publishes_per_s) = (0.001, 100_000.0);
        Self { workers: 8, round_trip_s, store_s: 0.02, page_s: 0.1, publishes_per_s }
    }
}

impl Default for Rules {
    fn default() -> Self {
        Self { lease_s: 30.0, reconcile_s: 600.0 }
    }
}

impl Default for Work {
    /// Returns the prototype's measured case: 50 scenes of 16 shards, costs of 1 to 16, and 16 for the last three.
    fn default() -> Self {
        Self {
            scenes: 50,
            shards: 16,
            cheapest_shard_s: 0.02,
            doublings: 4,
            dearest_last: 3,
            load_s: 0.2,
            seed: 0,
        }
    }
}

/// Draws each worker with probability `share`. Returns the drawn indices, each with a random number in 0..1.
pub fn some_workers(workers: u32, share: f64, seed: u64) -> Vec<(u32, f64)> {
    let unit = |key: u64| (mix(seed ^ mix(key)) >> 11) as f64 / (1u64 << 53) as f64;
    (0..workers)
        .filter(|&w| unit(2 * u64::from(w) + 1) < share)
        .map(|w| (w, unit(2 * u64::from(w) + 2)))
        .collect()
}
