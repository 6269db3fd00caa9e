//! Errors of developing a run.

use crate::made::MadeError;
use crate::run::AccessError;
use crate::store::StoreError;
use render::atomic_file::WriteError;
use std::io;
use std::path::PathBuf;

#[derive(Debug, thiserror::Error)]
pub enum DevelopError {
    #[error(transparent)]
    Write(#[from] WriteError),
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    Run(#[from] AccessError),
    #[error(transparent)]
    Made(#[from] MadeError),
    #[error("{} is a link, and photographs are not written through links; remove it, or give another --out", path.display())]
    Link { path: PathBuf },
    #[error("cannot read {}: {source}; check the folder and its permissions", path.display())]
    Read { path: PathBuf, source: io::Error },
    #[error(
        "{} is neither empty nor a folder of this run's photographs by this sensor: give a new folder with --out",
        out.display()
    )]
    Foreign { out: PathBuf },
    #[error("cannot start threads: {0}; give fewer with -j")]
    Threads(String),
    #[error(
        "{file}: {reason}; `glasshouse audit` finds other damage; `glasshouse retry --anew` resets the scene"
    )]
    Damaged {
        /// Key in the store.
        file: String,
        reason: String,
    },
    #[error(
        "scene {scene} has no layer input to photograph: render it with film.layers that list input"
    )]
    NoInput { scene: String },
    #[error("cannot encode a photograph of scene {scene}: {reason}")]
    Encode { scene: String, reason: String },
}

impl DevelopError {
    /// True if the error concerns one scene alone, so that the others can go on.
    pub(super) fn is_of_tuple(&self) -> bool {
        matches!(
            self,
            Self::Damaged { .. } | Self::NoInput { .. } | Self::Encode { .. } | Self::Link { .. }
        )
    }
}
