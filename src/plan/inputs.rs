//! Where planning reads input files: folders of this machine, and whatever else the caller can read.

use std::io;
use std::path::Path;

/// Reads input files by path or URL ([`render::line::is_url`] tells which a path is).
pub trait InputFiles: Sync {
    /// The whole file or object.
    fn read(&self, path: &Path) -> io::Result<Vec<u8>>;

    /// The first `count` bytes of the object at a URL, all of it if it has no more, and its size.
    fn read_start(&self, url: &Path, count: usize) -> io::Result<(Vec<u8>, u64)>;

    /// Names of all objects below a URL, relative to it.
    fn list(&self, folder: &Path) -> Result<Vec<String>, StoreUnavailable>;

    /// Separates an error of the store, which says nothing about the file, from one of the file.
    fn store_failure(&self, error: io::Error) -> Result<StoreUnavailable, io::Error>;
}

/// A store that cannot be asked: nothing is known of its objects.
#[derive(Debug, thiserror::Error)]
#[error(transparent)]
pub struct StoreUnavailable(pub Box<dyn std::error::Error + Send + Sync>);

/// Folders of this machine alone.
#[derive(Clone, Copy, Debug, Default)]
pub struct LocalFiles;

impl InputFiles for LocalFiles {
    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        std::fs::read(path)
    }

    fn read_start(&self, url: &Path, _: usize) -> io::Result<(Vec<u8>, u64)> {
        Err(io::Error::other(no_store(url)))
    }

    fn list(&self, folder: &Path) -> Result<Vec<String>, StoreUnavailable> {
        Err(StoreUnavailable(no_store(folder).into()))
    }

    fn store_failure(&self, error: io::Error) -> Result<StoreUnavailable, io::Error> {
        Err(error)
    }
}

fn no_store(url: &Path) -> String {
    format!(
        "{} is in an object store, which is not read here: copy it to a folder",
        url.display()
    )
}
