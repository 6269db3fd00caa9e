//! Measures wall-clock and CPU time of a worker's stages.

use rustix::time::{ClockId, clock_gettime};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Wall-clock and CPU time of a piece of work.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Spent {
    pub(crate) wall: Duration,
    pub(crate) cpu: Duration,
}

/// A stopwatch for the work of one thread.
pub(crate) struct Stopwatch {
    wall: Instant,
    cpu: Duration,
}

impl Stopwatch {
    pub(crate) fn start() -> Self {
        Self { wall: Instant::now(), cpu: cpu_so_far(ClockId::ThreadCPUTime) }
    }

    pub(crate) fn spent(&self) -> Spent {
        Spent {
            wall: self.wall.elapsed(),
            cpu: cpu_so_far(ClockId::ThreadCPUTime).saturating_sub(self.cpu),
        }
    }
}

/// Returns the user and system time so far.
fn cpu_so_far(clock: ClockId) -> Duration {
    let time = clock_gettime(clock);
    Duration::new(time.tv_sec as u64, time.tv_nsec as u32)
}

/// Returns the user and system seconds of all threads of this process so far.
pub fn process_cpu_s() -> f64 {
    cpu_so_far(ClockId::ProcessCPUTime).as_secs_f64()
}

/// Stages of a worker's threads, in pipeline order.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Stage {
    Read,
    Decode,
    Trace,
    Checkpoint,
    Merge,
    Encode,
    Write,
}

/// Names of the stages in JSON, in their order.
const STAGES: [&str; 7] = ["read", "decode", "trace", "checkpoint", "merge", "encode", "write"];

/// Time by stage, summed over threads.
#[derive(Debug)]
pub struct StageSeconds {
    stages: [Counter; STAGES.len()],
    /// CPU time of the process before work started.
    before: Duration,
}

#[derive(Debug, Default)]
struct Counter {
    wall: AtomicU64,
    cpu: AtomicU64,
}

fn seconds(counter: &AtomicU64) -> f64 {
    counter.load(Ordering::Relaxed) as f64 * 1e-9
}

impl StageSeconds {
    pub(crate) fn begin() -> Self {
        Self { stages: Default::default(), before: cpu_so_far(ClockId::ProcessCPUTime) }
    }

    pub(crate) fn add(&self, stage: Stage, spent: Spent) {
        let add = |to: &AtomicU64, time: Duration| {
            to.fetch_add(time.as_nanos() as u64, Ordering::Relaxed);
        };
        let counter = &self.stages[stage as usize];
        add(&counter.wall, spent.wall);
        add(&counter.cpu, spent.cpu);
    }

    /// Returns the wall-clock seconds by stage, in pipeline order.
    pub fn all(&self) -> [(&'static str, f64); STAGES.len()] {
        std::array::from_fn(|k| (STAGES[k], seconds(&self.stages[k].wall)))
    }

    /// Returns the CPU seconds of the process so far: before work started, by stage, and the rest (the queue, leases
    /// and the store's threads).
    pub fn cpu(&self) -> Vec<(&'static str, f64)> {
        let before = self.before.as_secs_f64();
        let mut all = vec![("before", before)];
        let stages = STAGES.iter().zip(&self.stages);
        all.extend(stages.map(|(name, counter)| (*name, seconds(&counter.cpu))));
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
    fn cpu_seconds_belong_to_the_thread_and_add_up() {
        let stages = StageSeconds::begin();
        let slept = Stopwatch::start();
        std::thread::sleep(Duration::from_millis(60));
        stages.add(Stage::Trace, slept.spent());
        let worked = Stopwatch::start();
        let mut x = 1u64;
        while worked.spent().cpu < Duration::from_millis(20) {
            x = std::hint::black_box(x.wrapping_mul(3));
        }
        stages.add(Stage::Merge, worked.spent());
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
