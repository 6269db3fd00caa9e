//! Errors of access to a run.

use crate::store::StoreError;
use glasshouse_line::{ManifestError, RootError};
use render::atomic_file::WriteError;
use std::io;
use std::path::PathBuf;

/// Reason why a run cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The folder holds no run.
    #[error("{} is not the folder of a run: {missing} is missing; `glasshouse plan RECIPE --out {}` plans a run", root.display(), root.display())]
    Missing { root: PathBuf, missing: &'static str },
    /// A file cannot be read.
    #[error("cannot read {}: {source}; check the folder and its permissions", path.display())]
    Read { path: PathBuf, source: io::Error },
    /// The disk lacks what a run needs.
    #[error("{}: {source}", root.display())]
    Disk { root: PathBuf, source: io::Error },
    /// `spec.json` is damaged or has no manifest, or a file is not text.
    #[error("{} is damaged: {reason}; plan the run again into a new folder", path.display())]
    Spec { path: PathBuf, reason: String },
    /// `manifest.jsonl` is damaged.
    #[error("{}: {source}", path.display())]
    Manifest { path: PathBuf, source: ManifestError },
    /// Another version planned the run, or its files do not match each other.
    #[error("{} disagrees with this program: {reason}; finish the run with the version that planned it, or plan again into a new folder", root.display())]
    Disagrees { root: PathBuf, reason: String },
    /// A root of the spec is unusable.
    #[error(transparent)]
    Root(#[from] RootError),
    /// A file of the run was changed or removed while this process worked on the run.
    #[error("{} was changed, moved or removed during the command: its results are incomplete; put the file back and run the command again, or plan again into a new folder", path.display())]
    Changed { path: PathBuf },
    /// Another process works on the run.
    #[error("another process is working on {}; wait for it, or stop it", root.display())]
    Busy { root: PathBuf },
}

/// A failed access to a run: a file or the store cannot be used, or this machine may not work on the run.
#[derive(Debug, thiserror::Error)]
pub enum AccessError {
    /// A file of the run cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// The run's store cannot be used, or holds other bytes.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The run cannot be opened or is in use.
    #[error(transparent)]
    Run(#[from] RunError),
    /// The partials of a scene cannot be combined into a tuple, or a file of the tuple cannot be encoded.
    #[error("{0}")]
    Tuple(String),
    /// This machine computes different pixels than the machine that planned the run.
    #[error(
        "this machine is refused: it computes other bits for the golden shard {scene} ({found}) than the run's spec holds \
         ({expected}); do not use it for this run, and report its CPU and this program's version"
    )]
    Golden {
        scene: String,
        found: String,
        /// Digest in the spec.
        expected: String,
    },
}
