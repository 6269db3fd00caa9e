//! Why an export ends early.

use crate::run::AccessError;
use crate::store::StoreError;
use render::atomic_file::WriteError;
use std::io;
use std::path::PathBuf;

/// An export that cannot begin or go on.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// A file of the export cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The run's state cannot be read.
    #[error(transparent)]
    Run(#[from] AccessError),
    /// A file of the export cannot be read back.
    #[error("cannot read {}: {source}; check the folder and its permissions", path.display())]
    Read { path: PathBuf, source: io::Error },
    /// What was asked for makes no sense.
    #[error("{0}")]
    Request(String),
    /// Scenes are neither merged nor in quarantine.
    #[error(
        "{missing} of {scenes} scenes are not merged yet: finish the run with `glasshouse work RUN` first, or export \
         what is there with --partial"
    )]
    Unfinished {
        /// Scenes that have no tuple and are not in quarantine.
        missing: usize,
        scenes: usize,
    },
    /// No scene has a tuple.
    #[error("there is nothing to export: {0}")]
    Nothing(String),
    /// A tuple of the run is not what it should be.
    #[error(
        "{file}: {reason}; `glasshouse audit` finds what else is damaged, `glasshouse retry` has it made anew"
    )]
    Damaged {
        /// Its key in the store.
        file: String,
        reason: String,
    },
    /// A picture cannot be encoded.
    #[error("cannot encode {name}: {reason}")]
    Encode { name: String, reason: String },
    /// The folder holds something else.
    #[error("{} {reason}; export into a new folder, or remove this one", out.display())]
    Foreign {
        out: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// Another process exports into the folder.
    #[error("another process is exporting into {}; wait for it, or stop it", out.display())]
    Busy { out: PathBuf },
}

/// For `map_err`: a file of the export that cannot be read.
pub(super) fn unreadable(path: &std::path::Path) -> impl FnOnce(io::Error) -> ExportError {
    let path = path.to_owned();
    move |source| ExportError::Read { path, source }
}
