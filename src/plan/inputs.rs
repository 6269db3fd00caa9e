//! How planning reads input files: from local folders, or from stores through the caller.

use std::io;
use std::path::Path;

/// Reads input files by path or URL (see [`render::line::is_url`]).
pub trait InputFiles: Sync {
    /// The whole file or object.
    fn read(&self, path: &Path) -> io::Result<Vec<u8>>;

    /// The first `count` bytes (fewer if the object is shorter) and the size of the object at a URL.
    fn read_start(&self, url: &Path, count: usize) -> io::Result<(Vec<u8>, u64)>;

    /// Paths of all objects below a URL, relative to it.
    fn list(&self, folder: &Path) -> Result<Vec<String>, StoreUnavailable>;

    /// `Ok` if the store failed, `Err` with the error of the file otherwise.
    fn store_failure(&self, error: io::Error) -> Result<StoreUnavailable, io::Error>;
}

/// A store does not respond.
#[derive(Debug, thiserror::Error)]
#[error(transparent)]
pub struct StoreUnavailable(pub Box<dyn std::error::Error + Send + Sync>);

/// Local folders only: URLs are refused.
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
    format!("{} is in an object store, which is not read here: copy it to a folder", url.display())
}
