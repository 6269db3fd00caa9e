//! From what a user writes to a store.

use super::{Key, Store, StoreError};
use object_store::local::LocalFileSystem;
use std::path::Path;
use std::sync::Arc;

/// Settings of a store that is not a folder.
#[derive(Clone, Debug, Default)]
pub struct StoreOptions {
    /// Names and values as object_store has them (`aws_endpoint`, ...).
    pub settings: Vec<(String, String)>,
}

impl Store {
    /// A folder, `file:///…`, or a URL of an object store.
    pub fn open(address: &str, options: &StoreOptions) -> Result<Self, StoreError> {
        let invalid = |reason: String| StoreError::Address {
            address: address.to_owned(),
            reason,
        };
        let folder = match address.split_once("://") {
            None => address,
            Some(("file", path)) => path,
            Some(_) => return Self::open_url(address, options),
        };
        let path = Path::new(folder);
        std::fs::create_dir_all(path).map_err(|e| invalid(e.to_string()))?;
        let root = path.canonicalize().map_err(|e| invalid(e.to_string()))?;
        let objects = LocalFileSystem::new_with_prefix(&root)
            .map_err(|e| invalid(e.to_string()))?
            .with_fsync(true);
        Ok(Self {
            objects: Arc::new(objects),
            prefix: Key::default(),
            name: path.display().to_string(),
            local: Some(path.to_owned()),
        })
    }

    fn open_url(address: &str, options: &StoreOptions) -> Result<Self, StoreError> {
        let invalid = |reason: String| StoreError::Address {
            address: address.to_owned(),
            reason,
        };
        let url = url::Url::parse(address).map_err(|e| invalid(e.to_string()))?;
        let (objects, prefix) = object_store::parse_url_opts(&url, options.settings.clone())
            .map_err(|e| invalid(e.to_string()))?;
        Ok(Self {
            objects: Arc::from(objects),
            prefix,
            name: address.trim_end_matches('/').to_owned(),
            local: None,
        })
    }
}
