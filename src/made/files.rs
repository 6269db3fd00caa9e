//! Files of a folder, or objects of a store, with stamps that tell whether they may have changed.

use crate::store::{Store, StoreError};
use render::input_file::InputFile;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::Metadata;
use std::io::{self, ErrorKind, Read};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Age below which a file may change and keep its stamp, for times in steps below 1 ms, which a clock of at most 10 ms rounds, and for
/// other times: FAT has steps of 2 s.
const UNSETTLED: [Duration; 2] = [Duration::from_millis(100), Duration::from_secs(2)];
/// Bytes of one read.
const READ_BYTES: usize = 1 << 17;

#[derive(Debug, thiserror::Error)]
pub enum MadeError {
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error("cannot read {}: {source}; check the file and its permissions", path.display())]
    Read { path: PathBuf, source: io::Error },
}

/// State of a file: its size, the times of modification and of the last change of its inode (ns since 1970), and the inode; or an
/// object's size and tag.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Stamp(u64, String);

impl Stamp {
    fn of_file(metadata: &Metadata) -> Self {
        let ns = |s: i64, ns: i64| i128::from(s) * 1_000_000_000 + i128::from(ns);
        let modified = ns(metadata.mtime(), metadata.mtime_nsec());
        let changed = ns(metadata.ctime(), metadata.ctime_nsec());
        Self(metadata.len(), format!("{modified} {changed} {}", metadata.ino()))
    }

    /// True unless the file changed a moment ago. An object's tag belongs to its bytes.
    pub(super) fn is_settled(&self) -> bool {
        let mut times = self.1.split(' ');
        let (Some(_), Some(changed), Some(_)) = (times.next(), times.next(), times.next()) else {
            return true;
        };
        let changed_ns: u64 = changed.parse().unwrap_or(0);
        let changed = UNIX_EPOCH + Duration::from_nanos(changed_ns);
        let unsettled = UNSETTLED[usize::from(changed_ns.is_multiple_of(1_000_000))];
        // A time in the future is that of another machine's clock.
        SystemTime::now().duration_since(changed).is_ok_and(|age| age > unsettled)
    }
}

/// Where the files of results or inputs are.
pub(crate) enum Files<'a> {
    Folder {
        /// What tells them from other files in the memory of digests.
        what: &'static str,
        root: &'a Path,
    },
    /// Objects of a bucket, with their stamps.
    Bucket { store: &'a Store, listed: BTreeMap<String, Stamp> },
}

impl<'a> Files<'a> {
    /// Files that results were made of.
    pub(crate) fn inputs(root: &'a Path) -> Self {
        Self::Folder { what: "of", root }
    }

    /// The results' own files.
    pub(crate) fn results(root: &'a Path) -> Self {
        Self::Folder { what: "made", root }
    }

    /// Objects that results were made of, below `folder` of a run's store.
    pub(crate) fn objects(store: &'a Store, folder: &str) -> Result<Self, MadeError> {
        store.check_place()?;
        if let Some(root) = store.local_root() {
            return Ok(Self::inputs(root));
        }
        let listed = store.list_tags(folder)?.into_iter();
        let listed = listed.map(|(key, bytes, tag)| (key, Stamp(bytes, tag))).collect();
        Ok(Self::Bucket { store, listed })
    }

    /// Name in the memory of digests.
    pub(super) fn key(&self, name: &str) -> String {
        match self {
            Self::Folder { what, .. } => format!("{what} {name}"),
            Self::Bucket { .. } => format!("of {name}"),
        }
    }

    /// Returns a file's present stamp; `None` if it does not exist.
    pub(crate) fn stamp(&self, name: &str) -> Result<Option<Stamp>, MadeError> {
        match self {
            Self::Bucket { listed, .. } => Ok(listed.get(name).cloned()),
            Self::Folder { root, .. } => {
                let path = root.join(name);
                match std::fs::metadata(&path) {
                    Ok(metadata) => Ok(Some(Stamp::of_file(&metadata))),
                    Err(error) => absent(error, path),
                }
            }
        }
    }

    pub(super) fn digest(&self, name: &str) -> Result<Option<String>, MadeError> {
        match self {
            Self::Bucket { store, .. } => Ok(store.get(name)?.map(|bytes| super::digest(&bytes))),
            Self::Folder { root, .. } => {
                let path = root.join(name);
                match digest_of(&path) {
                    Ok(digest) => Ok(Some(digest)),
                    Err(error) => absent(error, path),
                }
            }
        }
    }
}

/// Returns `None` if the error says that there is no such file. A folder in its place is no file, either.
fn absent<T>(source: io::Error, path: PathBuf) -> Result<Option<T>, MadeError> {
    match source.kind() {
        ErrorKind::NotFound | ErrorKind::NotADirectory | ErrorKind::IsADirectory => Ok(None),
        _ => Err(MadeError::Read { path, source }),
    }
}

/// Digests a file of any size.
fn digest_of(path: &Path) -> io::Result<String> {
    let mut file = InputFile::open(path)?;
    let mut hasher = blake3::Hasher::new();
    let mut buffer = vec![0; READ_BYTES];
    loop {
        match file.read(&mut buffer)? {
            0 => return Ok(hasher.finalize().to_hex().to_string()),
            count => hasher.update(&buffer[..count]),
        };
    }
}
