//! The store of a run's objects: a local disk or an object store, behind the same few calls.
//!
//! Keys are the paths of files in a run's folder. Results are put once and never changed: a put to an existing key
//! compares the bytes, so that the first shared object exposes two machines that compute different bits.

mod cache;
mod error;
mod inputs;
mod open;
mod patience;
mod place;
mod times;

pub use cache::Cache;
pub use error::StoreError;
pub use inputs::Inputs;
pub use open::StoreOptions;

use bytes::Bytes;
use error::{describe, is_absent, is_cleared_away, is_passing};
use futures_util::{StreamExt, TryStreamExt};
use object_store::path::Path as Key;
use object_store::{ObjectStore, ObjectStoreExt, PutMode, PutPayload};
use patience::{Tries, with_patience};
use place::Place;
use render::disk::{NO_LINKS, OTHER_DISK};
use render::input_file::Call;
use std::path::Path;
use std::sync::{Arc, LazyLock};
use std::time::Duration;
use tokio::runtime::Runtime;

/// Runtime of all tasks that wait for a store, a queue or a browser. Two threads suffice, because no task computes.
pub(crate) static RUNTIME: LazyLock<Runtime> = LazyLock::new(|| {
    tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .thread_name("io")
        .enable_all()
        .build()
        .expect("the system starts two threads")
});

/// Largest number of concurrent calls for one list of keys.
const CALLS_AT_ONCE: usize = 16;

/// Largest number of repetitions of a put after another process removed the put's unfinished file.
const CLEARED_AWAY: u32 = 3;

#[derive(Clone)]
pub struct Store {
    objects: Arc<dyn ObjectStore>,
    prefix: Key,
    /// Address of the store, for messages.
    name: String,
    local: Option<Arc<Place>>,
    /// True if the path of the local folder is not UTF-8.
    is_oddly_named: bool,
    /// Time for which a failed call is repeated.
    patience: Duration,
}

impl std::fmt::Debug for Store {
    /// Prints only the name, because the output of object_store may contain a part of the credentials.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("Store").field(&self.name).finish()
    }
}

/// Result of a put.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Put {
    /// The key was free.
    New,
    /// The key existed with the same bytes.
    Same,
}

impl Store {
    /// Opens the folder of a run on a local disk.
    pub fn local(root: &Path) -> Result<Self, StoreError> {
        Self::open_folder(root, StoreOptions::default().patience)
    }

    /// Returns the store's address, for messages.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns the same store with another patience, for calls that are not worth waiting for.
    #[must_use]
    pub fn with_patience(&self, patience: Duration) -> Self {
        Self { patience, ..self.clone() }
    }

    /// Returns the store's folder, if it is on a local disk.
    pub fn local_root(&self) -> Option<&Path> {
        self.local.as_ref().map(|place| place.path.as_path())
    }

    /// Fails if the store's folder was deleted, moved or replaced since the store was opened. Every call checks this
    /// first, because it would create the folder again, or read another one.
    pub(crate) fn check_place(&self) -> Result<(), StoreError> {
        match &self.local {
            Some(place) if !place.is_same() => Err(StoreError::Gone { store: self.name.clone() }),
            _ => Ok(()),
        }
    }

    /// True if the store is a folder, where reading is cheap.
    pub(crate) fn is_local(&self) -> bool {
        self.local.is_some()
    }

    /// Returns the shortest time between two reads of an object that may change. Requests to a bucket cost money.
    pub(crate) fn poll_interval(&self) -> Duration {
        Duration::from_secs(if self.is_local() { 2 } else { 5 })
    }

    /// Makes a read of a local disk visible until the returned value is dropped.
    fn watch(&self, key: &str) -> Option<Call> {
        self.local_root().map(|root| Call::begin(&root.join(key)))
    }

    fn key(&self, key: &str) -> Key {
        key.split('/').fold(self.prefix.clone(), Key::join)
    }

    /// Makes a put durable on a disk that cannot sync folders.
    fn sync(&self, key: &str) -> Result<(), StoreError> {
        let Some(place) = &self.local else { return Ok(()) };
        place.sync(key).map_err(|error| StoreError::Call {
            what: "write",
            key: key.to_owned(),
            store: self.name.clone(),
            reason: error.to_string(),
            passing: false,
        })
    }

    fn failed(&self, what: &'static str, key: &str, error: &object_store::Error) -> StoreError {
        if let Err(gone) = self.check_place() {
            return gone;
        }
        let mut reason = describe(error);
        if what == "write" && self.local.as_ref().is_some_and(|place| !place.has_links()) {
            reason = format!("{NO_LINKS} ({reason}): {OTHER_DISK}");
        }
        StoreError::Call {
            what,
            key: key.to_owned(),
            store: self.name.clone(),
            reason,
            passing: is_passing(error),
        }
    }

    /// Puts an object that never changes. On return, the object is durable. If the key exists with other bytes, they
    /// stay, and the call fails.
    pub fn create(&self, key: &str, bytes: &[u8]) -> Result<Put, StoreError> {
        self.create_bytes(key, Bytes::copy_from_slice(bytes))
    }

    /// Works like [`Self::create`] without copying the bytes.
    pub fn create_bytes(&self, key: &str, bytes: Bytes) -> Result<Put, StoreError> {
        RUNTIME.block_on(self.create_async(key, bytes))
    }

    /// Works like [`Self::create`] for several objects concurrently, in any order.
    pub fn create_all(&self, objects: Vec<(String, Bytes)>) -> Result<(), StoreError> {
        RUNTIME.block_on(async {
            futures_util::stream::iter(objects)
                .map(|(key, bytes)| async move { self.create_async(&key, bytes).await })
                .buffer_unordered(CALLS_AT_ONCE)
                .try_for_each(|_| async { Ok(()) })
                .await
        })
    }

    async fn create_async(&self, key: &str, bytes: Bytes) -> Result<Put, StoreError> {
        use object_store::Error as E;
        self.check_place()?;
        let path = self.key(key);
        let mut tries = Tries::new(self.patience);
        let mut cleared_away = 0;
        loop {
            // object_store panics if it refuses an existing file whose path is not UTF-8.
            if self.is_oddly_named
                && let Some(there) = self.get_async(key).await?
            {
                return self.compare(key, &bytes, &there);
            }
            let payload = PutPayload::from_bytes(bytes.clone());
            let put = self.objects.put_opts(&path, payload, PutMode::Create.into());
            let error = match put.await {
                Ok(_) => {
                    // The folder may have been moved during the put.
                    self.check_place()?;
                    self.sync(key)?;
                    return Ok(Put::New);
                }
                // If only the answer was lost, the next put finds the same bytes under the key.
                Err(error) if is_passing(&error) => error,
                Err(error @ (E::AlreadyExists { .. } | E::Precondition { .. })) => {
                    match self.get_async(key).await? {
                        Some(there) => return self.compare(key, &bytes, &there),
                        // The object is gone again, or (S3's 409) another put is in progress and may still fail.
                        None => error,
                    }
                }
                Err(error) => match self.get_async(key).await {
                    // Another process was first, and removed the unfinished file of this put.
                    Ok(Some(there)) if there == bytes => return Ok(Put::Same),
                    // A finished run is cleaned up once. A finished scene is cleaned up once by each worker that
                    // finished it.
                    Ok(None) if cleared_away < CLEARED_AWAY && is_cleared_away(&error) => {
                        cleared_away += 1;
                        continue;
                    }
                    _ => return Err(self.failed("write", key, &error)),
                },
            };
            if !tries.wait().await {
                return Err(self.failed("write", key, &error));
            }
        }
    }

    fn compare(&self, key: &str, here: &[u8], there: &[u8]) -> Result<Put, StoreError> {
        if here == there {
            return Ok(Put::Same);
        }
        let digest = |bytes: &[u8]| blake3::hash(bytes).to_hex()[..16].to_owned();
        Err(StoreError::Differs {
            key: key.to_owned(),
            store: self.name.clone(),
            here: digest(here),
            there: digest(there),
        })
    }

    /// Puts an object that may change, such as a record, and replaces an existing one. Results need [`Self::create`].
    pub fn replace(&self, key: &str, bytes: &[u8]) -> Result<(), StoreError> {
        let (path, payload) = (self.key(key), PutPayload::from(bytes.to_vec()));
        let mut cleared_away = 0;
        loop {
            self.check_place()?;
            let put = with_patience(self.patience, || self.objects.put(&path, payload.clone()));
            match RUNTIME.block_on(put) {
                Ok(_) => return self.sync(key),
                // Another process removed the unfinished file of this put at the end of the run.
                Err(error) if cleared_away < CLEARED_AWAY && is_cleared_away(&error) => {
                    cleared_away += 1;
                }
                Err(error) => return Err(self.failed("write", key, &error)),
            }
        }
    }

    /// Returns the bytes of an object, if the object exists.
    pub fn get(&self, key: &str) -> Result<Option<Bytes>, StoreError> {
        RUNTIME.block_on(self.get_async(key))
    }

    async fn get_async(&self, key: &str) -> Result<Option<Bytes>, StoreError> {
        self.check_place()?;
        let path = self.key(key);
        let get = || async {
            let _call = self.watch(key);
            self.objects.get(&path).await?.bytes().await
        };
        match with_patience(self.patience, get).await {
            Ok(bytes) => Ok(Some(bytes)),
            Err(error) if is_absent(&error) => Ok(None),
            Err(error) => Err(self.failed("read", key, &error)),
        }
    }

    /// Returns the bytes of several objects in the order of `keys`; `None` for absent objects.
    pub fn get_all(&self, keys: &[String]) -> Result<Vec<Option<Bytes>>, StoreError> {
        RUNTIME.block_on(async {
            futures_util::stream::iter(keys)
                .map(|key| self.get_async(key))
                .buffered(CALLS_AT_ONCE)
                .try_collect()
                .await
        })
    }

    /// Reads objects in the order of `keys` and passes each to `take` with its index; few are in memory at once. `take`
    /// must not call a store.
    pub(crate) fn for_each(
        &self,
        keys: &[String],
        mut take: impl FnMut(usize, Option<Bytes>),
    ) -> Result<(), StoreError> {
        RUNTIME.block_on(async {
            let reads = futures_util::stream::iter(keys).map(|key| self.get_async(key));
            let mut objects = reads.buffered(CALLS_AT_ONCE).enumerate();
            while let Some((index, bytes)) = objects.next().await {
                take(index, bytes?);
            }
            Ok(())
        })
    }

    /// True if all of these files are in `folder`.
    pub(crate) fn has_files(&self, folder: &str, files: &[String]) -> Result<bool, StoreError> {
        self.check_place()?;
        if let Some(root) = self.local_root() {
            let folder = root.join(folder);
            return Ok(files.iter().all(|file| folder.join(file).is_file()));
        }
        let listed = self.list(folder)?;
        let is_listed = |file: &String| listed.contains(&format!("{folder}/{file}"));
        Ok(files.iter().all(is_listed))
    }

    /// Removes all objects below `folder`. On a disk, also removes the folder itself, and ignores errors.
    pub(crate) fn remove_folder(&self, folder: &str) -> Result<(), StoreError> {
        self.check_place()?;
        if let Some(root) = self.local_root() {
            let _ = std::fs::remove_dir_all(root.join(folder));
            return Ok(());
        }
        self.delete(&self.list(folder)?)
    }

    /// Returns the keys below `folder`, recursively and in any order, without unfinished puts.
    pub fn list(&self, folder: &str) -> Result<Vec<String>, StoreError> {
        let listed = self.list_times(folder)?.into_iter();
        Ok(listed.map(|(key, _)| key).collect())
    }

    /// Removes objects, in any order. Ignores absent ones.
    pub fn delete(&self, keys: &[String]) -> Result<(), StoreError> {
        self.check_place()?;
        let paths: Vec<Key> = keys.iter().map(|key| self.key(key)).collect();
        let delete = || async {
            let paths = futures_util::stream::iter(paths.clone()).map(Ok);
            let mut removed = self.objects.delete_stream(paths.boxed());
            while let Some(result) = removed.next().await {
                match result {
                    Err(error) if !is_absent(&error) => return Err(error),
                    _ => {}
                }
            }
            Ok(())
        };
        RUNTIME.block_on(with_patience(self.patience, delete)).map_err(|e| {
            let first = keys.first().map_or("nothing", String::as_str);
            self.failed("remove", first, &e)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_are_created_once() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::local(dir.path()).unwrap();
        assert_eq!(store.get("a/b.json").unwrap(), None);
        assert_eq!(store.create("a/b.json", b"one").unwrap(), Put::New);
        assert_eq!(store.create("a/b.json", b"one").unwrap(), Put::Same);
        let error = store.create("a/b.json", b"two").unwrap_err();
        assert!(matches!(error, StoreError::Differs { .. }), "{error}");
        assert_eq!(store.get("a/b.json").unwrap().unwrap(), "one");
        assert_eq!(std::fs::read(dir.path().join("a/b.json")).unwrap(), b"one");
        store.replace("a/b.json", b"two").unwrap();
        assert_eq!(store.get("a/b.json").unwrap().unwrap(), "two");
    }

    #[test]
    fn objects_are_listed_and_removed() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::local(dir.path()).unwrap();
        assert!(store.list("partials").unwrap().is_empty());
        let keys: Vec<String> = (0..40).map(|k| format!("partials/s/{k:06}.exr")).collect();
        store.create_all(keys.iter().map(|k| (k.clone(), k.clone().into())).collect()).unwrap();
        store.create("partials/t/000000.exr", b"t").unwrap();
        let mut found = store.list("partials/s").unwrap();
        found.sort();
        assert_eq!(found, keys);
        assert_eq!(store.list("partials").unwrap().len(), 41);
        let bytes = store.get_all(&keys).unwrap();
        assert!(bytes.iter().zip(&keys).all(|(b, k)| b.as_ref().unwrap() == k.as_bytes()));
        store.delete(&keys).unwrap();
        store.delete(&keys).unwrap();
        assert_eq!(store.list("partials").unwrap(), ["partials/t/000000.exr"]);
    }

    #[test]
    fn folders_are_checked_and_removed() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::local(dir.path()).unwrap();
        let keys = ["t/a.exr", "t/b.json"].map(str::to_owned);
        for key in &keys {
            store.create(key, key.as_bytes()).unwrap();
        }
        let files = |names: &[&str]| names.iter().map(|n| (*n).to_owned()).collect::<Vec<_>>();
        assert!(store.has_files("t", &files(&["a.exr", "b.json"])).unwrap());
        assert!(!store.has_files("t", &files(&["a.exr", "c.json"])).unwrap());
        let asked = [keys[1].clone(), "t/none".to_owned(), keys[0].clone()];
        let mut found = Vec::new();
        store.for_each(&asked, |index, bytes| found.push((index, bytes))).unwrap();
        let of = |index: usize| Some(Bytes::copy_from_slice(asked[index].as_bytes()));
        assert_eq!(found, [(0, of(0)), (1, None), (2, of(2))]);
        store.remove_folder("t").unwrap();
        store.remove_folder("t").unwrap();
        assert!(store.list("t").unwrap().is_empty());
    }

    #[test]
    fn an_error_names_the_object_and_the_store() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::local(dir.path()).unwrap();
        render::atomic_file::write(&dir.path().join("tuples"), b"a file").unwrap();
        let error = store.create("tuples/a/tuple.json", b"{}").unwrap_err().to_string();
        assert!(error.contains("tuples/a/tuple.json"), "{error}");
        assert!(error.contains(&*dir.path().to_string_lossy()), "{error}");
    }
}
