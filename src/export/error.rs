//! Errors of an export.

use crate::made::MadeError;
use crate::run::AccessError;
use crate::store::StoreError;
use render::atomic_file::WriteError;
use std::io;
use std::path::PathBuf;

#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    #[error(transparent)]
    Write(#[from] WriteError),
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    Run(#[from] AccessError),
    #[error(transparent)]
    Made(#[from] MadeError),
    #[error("cannot read {}: {source}; check the folder and its permissions", path.display())]
    Read { path: PathBuf, source: io::Error },
    #[error("{0}")]
    Request(String),
    #[error(
        "{missing} of {scenes} scenes are not merged yet: finish the run with `glasshouse work RUN` first, or export \
         the finished scenes with --partial"
    )]
    Unfinished { missing: usize, scenes: usize },
    #[error("cannot export anything: {0}")]
    Nothing(String),
    #[error(
        "{file}: {reason}; `glasshouse audit` finds other damage; `glasshouse retry --anew` resets the scene"
    )]
    Damaged {
        /// Key in the store.
        file: String,
        reason: String,
    },
    #[error("cannot encode {name}: {reason}")]
    Encode { name: String, reason: String },
    #[error("{} {reason}; export into a new folder, or remove this one", out.display())]
    Foreign { out: PathBuf, reason: String },
    #[error(
        "the folder {} was deleted, moved or replaced during the export: put it back if it was moved, and export again",
        out.display()
    )]
    Moved { out: PathBuf },
    #[error("another process is exporting into {}; wait for it, or stop it", out.display())]
    Busy { out: PathBuf },
}

/// Returns a function for `map_err` that converts an I/O error of a path in the export.
pub(super) fn unreadable(path: &std::path::Path) -> impl FnOnce(io::Error) -> ExportError {
    let path = path.to_owned();
    move |source| ExportError::Read { path, source }
}
