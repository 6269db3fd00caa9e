//! Events of a worker or coordinator, and the time that its stages take.

use super::control::ControlState;
use render::ids::SceneId;
use rustix::time::{ClockId, clock_gettime};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// An event; reported from worker threads.
#[derive(Clone, Debug)]
pub enum Event {
    /// Work starts.
    Started {
        /// Shards of all scenes without a tuple.
        shards: u64,
        /// Scenes without a tuple.
        scenes: u64,
    },
    /// A scene is loaded; its shards will be traced.
    SceneOpened {
        /// Its id.
        scene: SceneId,
    },
    /// A shard is done.
    ShardDone {
        /// An intact partial was found, so it was not traced again.
        resumed: bool,
    },
    /// A partial on disk is damaged or of another plan.
    PartialRejected {
        /// What is wrong, and what happens next.
        reason: String,
    },
    /// A tuple is durable.
    SceneMerged {
        /// Its scene.
        scene: SceneId,
        /// The largest share, among its layers, of paths that ended beyond a photograph's border.
        miss_share: f64,
    },
    /// The queue cannot be reached; spans that are held go on.
    QueueLost {
        /// Why.
        reason: String,
    },
    /// The store cannot be reached; it is tried again.
    StoreLost {
        /// Why.
        reason: String,
    },
    /// A scene that was lost with an earlier process is traced in a child process.
    Isolated {
        /// Its id.
        scene: SceneId,
    },
    /// That child process was lost, too.
    ChildLost {
        /// Its scene.
        scene: SceneId,
        /// How it ended.
        reason: String,
    },
    /// This process aborts, as `--fault` asked.
    Aborts {
        /// The scene at which it aborts.
        scene: SceneId,
    },
    /// Too many scenes failed on this worker, so it ends.
    Drained {
        /// Which scenes, and what to do.
        reason: String,
    },
    /// The run was paused, cancelled or resumed.
    Controlled {
        /// Its new state.
        state: ControlState,
        /// Why, if the user gave a reason.
        reason: Option<String>,
    },
    /// A scene was put into quarantine.
    SceneQuarantined {
        /// Its id.
        scene: SceneId,
        /// Why.
        reason: String,
        /// Its shards, which are not traced.
        shards: u64,
    },
}

/// Wall-clock and CPU time of a piece of work.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Spent {
    pub(crate) wall: Duration,
    pub(crate) cpu: Duration,
}

/// Measures the work of one thread.
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

/// User and system time so far.
fn cpu_so_far(clock: ClockId) -> Duration {
    let time = clock_gettime(clock);
    Duration::new(time.tv_sec as u64, time.tv_nsec as u32)
}

/// User and system seconds of all threads of this process so far.
pub fn process_cpu_s() -> f64 {
    cpu_so_far(ClockId::ProcessCPUTime).as_secs_f64()
}

/// Number of stages.
const STAGES: usize = 7;

/// Time by stage, summed over threads.
#[derive(Debug)]
pub struct StageSeconds {
    read: Counter,
    decode: Counter,
    trace: Counter,
    checkpoint: Counter,
    merge: Counter,
    encode: Counter,
    write: Counter,
    /// CPU time of the process before work started.
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
    /// Starts to count.
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

    /// CPU seconds of the process so far: before work started, by stage, and the rest, which is the queue, leases and the
    /// store's threads.
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
