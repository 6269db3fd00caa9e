//! Lists objects with the times of their puts, or with tags of their content.

use super::patience::with_patience;
use super::{RUNTIME, Store, StoreError};
use futures_util::TryStreamExt;
use object_store::ObjectMeta;
use std::time::SystemTime;

impl Store {
    /// Works like [`Self::list`], and adds the time of each object's last put by the store's clock.
    pub fn list_times(&self, folder: &str) -> Result<Vec<(String, SystemTime)>, StoreError> {
        self.list_meta(folder, |key, meta| (key, SystemTime::from(meta.last_modified)))
    }

    /// Works like [`Self::list`], and adds the size of each object, bytes, and a text that changes with its content.
    pub(crate) fn list_tags(&self, folder: &str) -> Result<Vec<(String, u64, String)>, StoreError> {
        self.list_meta(folder, |key, meta| {
            let tag = meta.e_tag.unwrap_or_else(|| meta.last_modified.to_string());
            (key, meta.size, tag)
        })
    }

    fn list_meta<T: Send>(
        &self,
        folder: &str,
        of: impl Fn(String, ObjectMeta) -> T + Copy + Send,
    ) -> Result<Vec<T>, StoreError> {
        self.check_place()?;
        let prefix = self.key(folder);
        let skip = self.prefix.as_ref().len() + usize::from(!self.prefix.as_ref().is_empty());
        let list = || {
            let call = self.watch(folder);
            let found = self.objects.list(Some(&prefix));
            found
                .map_ok(move |meta| {
                    let _call = &call;
                    of(meta.location.as_ref()[skip..].to_owned(), meta)
                })
                .try_collect()
        };
        RUNTIME
            .block_on(with_patience(self.patience, list))
            .map_err(|e| self.failed("list", folder, &e))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn a_list_with_times_has_the_same_keys() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::local(folder.path()).unwrap();
        for key in ["a/b.json", "a/c/d.json", "e.json"] {
            store.create(key, b"{}").unwrap();
        }
        let mut listed = store.list("a").unwrap();
        let mut timed = store.list_times("a").unwrap();
        listed.sort();
        timed.sort();
        let keys: Vec<&String> = timed.iter().map(|(key, _)| key).collect();
        assert_eq!(keys, listed.iter().collect::<Vec<_>>());
        let age = timed[0].1.elapsed().unwrap_or_default();
        assert!(age < Duration::from_mins(1), "{age:?}");
    }
}
