//! Reads scenes' input files from local folders or object stores.

use super::cache::{Cache, Entry};
use super::error::is_absent;
use super::patience::with_patience;
use super::{Key, RUNTIME, Store, StoreError, StoreOptions};
use bytes::Bytes;
use futures_util::TryStreamExt;
use object_store::{GetOptions, GetRange, ObjectStore};
use plan::{InputFiles, StoreUnavailable};
use std::collections::BTreeMap;
use std::io;
use std::path::Path;
use std::sync::Mutex;
use std::time::Duration;

/// Reader of input files by path or by URL.
#[derive(Debug, Default)]
pub struct Inputs {
    options: StoreOptions,
    cache: Option<Cache>,
    /// Open stores, one per bucket.
    buckets: Mutex<BTreeMap<String, Store>>,
}

/// Result of a request for an object.
enum Fetched {
    Absent,
    /// The object still has the given ETag.
    Unchanged,
    Object(Bytes, Option<String>),
}

impl Inputs {
    /// Returns a reader. `options` apply to all stores; `cache`, if given, keeps the objects.
    pub fn new(options: StoreOptions, cache: Option<Cache>) -> Self {
        Self { options, cache, buckets: Mutex::default() }
    }

    /// Reads a file, or an object if `path` is a URL ([`glasshouse_line::is_url`]).
    ///
    /// An absent object gives `NotFound`; other errors of a store contain a [`StoreError`].
    pub fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        let Some((url, bucket, key)) = parts(path) else {
            return render::input_file::read(path);
        };
        let store = self.bucket(bucket).map_err(io::Error::other)?;
        let kept = self.cache.as_ref().and_then(|cache| cache.get(url));
        let etag = kept.as_ref().map(|entry| entry.etag.clone());
        match store.fetch(&key, etag).map_err(io::Error::other)? {
            Fetched::Absent => {
                Err(io::Error::new(io::ErrorKind::NotFound, "the object does not exist"))
            }
            Fetched::Object(bytes, etag) => {
                let bytes = Vec::from(bytes);
                if let (Some(cache), Some(etag)) = (&self.cache, etag) {
                    cache.put(url, &etag, &bytes);
                }
                Ok(bytes)
            }
            Fetched::Unchanged => match kept {
                Some(Entry { bytes, .. }) => Ok(bytes),
                None => Err(io::Error::other("the store returned no bytes")),
            },
        }
    }

    /// Returns the first `count` bytes (or all) and the size of the object at the URL `path`. Does not cache a part.
    pub fn read_start(&self, path: &Path, count: usize) -> io::Result<(Vec<u8>, u64)> {
        if let Some((_, bucket, key)) = parts(path) {
            let store = self.bucket(bucket).map_err(io::Error::other)?;
            if let Some(found) = store.fetch_start(&key, count as u64) {
                return Ok(found);
            }
        }
        // An empty object has no range. For all other errors, a plain read gives the reason.
        let bytes = self.read(path)?;
        let size = bytes.len() as u64;
        Ok((bytes, size))
    }

    /// Returns the names of all objects below the URL `folder`, relative to this folder.
    pub fn list(&self, folder: &Path) -> Result<Vec<String>, StoreError> {
        let Some((_, bucket, key)) = parts(folder) else {
            return Err(StoreError::Address {
                address: folder.display().to_string(),
                reason: "a listing needs a URL".to_owned(),
            });
        };
        let found = self.bucket(bucket)?.list(&key)?;
        let skip = if key.is_empty() { 0 } else { key.len() + 1 };
        Ok(found.into_iter().map(|key| key[skip..].to_owned()).collect())
    }

    fn bucket(&self, address: &str) -> Result<Store, StoreError> {
        let mut buckets = self.buckets.lock().expect("no holder of this lock panics");
        if let Some(store) = buckets.get(address) {
            return Ok(store.clone());
        }
        let store = Store::open(address, &self.options)?;
        buckets.insert(address.to_owned(), store.clone());
        Ok(store)
    }
}

/// Splits a URL into the URL itself, its part up to the bucket, and its key. Returns `None` for a local path.
fn parts(path: &Path) -> Option<(&str, &str, String)> {
    let url = path.to_str().filter(|_| glasshouse_line::is_url(path))?;
    let start = url.find("://")? + 3;
    let end = url[start..].find('/').map_or(url.len(), |n| start + n);
    let names = url[end..].split('/');
    let names: Vec<&str> = names.filter(|name| !matches!(*name, "" | ".")).collect();
    Some((url, &url[..end], names.join("/")))
}

impl InputFiles for Inputs {
    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        Self::read(self, path)
    }

    fn read_start(&self, url: &Path, count: usize) -> io::Result<(Vec<u8>, u64)> {
        Self::read_start(self, url, count)
    }

    fn list(&self, folder: &Path) -> Result<Vec<String>, StoreUnavailable> {
        Self::list(self, folder).map_err(|error| StoreUnavailable(error.into()))
    }

    fn store_failure(&self, error: io::Error) -> Result<StoreUnavailable, io::Error> {
        let error = error.downcast::<StoreError>()?;
        Ok(StoreUnavailable(error.into()))
    }
}

impl Store {
    /// Reads an object by its literal key, unless it still has this ETag.
    fn fetch(&self, key: &str, etag: Option<String>) -> Result<Fetched, StoreError> {
        use object_store::Error as E;
        let path = Key::parse(key).map_err(|e| self.failed("read", key, &e.into()))?;
        let options = GetOptions { if_none_match: etag, ..GetOptions::default() };
        let get = || async {
            let found = self.objects.get_opts(&path, options.clone()).await?;
            let etag = found.meta.e_tag.clone();
            Ok((found.bytes().await?, etag))
        };
        match RUNTIME.block_on(with_patience(self.patience, get)) {
            Ok((bytes, etag)) => Ok(Fetched::Object(bytes, etag)),
            Err(E::NotModified { .. }) => Ok(Fetched::Unchanged),
            Err(error) if is_absent(&error) => self.absent(key),
            Err(error) => Err(self.failed("read", key, &error)),
        }
    }

    /// Returns the first bytes of an object and its size, or `None` on any error.
    fn fetch_start(&self, key: &str, count: u64) -> Option<(Vec<u8>, u64)> {
        let path = Key::parse(key).ok()?;
        let options =
            GetOptions { range: Some(GetRange::Bounded(0..count)), ..GetOptions::default() };
        let get = || async {
            let found = self.objects.get_opts(&path, options.clone()).await?;
            let size = found.meta.size;
            Ok((found.bytes().await?.to_vec(), size))
        };
        RUNTIME.block_on(with_patience(Duration::ZERO, get)).ok()
    }

    /// Returns `Absent` if the bucket exists, and otherwise an error, because a missing bucket concerns every scene.
    fn absent(&self, key: &str) -> Result<Fetched, StoreError> {
        let look = || async { self.objects.list(None).try_next().await };
        match RUNTIME.block_on(with_patience(self.patience, look)) {
            // `PermissionDenied` is rare here: if listing is not permitted, S3 reports absent objects as forbidden.
            Ok(_) | Err(object_store::Error::PermissionDenied { .. }) => Ok(Fetched::Absent),
            Err(error) => Err(self.failed("read", key, &error)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_url_has_a_bucket_and_a_key() {
        let parts = |text| parts(Path::new(text)).map(|(_, b, k)| (b.to_owned(), k));
        let some = |b: &str, k: &str| Some((b.to_owned(), k.to_owned()));
        assert_eq!(parts("s3://b/x/./a.png"), some("s3://b", "x/a.png"));
        assert_eq!(parts("s3://b"), some("s3://b", ""));
        assert_eq!(parts("s3://b/x/"), some("s3://b", "x"));
        assert_eq!(parts("/data/a.png"), None);
    }

    #[test]
    fn paths_are_read_from_the_disk() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a");
        render::atomic_file::write(&file, b"one").unwrap();
        let inputs = Inputs::default();
        assert_eq!(inputs.read(&file).unwrap(), b"one");
        let error = inputs.read(&folder.path().join("b")).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::NotFound);
        let error = inputs.read(Path::new("ftp://x/y")).unwrap_err();
        assert!(error.get_ref().unwrap().is::<StoreError>(), "{error}");
    }
}
