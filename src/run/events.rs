//! What the farm tells whoever watches it.

use super::control::ControlState;
use render::ids::SceneId;
use rustix::time::{ClockId, clock_gettime};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Something happened. Told from worker threads.
#[derive(Clone, Debug)]
pub enum Event {
    /// Work begins.
    Started {
        /// Shards of all scenes that have no tuple yet.
        shards: u64,
        /// Scenes without a tuple.
        scenes: u64,
    },
    /// A scene is loaded; its shards will be traced.
    SceneOpened {
        /// Which.
        scene: SceneId,
    },
    /// A shard is done.
    ShardDone {
        /// Its partial was found and is intact, so it was not traced again.
        resumed: bool,
    },
    /// A partial on disk was no use.
    PartialRejected {
        /// Why, and what happens.
        reason: String,
    },
    /// A tuple is durable.
    SceneMerged {
        /// Which.
        scene: SceneId,
        /// Of its layers, the largest share of paths that ended on the continuation of a photograph's border.
        miss_share: f64,
    },
    /// The queue cannot be reached; what is held goes on.
    QueueLost {
        /// Why.
        reason: String,
    },
    /// The store is away; it is looked at again.
    StoreLost {
        /// Why.
        reason: String,
    },
    /// A scene that was lost with an earlier process is traced in one of its own.
    Isolated {
        /// Which.
        scene: SceneId,
    },
    /// That process was lost, too.
    ChildLost {
        /// With which scene.
        scene: SceneId,
        /// How.
        reason: String,
    },
    /// This process is about to abort, as it was ordered to.
    Aborts {
        /// When it came to this scene.
        scene: SceneId,
    },
    /// Too many scenes failed on this worker: it ends.
    Drained {
        /// Which, and what to do.
        reason: String,
    },
    /// The run was told to pause, to end, or to go on.
    Controlled {
        /// What it was told.
        state: ControlState,
        /// Why, if that was said.
        reason: Option<String>,
    },
    /// A scene cannot be done.
    SceneQuarantined {
        /// Which.
        scene: SceneId,
        /// Why.
        reason: String,
        /// Its shards, which will not be traced.
        shards: u64,
    },
}

/// Seconds of the clock, and of the thread that worked in them.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Spent {
    pub(crate) wall: Duration,
    pub(crate) cpu: Duration,
}

/// Measures a piece of one thread's work.
pub(crate) struct Stopwatch {
    wall: Instant,
    cpu: Duration,
}

impl Stopwatch {
    pub(crate) fn start() -> Self {
        Self {
            wall: Instant::now(),
            cpu: cpu_so_far(ClockId::ThreadCPUTime),
        }
    }

    pub(crate) fn spent(&self) -> Spent {
        Spent {
            wall: self.wall.elapsed(),
            cpu: cpu_so_far(ClockId::ThreadCPUTime).saturating_sub(self.cpu),
        }
    }
}

/// User and system time.
fn cpu_so_far(clock: ClockId) -> Duration {
    let time = clock_gettime(clock);
    Duration::new(time.tv_sec as u64, time.tv_nsec as u32)
}

/// User and system seconds of this process so far, of all its threads.
pub fn process_cpu_s() -> f64 {
    cpu_so_far(ClockId::ProcessCPUTime).as_secs_f64()
}

/// Stages that are told apart.
const STAGES: usize = 7;

/// Where the threads' seconds went, summed over threads.
#[derive(Debug)]
pub struct StageSeconds {
    read: Counter,
    decode: Counter,
    trace: Counter,
    checkpoint: Counter,
    merge: Counter,
    encode: Counter,
    write: Counter,
    /// CPU time of the process before it began to work.
    before: Duration,
}

/// Nanoseconds.
#[derive(Debug, Default)]
struct Counter {
    wall: AtomicU64,
    cpu: AtomicU64,
}

impl Counter {
    fn add(&self, spent: Spent) {
        let add = |to: &AtomicU64, time: Duration| {
            to.fetch_add(time.as_nanos() as u64, Ordering::Relaxed);
        };
        add(&self.wall, spent.wall);
        add(&self.cpu, spent.cpu);
    }
}

fn seconds(counter: &AtomicU64) -> f64 {
    counter.load(Ordering::Relaxed) as f64 * 1e-9
}

impl StageSeconds {
    /// The process begins to work.
    pub(crate) fn begin() -> Self {
        Self {
            read: Counter::default(),
            decode: Counter::default(),
            trace: Counter::default(),
            checkpoint: Counter::default(),
            merge: Counter::default(),
            encode: Counter::default(),
            write: Counter::default(),
            before: cpu_so_far(ClockId::ProcessCPUTime),
        }
    }

    pub(crate) fn add_read(&self, spent: Spent) {
        self.read.add(spent);
    }

    pub(crate) fn add_decode(&self, spent: Spent) {
        self.decode.add(spent);
    }

    pub(crate) fn add_trace(&self, spent: Spent) {
        self.trace.add(spent);
    }

    pub(crate) fn add_checkpoint(&self, spent: Spent) {
        self.checkpoint.add(spent);
    }

    pub(crate) fn add_merge(&self, spent: Spent) {
        self.merge.add(spent);
    }

    /// A tuple's files became bytes.
    pub(crate) fn add_encode(&self, spent: Spent) {
        self.encode.add(spent);
    }

    /// A tuple was put.
    pub(crate) fn add_write(&self, spent: Spent) {
        self.write.add(spent);
    }

    fn stages(&self) -> [(&'static str, &Counter); STAGES] {
        [
            ("read", &self.read),
            ("decode", &self.decode),
            ("trace", &self.trace),
            ("checkpoint", &self.checkpoint),
            ("merge", &self.merge),
            ("encode", &self.encode),
            ("write", &self.write),
        ]
    }

    /// Stage names and seconds of the clock, in pipeline order.
    pub fn all(&self) -> [(&'static str, f64); STAGES] {
        self.stages()
            .map(|(name, counter)| (name, seconds(&counter.wall)))
    }

    /// CPU seconds of the process so far: before it began to work, of the stages, and the rest, which is queue, leases
    /// and what the store's own threads do.
    pub fn cpu(&self) -> Vec<(&'static str, f64)> {
        let before = self.before.as_secs_f64();
        let mut all = vec![("before", before)];
        let stages = self.stages();
        all.extend(stages.map(|(name, counter)| (name, seconds(&counter.cpu))));
        let known: f64 = all.iter().map(|(_, s)| s).sum();
        let process = process_cpu_s();
        all.push(("rest", (process - known).max(0.0)));
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cpu_seconds_are_of_the_thread_and_add_up() {
        let stages = StageSeconds::begin();
        let slept = Stopwatch::start();
        std::thread::sleep(Duration::from_millis(60));
        stages.add_trace(slept.spent());
        let worked = Stopwatch::start();
        let mut x = 1u64;
        while worked.spent().cpu < Duration::from_millis(20) {
            x = std::hint::black_box(x.wrapping_mul(3));
        }
        stages.add_merge(worked.spent());
        let of = |name: &str, all: &[(&str, f64)]| all.iter().find(|(n, _)| *n == name).unwrap().1;
        assert!(of("trace", &stages.all()) >= 0.06);
        let cpu = stages.cpu();
        assert!(of("trace", &cpu) < 0.03, "{cpu:?}");
        assert!(of("merge", &cpu) >= 0.02, "{cpu:?}");
        let sum: f64 = cpu.iter().map(|(_, s)| s).sum();
        let process = process_cpu_s();
        assert!(sum <= process + 1e-6, "{sum} of {process}");
    }
}
