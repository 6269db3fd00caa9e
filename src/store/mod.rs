//! Where a run's objects are kept: on a local disk or in an object store, behind the same few calls.
//!
//! Keys are the names of a run directory's files. What a run makes is put once and never changed: a put that finds the
//! key taken compares, so that two machines that compute different bits are found out by the first object they share.

mod open;
mod times;

pub use open::StoreOptions;

use bytes::Bytes;
use futures_util::{StreamExt, TryStreamExt};
use object_store::path::Path as Key;
use object_store::{ObjectStore, ObjectStoreExt, PutMode, PutPayload};
use std::path::{Path, PathBuf};
use std::sync::{Arc, LazyLock};
use tokio::runtime::Runtime;

/// Runs everything that waits for a store, a queue or a browser. Two threads: they wait, they do not compute.
pub(crate) static RUNTIME: LazyLock<Runtime> = LazyLock::new(|| {
    tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .thread_name("io")
        .enable_all()
        .build()
        .expect("the system starts two threads")
});

/// Calls in flight at most, for one list of keys.
const CALLS_AT_ONCE: usize = 16;

/// A run's objects.
#[derive(Clone, Debug)]
pub struct Store {
    objects: Arc<dyn ObjectStore>,
    prefix: Key,
    /// What a user would call it.
    name: String,
    local: Option<PathBuf>,
}

/// What a put found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Put {
    /// The key was free.
    New,
    /// The same bytes were there.
    Same,
}

/// A store that cannot be used, or that holds other bytes.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The address means nothing.
    #[error("{address} is no store: {reason}; use a folder (buckets are not supported yet)")]
    Address {
        /// As given.
        address: String,
        /// Why.
        reason: String,
    },
    /// A call failed, also when tried again.
    #[error(
        "cannot {what} {key} in {store}: {source}; check its space, its permissions and the way to it"
    )]
    Call {
        /// `read`, `write`, ...
        what: &'static str,
        /// The object.
        key: String,
        /// The store.
        store: String,
        /// Why.
        source: Box<object_store::Error>,
    },
    /// Another process put other bytes there.
    #[error(
        "{key} in {store} holds other bytes ({there}) than this process made ({here}): two machines computed different \
         results, or the object was damaged; `glasshouse audit RUN --scene NAME` (the folder's name) tells which, then remove the wrong one"
    )]
    Differs {
        /// The object.
        key: String,
        /// The store.
        store: String,
        /// BLAKE3 of what was made here.
        here: String,
        /// BLAKE3 of what is there.
        there: String,
    },
}

impl Store {
    /// The folder of a run on a local disk.
    pub fn local(root: &Path) -> Result<Self, StoreError> {
        Self::open(&root.to_string_lossy(), &StoreOptions::default())
    }

    /// What a user would call it.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its folder, if it is on a local disk.
    pub fn local_root(&self) -> Option<&Path> {
        self.local.as_deref()
    }

    fn key(&self, key: &str) -> Key {
        key.split('/').fold(self.prefix.clone(), Key::join)
    }

    fn failed(&self, what: &'static str, key: &str, source: object_store::Error) -> StoreError {
        StoreError::Call {
            what,
            key: key.to_owned(),
            store: self.name.clone(),
            source: Box::new(source),
        }
    }

    /// Puts an object that is made once. On return it is durable. The same bytes may be there already; other bytes are
    /// an error and stay.
    pub fn create(&self, key: &str, bytes: &[u8]) -> Result<Put, StoreError> {
        RUNTIME.block_on(self.create_async(key, Bytes::copy_from_slice(bytes)))
    }

    /// [`Self::create`] of several, in no order, all at once.
    pub fn create_all(&self, objects: Vec<(String, Vec<u8>)>) -> Result<(), StoreError> {
        RUNTIME.block_on(async {
            futures_util::stream::iter(objects)
                .map(|(key, bytes)| async move { self.create_async(&key, bytes.into()).await })
                .buffer_unordered(CALLS_AT_ONCE)
                .try_for_each(|_| async { Ok(()) })
                .await
        })
    }

    async fn create_async(&self, key: &str, bytes: Bytes) -> Result<Put, StoreError> {
        let payload = PutPayload::from_bytes(bytes.clone());
        match self
            .objects
            .put_opts(&self.key(key), payload, PutMode::Create.into())
            .await
        {
            Ok(_) => Ok(Put::New),
            Err(
                object_store::Error::AlreadyExists { .. }
                | object_store::Error::Precondition { .. },
            ) => {
                let Some(there) = self.get_async(key).await? else {
                    // Removed in between: by a merge, whose tuple holds it.
                    return Ok(Put::Same);
                };
                if there == bytes {
                    return Ok(Put::Same);
                }
                let digest = |bytes: &[u8]| blake3::hash(bytes).to_hex()[..16].to_owned();
                Err(StoreError::Differs {
                    key: key.to_owned(),
                    store: self.name.clone(),
                    here: digest(&bytes),
                    there: digest(&there),
                })
            }
            Err(error) => match self.get_async(key).await {
                // Somebody else was first, and swept the unfinished rest of this put away.
                Ok(Some(there)) if there == bytes => Ok(Put::Same),
                _ => Err(self.failed("write", key, error)),
            },
        }
    }

    /// Puts an object whatever is there: a note that changes, or one that is known to be damaged.
    pub fn replace(&self, key: &str, bytes: &[u8]) -> Result<(), StoreError> {
        let payload = PutPayload::from_bytes(Bytes::copy_from_slice(bytes));
        RUNTIME
            .block_on(self.objects.put(&self.key(key), payload))
            .map(|_| ())
            .map_err(|e| self.failed("write", key, e))
    }

    /// An object's bytes, if it is there.
    pub fn get(&self, key: &str) -> Result<Option<Bytes>, StoreError> {
        RUNTIME.block_on(self.get_async(key))
    }

    async fn get_async(&self, key: &str) -> Result<Option<Bytes>, StoreError> {
        let found = async { self.objects.get(&self.key(key)).await?.bytes().await };
        match found.await {
            Ok(bytes) => Ok(Some(bytes)),
            Err(object_store::Error::NotFound { .. }) => Ok(None),
            Err(error) => Err(self.failed("read", key, error)),
        }
    }

    /// Several objects' bytes, in their order.
    pub fn get_all(&self, keys: &[String]) -> Result<Vec<Option<Bytes>>, StoreError> {
        RUNTIME.block_on(async {
            futures_util::stream::iter(keys)
                .map(|key| self.get_async(key))
                .buffered(CALLS_AT_ONCE)
                .try_collect()
                .await
        })
    }

    /// Keys below `folder` (with all folders in it), in no order; unfinished puts are not among them.
    pub fn list(&self, folder: &str) -> Result<Vec<String>, StoreError> {
        let prefix = self.key(folder);
        let skip = self.prefix.as_ref().len() + usize::from(!self.prefix.as_ref().is_empty());
        RUNTIME
            .block_on(
                self.objects
                    .list(Some(&prefix))
                    .map_ok(|meta| meta.location.as_ref()[skip..].to_owned())
                    .try_collect::<Vec<String>>(),
            )
            .map_err(|e| self.failed("list", folder, e))
    }

    /// Removes objects; those that are gone already do not matter.
    pub fn delete(&self, keys: &[String]) -> Result<(), StoreError> {
        let delete = |key: &String| {
            let (path, name) = (self.key(key), key.clone());
            async move {
                match self.objects.delete(&path).await {
                    Ok(()) | Err(object_store::Error::NotFound { .. }) => Ok(()),
                    Err(error) => Err(self.failed("remove", &name, error)),
                }
            }
        };
        RUNTIME.block_on(async {
            futures_util::stream::iter(keys)
                .map(delete)
                .buffer_unordered(CALLS_AT_ONCE)
                .try_for_each(|()| async { Ok(()) })
                .await
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_are_made_once() {
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
    fn listing_and_removing() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::local(dir.path()).unwrap();
        assert!(store.list("partials").unwrap().is_empty());
        let keys: Vec<String> = (0..40).map(|k| format!("partials/s/{k:06}.exr")).collect();
        store
            .create_all(
                keys.iter()
                    .map(|k| (k.clone(), k.clone().into_bytes()))
                    .collect(),
            )
            .unwrap();
        store.create("partials/t/000000.exr", b"t").unwrap();
        let mut found = store.list("partials/s").unwrap();
        found.sort();
        assert_eq!(found, keys);
        assert_eq!(store.list("partials").unwrap().len(), 41);
        let bytes = store.get_all(&keys).unwrap();
        assert!(
            bytes
                .iter()
                .zip(&keys)
                .all(|(b, k)| b.as_ref().unwrap() == k.as_bytes())
        );
        store.delete(&keys).unwrap();
        store.delete(&keys).unwrap();
        assert_eq!(store.list("partials").unwrap(), ["partials/t/000000.exr"]);
    }

    #[test]
    fn an_error_names_the_object_and_the_store() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::local(dir.path()).unwrap();
        crate::atomic_file::write(&dir.path().join("tuples"), b"a file").unwrap();
        let error = store
            .create("tuples/a/tuple.json", b"{}")
            .unwrap_err()
            .to_string();
        assert!(error.contains("tuples/a/tuple.json"), "{error}");
        assert!(error.contains(&*dir.path().to_string_lossy()), "{error}");
    }
}
