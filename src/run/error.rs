//! A run whose files cannot be used.

use super::run_dir::RunError;
use crate::store::StoreError;
use render::atomic_file::WriteError;

/// A run's files cannot be read or written, or this machine may not work on it.
#[derive(Debug, thiserror::Error)]
pub enum AccessError {
    /// A file of the run cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// The run's store cannot be used, or holds other bits.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The run is in use.
    #[error(transparent)]
    Run(#[from] RunError),
    /// A tuple cannot be written.
    #[error("{0}")]
    Tuple(String),
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
