//! The folder of a store on a local disk, which may be deleted, moved or replaced during a command.

use render::folder_lock::is_same;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

/// A folder, held open to recognise it.
pub(super) struct Place {
    pub(super) path: PathBuf,
    folder: File,
    /// False on a disk that cannot sync folders.
    syncs_folders: bool,
}

impl Place {
    pub(super) fn open(path: &Path, syncs_folders: bool) -> io::Result<Self> {
        Ok(Self { path: path.to_owned(), folder: File::open(path)?, syncs_folders })
    }

    /// Makes the bytes of a file durable that was put, where the put did not.
    pub(super) fn sync(&self, key: &str) -> io::Result<()> {
        if self.syncs_folders { Ok(()) } else { File::open(self.path.join(key))?.sync_all() }
    }

    /// True if this disk has hard links, by which the store puts an object at most once.
    pub(super) fn has_links(&self) -> bool {
        let tried = || -> io::Result<()> {
            let folder = tempfile::Builder::new().prefix(".tmp-link-").tempdir_in(&self.path)?;
            let [one, two] = ["one", "two"].map(|name| folder.path().join(name));
            File::create_new(&one)?;
            std::fs::hard_link(&one, &two)
        };
        tried().is_ok()
    }

    pub(super) fn is_same(&self) -> bool {
        is_same(&self.folder, &self.path)
    }
}
