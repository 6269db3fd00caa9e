//! Errors of access to a run.

use crate::store::StoreError;
use render::atomic_file::WriteError;
use render::line::{ManifestError, RootError};
use std::io;
use std::path::PathBuf;

/// A run that cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The folder holds no run.
    #[error("{} is no run: it has no {missing}; make one with `glasshouse plan RECIPE --out {}`", root.display(), root.display())]
    Missing { root: PathBuf, missing: &'static str },
    /// A file cannot be read.
    #[error("cannot read {}: {source}; check the folder and its permissions", path.display())]
    Read { path: PathBuf, source: io::Error },
    /// `spec.json` is damaged, or a file is not text.
    #[error("{} is damaged: {reason}; plan the run again into a new folder", path.display())]
    Spec { path: PathBuf, reason: String },
    /// `manifest.jsonl` is damaged.
    #[error("{}: {source}", path.display())]
    Manifest { path: PathBuf, source: ManifestError },
    /// Another version planned the run, or its files do not match each other.
    #[error("{} disagrees with this program: {reason}; finish it with the version that planned it, or plan again into a new folder", root.display())]
    Disagrees { root: PathBuf, reason: String },
    /// A root of the spec is unusable.
    #[error(transparent)]
    Root(#[from] RootError),
    /// Another process works on the run.
    #[error("another process is working on {}; wait for it, or stop it", root.display())]
    Busy { root: PathBuf },
}

/// A run's files cannot be read or written, or this machine may not work on it.
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
    /// A tuple cannot be encoded or written.
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
