//! The options of a worker, and the outcome of its work.

use crate::farm::fault::Fault;
use crate::farm::queue::Queue;
use crate::run::{Ending, StageSeconds, Stop, Task, WorkerName};
use glasshouse_line::ids::SceneId;
use render::trace::Isa;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

#[derive(Clone)]
pub struct WorkOptions<'a> {
    /// Number of compute threads. Further threads read files, write results, poll the control state and keep leases.
    pub threads: usize,
    pub isa: Isa,
    /// True once the caller wants the worker to stop after the shards in flight.
    pub stop: &'a AtomicBool,
    pub deadline: Option<Instant>,
    /// Names of this worker and its machine in attempts and receipts.
    pub who: WorkerName,
    /// Time without progress after which a task counts as hung.
    pub hang: Duration,
    /// Longest time that partials of a scene stay in memory only, unless other workers share the scene.
    pub checkpoint: Duration,
    /// Memory for decoded photographs that later scenes may show again, bytes.
    pub photographs_bytes: usize,
    /// Sandbox for tasks that may kill the process that traces them. Without a sandbox, this process traces them.
    pub sandbox: Option<&'a dyn Sandbox>,
    pub faults: &'a [Fault],
}

/// Default checkpoint interval. A partial of 9 MB costs 0.04 s of a core, and a worker killed once an hour loses half
/// an interval each time: the optimum is sqrt(2 * 0.04 s * 3600 s) = 17 s (Young, Communications of the ACM 17, 1974).
const CHECKPOINT: Duration = Duration::from_secs(20);

impl<'a> WorkOptions<'a> {
    /// Returns options without a deadline, for a worker in a single process.
    pub fn new(threads: usize, isa: Isa, stop: &'a AtomicBool) -> Self {
        Self {
            threads,
            isa,
            stop,
            deadline: None,
            who: WorkerName { worker: "local".to_owned(), host: "local".to_owned() },
            hang: Duration::from_mins(2),
            checkpoint: CHECKPOINT,
            photographs_bytes: 0,
            sandbox: None,
            faults: &[],
        }
    }
}

/// A queue from which other workers also lease, or the queue of a child process.
pub struct SharedQueue<'a> {
    pub queue: &'a dyn Queue,
    /// Time after which a task with an unrenewed lease goes to another worker.
    pub lease: Duration,
    /// Callback for a task that hangs. It must end the process, because a thread cannot be stopped.
    pub on_hung: &'a (dyn Fn(&str) + Sync),
    /// Callback before each renewal of the leases, three times per lease duration.
    pub on_sign: &'a (dyn Fn() + Sync),
    /// True if this process is a worker's child. The parent records attempts, and has checked the golden shard.
    pub is_child: bool,
}

/// Tracer of tasks in child processes, because the tasks may kill the process that traces them.
pub trait Sandbox: Sync {
    /// Traces shards of a scene and writes their results to the run's store. Calls `on_sign` while the child makes
    /// progress, and ends the child when `must_stop` returns true.
    fn trace(
        &self,
        scene: &SceneId,
        task: &Task,
        on_sign: &dyn Fn(),
        must_stop: &dyn Fn() -> bool,
    ) -> SandboxEnd;
}

#[derive(Clone, Debug)]
pub enum SandboxEnd {
    /// The task's results are durable, or its scene is in quarantine.
    Done {
        /// Number of tuples written: 0 or 1.
        merged: u64,
        traced: u64,
        resumed: u64,
        /// Number of scenes loaded: 0 or 1.
        loaded: u64,
        quarantined: Option<String>,
    },
    Stopped,
    /// The child died, or made no progress.
    Lost(Ending),
    /// The child could not work, through no fault of the scene.
    Failed(String),
}

#[derive(Debug)]
pub struct Outcome {
    pub merged: u64,
    /// Number of tuples that existed before; 0 with a shared queue.
    pub already_merged: u64,
    pub traced: u64,
    /// Number of shards that had a partial in the store when their scene was loaded.
    pub resumed: u64,
    /// Number of loads. Each of several workers that share a scene loads it.
    pub loaded: u64,
    /// Number of tasks donated to other workers, or requeued at the end.
    pub donated: u64,
    /// Quarantined scenes with the reasons: those of this worker and, without a shared queue, also earlier ones.
    pub quarantined: Vec<(SceneId, String)>,
    pub stopped: Option<Stop>,
    pub seconds: StageSeconds,
}
