//! Errors of farm measurements and simulations.

use crate::bench::BenchError;
use crate::farm::queue::QueueError;
use crate::run::{PlanError, RunError};
use render::atomic_file::WriteError;
use std::path::PathBuf;

#[derive(Debug, thiserror::Error)]
pub enum FarmBenchError {
    #[error(
        "the measurement needs a NATS server: install nats-server, or name one (--queue nats://host:4222)"
    )]
    NoQueue,
    #[error("--makespan takes no faults but --kill and --slow")]
    OtherFault,
    #[error("no worker is left: kill fewer workers")]
    NoWorkerLeft,
    #[error(
        "the run would never end: no worker is left, or faults undo work faster than workers finish it; \
         leave more workers alive, or lengthen --lease-s"
    )]
    NeverEnds,
    #[error("a signal stopped the measurement before its end")]
    Stopped,
    #[error("cannot {what}: {source}")]
    System { what: &'static str, source: std::io::Error },
    #[error("cannot read {}: {source}; the measured farm did not finish its run", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error("a process of the measured farm {how}: {said}")]
    Process { how: String, said: String },
    #[error("nats-server does not start; name a running one (--queue nats://host:4222)")]
    Server,
    #[error("`status` counts {counted} tuples, but the run has {there}")]
    OtherTuples { counted: String, there: u64 },
    #[error("after two minutes, the coordinator has published {waiting} of {missing} tasks")]
    NotPublished { waiting: u64, missing: u64 },
    #[error(transparent)]
    Plan(#[from] PlanError),
    #[error(transparent)]
    Run(#[from] RunError),
    #[error(transparent)]
    Queue(#[from] QueueError),
    #[error(transparent)]
    Bench(#[from] BenchError),
    #[error(transparent)]
    Write(#[from] WriteError),
}

impl FarmBenchError {
    /// Returns a function for `map_err` that wraps an I/O error of the operation `what`.
    pub(super) fn system(what: &'static str) -> impl Fn(std::io::Error) -> Self {
        move |source| Self::System { what, source }
    }
}
