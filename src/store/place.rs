//! The folder of a store on a local disk, which may be deleted, moved or replaced during a command.

use render::folder_lock::is_same;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

/// A folder, held open to recognise it.
pub(super) struct Place {
    pub(super) path: PathBuf,
    folder: File,
}

impl Place {
    pub(super) fn open(path: &Path) -> io::Result<Self> {
        Ok(Self { path: path.to_owned(), folder: File::open(path)? })
    }

    pub(super) fn is_same(&self) -> bool {
        is_same(&self.folder, &self.path)
    }
}
