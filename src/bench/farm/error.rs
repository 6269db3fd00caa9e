//! Why a farm could not be measured.

use crate::bench::BenchError;
use crate::farm::queue::QueueError;
use crate::run::{PlanError, RunError};
use render::atomic_file::WriteError;
use std::path::PathBuf;

/// Why a farm could not be measured or simulated.
#[derive(Debug, thiserror::Error)]
pub enum FarmBenchError {
    /// There is no queue.
    #[error(
        "this needs a NATS server: install nats-server, or name one (--queue nats://host:4222)"
    )]
    NoQueue,
    /// Real processes cannot have that fault.
    #[error("--makespan takes --kill and --slow alone")]
    OtherFault,
    /// All workers are killed.
    #[error("no worker is left: kill fewer of them")]
    NoWorkerLeft,
    /// A simulation without end.
    #[error(
        "the run would never end: no worker is left, or faults undo work faster than workers do it; \
         leave more workers alive, or lengthen --lease-s"
    )]
    NeverEnds,
    #[error("stopped by a signal; nothing was measured to the end")]
    Stopped,
    /// The disk, a clock, a process.
    #[error("cannot {what}: {source}")]
    System { what: &'static str, source: std::io::Error },
    /// A file of a measured run is missing or cannot be read.
    #[error("cannot read {}: {source}; the measured farm did not finish its run", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    /// A process of the farm failed.
    #[error("a process of the measured farm {how}: {said}")]
    Process {
        how: String,
        /// Its last lines.
        said: String,
    },
    /// `nats-server` does not answer.
    #[error("nats-server does not start; name a running one (--queue nats://host:4222)")]
    Server,
    /// The run is not the one that was made.
    #[error("`status` counts {counted} tuples, but the run has {there}")]
    OtherTuples {
        /// By `status`.
        counted: String,
        /// Made for the measurement.
        there: u64,
    },
    /// The coordinator did not publish what is missing.
    #[error("after two minutes the coordinator has published {waiting} of {missing} spans")]
    NotPublished { waiting: u64, missing: u64 },
    /// A run cannot be planned.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// A run cannot be opened.
    #[error(transparent)]
    Run(#[from] RunError),
    #[error(transparent)]
    Queue(#[from] QueueError),
    /// A run cannot be half made.
    #[error(transparent)]
    Bench(#[from] BenchError),
    /// A recipe cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
}

impl FarmBenchError {
    /// For `map_err`: `what` was tried.
    pub(super) fn system(what: &'static str) -> impl Fn(std::io::Error) -> Self {
        move |source| Self::System { what, source }
    }
}
