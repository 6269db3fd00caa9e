//! Errors of the farm itself, independent of any scene.

use super::queue::QueueError;
use crate::run::{AccessError, RunError};
use crate::store::StoreError;
use render::atomic_file::WriteError;
use std::io;

#[derive(Debug, thiserror::Error)]
pub enum FarmError {
    #[error(transparent)]
    Access(#[from] AccessError),
    #[error(transparent)]
    Queue(#[from] QueueError),
    /// The files of no scene can be opened.
    #[error(
        "the files of no scene can be opened, so the run stops without a quarantine: {0}; is a disk not mounted?"
    )]
    NoInputs(String),
    #[error(
        "cannot start {threads} compute threads: {source}; give fewer with -j, or raise the limits of memory and processes \
         (ulimit -v, ulimit -u)"
    )]
    Threads { threads: usize, source: io::Error },
    /// The child process of a suspect task failed for a reason other than the task's scene.
    #[error("a child process could not work, which is no fault of its scene: {0}")]
    Sandbox(String),
}

impl From<WriteError> for FarmError {
    fn from(error: WriteError) -> Self {
        AccessError::from(error).into()
    }
}

impl From<StoreError> for FarmError {
    fn from(error: StoreError) -> Self {
        AccessError::from(error).into()
    }
}

impl From<RunError> for FarmError {
    fn from(error: RunError) -> Self {
        AccessError::from(error).into()
    }
}
