//! Locks that exclude other processes from a folder.

use super::atomic_file::sync_dir;
use super::disk::{NO_LOCKS, OTHER_DISK, is_unimplemented};
use std::fs::{File, TryLockError};
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// A lock on a file, held until it is dropped. The operating system releases the lock of a killed process.
#[derive(Debug)]
pub struct FolderLock {
    file: File,
    path: PathBuf,
}

impl FolderLock {
    /// Locks the file `path`; returns `None` if another process holds the lock. Creates the file durably if it is absent:
    /// after a power cut, it shows that the folder belongs to the program.
    pub fn try_new(path: &Path) -> io::Result<Option<Self>> {
        loop {
            let is_new = !path.exists();
            let file = File::options().create(true).append(true).open(path)?;
            if let (true, Some(folder)) = (is_new, path.parent()) {
                sync_dir(folder)?;
            }
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => return Ok(None),
                Err(TryLockError::Error(error)) if is_unimplemented(&error) => {
                    let text = format!("{NO_LOCKS} ({error}): {OTHER_DISK}");
                    return Err(io::Error::new(io::ErrorKind::Unsupported, text));
                }
                Err(TryLockError::Error(error)) => return Err(error),
            }
            let lock = Self { file, path: path.to_owned() };
            // If another process removed the file before it was locked, the lock would exclude no other process.
            if lock.is_in_place() {
                return Ok(Some(lock));
            }
        }
    }

    /// Returns false if the file or its folder was deleted, moved or replaced, so that another process can lock it.
    pub fn is_in_place(&self) -> bool {
        is_same(&self.file, &self.path)
    }
}

/// Returns whether an open file or folder is still the one at `path`.
pub fn is_same(open: &File, path: &Path) -> bool {
    let identity = |metadata: io::Result<std::fs::Metadata>| {
        let metadata = metadata.ok()?;
        (metadata.nlink() > 0).then(|| (metadata.dev(), metadata.ino()))
    };
    let held = identity(open.metadata());
    held.is_some() && held == identity(std::fs::metadata(path))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn a_second_lock_is_refused_and_a_lost_one_is_noticed() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("run");
        fs::create_dir(&folder).unwrap();
        let path = folder.join("work.lock");
        let lock = FolderLock::try_new(&path).unwrap().unwrap();
        assert!(lock.is_in_place());
        assert!(FolderLock::try_new(&path).unwrap().is_none());
        let moved = dir.path().join("moved");
        fs::rename(&folder, &moved).unwrap();
        assert!(!lock.is_in_place());
        fs::create_dir(&folder).unwrap();
        let other = FolderLock::try_new(&path).unwrap().unwrap();
        assert!(!lock.is_in_place() && other.is_in_place());
        fs::remove_file(&path).unwrap();
        assert!(!other.is_in_place());
        drop(lock);
        assert!(FolderLock::try_new(&path).unwrap().is_some());
    }
}
