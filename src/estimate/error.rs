//! Errors of estimating a folder's depth.

use crate::made::MadeError;
use render::atomic_file::WriteError;
use std::io;
use std::path::PathBuf;

#[derive(Debug, thiserror::Error)]
pub enum EstimateError {
    #[error(transparent)]
    Write(#[from] WriteError),
    #[error(transparent)]
    Made(#[from] MadeError),
    #[error("cannot read {}: {source}; check the folder and its permissions", path.display())]
    Read { path: PathBuf, source: io::Error },
    #[error("cannot remove {}: {source}; check the folder's permissions", path.display())]
    Remove { path: PathBuf, source: io::Error },
    #[error("cannot link or copy {} to {}: {source}; check the disk's space and the folder's permissions", from.display(), to.display())]
    Link { from: PathBuf, to: PathBuf, source: io::Error },
    #[error("{} is neither empty nor a folder of depth maps by these weights and settings: give another --out", out.display())]
    Foreign { out: PathBuf },
}
