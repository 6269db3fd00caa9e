//! The options of a worker, and the outcome of its work.

use crate::farm::fault::Fault;
use crate::farm::queue::Queue;
use crate::run::{Ending, StageSeconds, Stop, Task, WorkerName};
use render::ids::SceneId;
use render::trace::Isa;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

#[derive(Clone)]
pub struct WorkOptions<'a> {
    /// Compute threads. One more reads files and one writes them.
    pub threads: usize,
    pub isa: Isa,
    /// Set from outside to stop after the shards in flight.
    pub stop: &'a AtomicBool,
    pub deadline: Option<Instant>,
    /// This worker's name in attempts and receipts.
    pub who: WorkerName,
    /// A task without any progress for this time counts as hung.
    pub hang: Duration,
    /// Partials of a scene that this worker has as a whole stay in memory for this time, until its last shard is traced.
    pub checkpoint: Duration,
    /// Traces tasks that may be dangerous in another process; without it they are traced in this one.
    pub sandbox: Option<&'a dyn Sandbox>,
    pub faults: &'a [Fault],
}

/// A partial of 9 MB costs some 0.04 s of a core; a worker that is killed once an hour loses half of this time each time.
/// The best is the root of twice the one times the other (Young, Communications of the ACM 17, 1974), 17 s.
const CHECKPOINT: Duration = Duration::from_secs(20);

impl<'a> WorkOptions<'a> {
    /// Without a deadline, in one process.
    pub fn new(threads: usize, isa: Isa, stop: &'a AtomicBool) -> Self {
        Self {
            threads,
            isa,
            stop,
            deadline: None,
            who: WorkerName { worker: "local".to_owned(), host: "local".to_owned() },
            hang: Duration::from_mins(2),
            checkpoint: CHECKPOINT,
            sandbox: None,
            faults: &[],
        }
    }
}

/// A queue from which other workers lease, too.
pub struct SharedQueue<'a> {
    pub queue: &'a dyn Queue,
    /// A lease that is not renewed for this time goes to another worker.
    pub lease: Duration,
    /// Called when a task is hung. It must end the process: the thread cannot be stopped.
    pub on_hung: &'a (dyn Fn(&str) + Sync),
    /// Called before leases are renewed, three times a lease.
    pub on_sign: &'a (dyn Fn() + Sync),
    /// This process is a worker's sandbox: the worker records attempts, and has checked the golden shard.
    pub is_child: bool,
}

/// Traces tasks in a child process, since they may kill it.
pub trait Sandbox: Sync {
    /// Traces shards of a scene and writes their results to the run's store. `on_sign` is called while there is progress;
    /// when `must_stop` returns true the process is ended.
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
    /// All of the task is durable, or its scene is in quarantine.
    Done {
        /// Tuples written: one or none.
        merged: u64,
        traced: u64,
        resumed: u64,
        /// Scenes loaded: one or none.
        loaded: u64,
        quarantined: Option<String>,
    },
    Stopped,
    /// It died, or made no progress.
    Lost(Ending),
    /// It could not work, through no fault of the scene.
    Failed(String),
}

#[derive(Debug)]
pub struct Outcome {
    pub merged: u64,
    /// Tuples that were there before.
    pub already_merged: u64,
    pub traced: u64,
    /// Shards whose partials were found.
    pub resumed: u64,
    /// Scenes loaded; one that several workers share is loaded by each.
    pub loaded: u64,
    /// Tasks donated to other workers, while working or at the end.
    pub donated: u64,
    /// Scenes in quarantine with their reasons, earlier ones included.
    pub quarantined: Vec<(SceneId, String)>,
    pub stopped: Option<Stop>,
    pub seconds: StageSeconds,
}
