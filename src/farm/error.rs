//! What breaks the farm itself, not a scene.

use super::queue::QueueError;
use crate::run::run_dir::RunError;
use render::atomic_file::WriteError;
use crate::store::StoreError;

/// The farm itself broke (not a scene).
#[derive(Debug, thiserror::Error)]
pub enum FarmError {
    /// A file of the run cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// The run's store cannot be used, or holds other bits.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The run's queue cannot be used.
    #[error(transparent)]
    Queue(#[from] QueueError),
    /// The run is in use.
    #[error(transparent)]
    Run(#[from] RunError),
    /// A tuple cannot be written.
    #[error("{0}")]
    Tuple(String),
    /// A process for a span that may be dangerous could not work.
    #[error("a child process could not work, which is no fault of its scene: {0}")]
    Isolated(String),
    /// This machine computes other pixels.
    #[error(
        "this machine is refused: it computes other bits for the golden shard {scene} ({found}) than the run's spec holds \
         ({expected}); do not use it for this run, and report its CPU and this program's version"
    )]
    Golden {
        /// The golden scene.
        scene: String,
        /// Digest here.
        found: String,
        /// Digest in the spec.
        expected: String,
    },
}
