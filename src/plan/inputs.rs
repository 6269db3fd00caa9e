//! Reads input files for planning: from local folders, or from stores through the caller.

use render::file_tree::is_resource;
use std::io;
use std::path::Path;

/// Access to input files by path or URL (see [`glasshouse_line::is_url`]).
pub trait InputFiles: Sync {
    /// Reads a whole file or object.
    fn read(&self, path: &Path) -> io::Result<Vec<u8>>;

    /// Reads the first `count` bytes of the object at a URL (fewer if the object is shorter). Also returns its size.
    fn read_start(&self, url: &Path, count: usize) -> io::Result<(Vec<u8>, u64)>;

    /// Lists the paths of all objects below a URL, relative to the URL.
    fn list(&self, folder: &Path) -> Result<Vec<String>, StoreUnavailable>;

    /// Returns `Ok` if the store failed, and the file's own error as `Err` otherwise.
    fn store_failure(&self, error: io::Error) -> Result<StoreUnavailable, io::Error>;
}

/// Error of a store that does not respond.
#[derive(Debug, thiserror::Error)]
#[error(transparent)]
pub struct StoreUnavailable(pub Box<dyn std::error::Error + Send + Sync>);

/// Access to local folders only; a URL is an error.
#[derive(Clone, Copy, Debug, Default)]
pub struct LocalFiles;

impl InputFiles for LocalFiles {
    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        render::input_file::read(path)
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

/// Lists the paths of all objects below a URL that may be inputs, without thumbnails and resources.
pub(super) fn list_objects(
    folder: &Path,
    inputs: &dyn InputFiles,
) -> Result<Vec<String>, StoreUnavailable> {
    let mut paths = inputs.list(folder)?;
    paths.retain(|path| !is_resource(path));
    Ok(paths)
}

fn no_store(url: &Path) -> String {
    format!("{} is in an object store, not in a folder: copy it to a folder", url.display())
}
