//! A case to simulate: the work, the fleet, the rules, the faults.

pub(super) use render::hash::splitmix64 as mix;

/// Scenes and their costs.
#[derive(Clone, Debug, PartialEq)]
pub struct Work {
    pub scenes: u32,
    pub shards: u32,
    /// Seconds of a worker of speed 1 for a shard of the cheapest scenes; a shard is 25 % more or less.
    pub cheapest_shard_s: f64,
    /// How often the cost doubles from the cheapest scenes to the dearest: 4 is 1:16. All are equally frequent.
    pub doublings: u32,
    /// So many scenes, the last ones, are of the dearest: the worst order.
    pub dearest_last: u32,
    /// Seconds of a worker of speed 1 to load a scene.
    pub load_s: f64,
    /// Seeds the costs, the jitter and the choice of donors.
    pub seed: u64,
}

impl Work {
    /// Microseconds of a worker of speed 1. Seed 0 has the costs of the measured prototype.
    pub fn shard_us(&self, scene: u32, shard: u32) -> u64 {
        let seed = if self.seed == 0 { 0 } else { mix(self.seed) };
        let drawn = mix(u64::from(scene) ^ seed) % u64::from(self.doublings + 1);
        let is_last = scene + self.dearest_last >= self.scenes;
        let doublings = if is_last { u64::from(self.doublings) } else { drawn };
        // The prototype's 100, or more where scenes have more shards.
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
    /// Seconds from a worker to the queue's server and back.
    pub round_trip_s: f64,
    /// Seconds of a small request to the store: a listing, a put.
    pub store_s: f64,
    /// Seconds that the store needs for a page of 1000 keys.
    pub page_s: f64,
    /// Messages that a publisher gets confirmed in a second.
    pub publishes_per_s: f64,
}

/// Times that a user of a farm chooses, s.
#[derive(Clone, Debug, PartialEq)]
pub struct Rules {
    /// A lease ends after this time unless it is renewed, which happens every third of it.
    pub lease_s: f64,
    /// A coordinator reconciles at least so often.
    pub reconcile_s: f64,
}

/// A fault of a worker, or of the servers.
#[derive(Clone, Debug, PartialEq)]
pub enum Fault {
    Kill {
        worker: u32,
        at_s: f64,
    },
    /// The worker takes so many times as long throughout.
    Slow {
        worker: u32,
        times: f64,
    },
    /// The worker is stopped, then goes on as if nothing had happened.
    Stop {
        worker: u32,
        at_s: f64,
        for_s: f64,
    },
    /// The queue forgets everything; its stream is gone.
    Wipe {
        at_s: f64,
    },
    /// The queue's server is away; it keeps its messages, and leases go on ending.
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
    /// The measured case of the prototype: 50 scenes of 16 shards, costs 1:16, the dearest last.
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

/// Each of `workers` with the probability `share`, drawn by `seed`, with a random number in 0..1.
pub fn some_workers(workers: u32, share: f64, seed: u64) -> Vec<(u32, f64)> {
    let unit = |key: u64| (mix(seed ^ mix(key)) >> 11) as f64 / (1u64 << 53) as f64;
    (0..workers)
        .filter(|&w| unit(2 * u64::from(w) + 1) < share)
        .map(|w| (w, unit(2 * u64::from(w) + 2)))
        .collect()
}
