//! Lists objects with the times of their puts.

use super::patience::with_patience;
use super::{RUNTIME, Store, StoreError};
use futures_util::TryStreamExt;
use std::time::SystemTime;

impl Store {
    /// Works like [`Self::list`], and adds the time of each object's last put by the store's clock.
    pub fn list_times(&self, folder: &str) -> Result<Vec<(String, SystemTime)>, StoreError> {
        self.check_place()?;
        let prefix = self.key(folder);
        let skip = self.prefix.as_ref().len() + usize::from(!self.prefix.as_ref().is_empty());
        let list = || {
            let call = self.watch(folder);
            let found = self.objects.list(Some(&prefix));
            found
                .map_ok(move |meta| {
                    let _call = &call;
                    let key = meta.location.as_ref()[skip..].to_owned();
                    (key, SystemTime::from(meta.last_modified))
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
