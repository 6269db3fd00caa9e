//! What runs need of a disk, and how a disk without it is named.

use rustix::io::Errno;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// A disk such as Lustre without its option `flock`.
pub const NO_LOCKS: &str = "locks do not work, so two programs could work on one run";
/// A disk such as exFAT, or a mounted bucket.
pub const NO_LINKS: &str = "hard links do not work";
/// A disk such as CIFS before Linux 4.17, or vboxsf.
pub const NO_FOLDER_SYNC: &str = "folders cannot be synced, so a power cut may lose the newest files; run the command again after one";
/// The remedy for disks without locks or links.
pub const OTHER_DISK: &str =
    "use another disk for runs; a bucket with --store does not need these guarantees";

/// The first folder that could not be synced.
static UNSYNCED: OnceLock<PathBuf> = OnceLock::new();

/// True if an error says that the disk does not implement a call.
pub fn is_unimplemented(error: &io::Error) -> bool {
    let code = error.raw_os_error().map(Errno::from_raw_os_error);
    matches!(code, Some(Errno::INVAL | Errno::NOSYS | Errno::NOTSUP | Errno::NOLCK))
}

/// Makes a new name, a rename or a removal inside `folder` durable. On a disk that does not implement this, returns false.
pub fn sync_folder(folder: &Path) -> io::Result<bool> {
    match std::fs::File::open(folder)?.sync_all() {
        Err(error) if is_unimplemented(&error) => {
            UNSYNCED.get_or_init(|| folder.to_owned());
            Ok(false)
        }
        Err(error) => Err(error),
        Ok(()) => Ok(true),
    }
}

/// Returns the first folder that could not be synced, as its disk does not implement it.
pub fn unsynced_folder() -> Option<&'static Path> {
    UNSYNCED.get().map(PathBuf::as_path)
}
