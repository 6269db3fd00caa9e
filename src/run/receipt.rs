//! Who made a tuple, as its worker wrote it down. To show; nothing depends on it.

use super::attempts::WorkerName;
use super::keys;
use super::made_by::who_else;
use crate::store::{Store, StoreError};
use render::ids::SceneId;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// The schema name of a receipt.
pub(crate) const RECEIPT_SCHEMA: &str = "glasshouse.receipt/1";

/// `receipts/<scene>.json`; of one that is damaged or of another version, what can be read of it.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Receipt {
    /// `glasshouse.receipt/1`.
    #[serde(default)]
    pub schema: String,
    /// The scene.
    #[serde(default)]
    pub scene: Option<SceneId>,
    /// Who.
    #[serde(default)]
    pub worker: Option<String>,
    /// On which machine.
    #[serde(default)]
    pub host: Option<String>,
    /// With which version of the program.
    #[serde(default)]
    pub version: Option<String>,
    /// Others that made partials of it, as far as is known.
    #[serde(default, skip_serializing_if = "BTreeSet::is_empty")]
    pub with: BTreeSet<String>,
}

impl Receipt {
    /// For a tuple that `who` made, alone or with others, whose partials are still there.
    pub(crate) fn new(store: &Store, scene: &SceneId, who: &WorkerName, alone: bool) -> Self {
        Self {
            schema: RECEIPT_SCHEMA.to_owned(),
            scene: Some(scene.clone()),
            worker: Some(who.worker.clone()),
            host: Some(who.host.clone()),
            version: Some(env!("CARGO_PKG_VERSION").to_owned()),
            with: if alone {
                BTreeSet::new()
            } else {
                who_else(store, scene, None, &who.worker).unwrap_or_default()
            },
        }
    }

    /// Puts it. If another worker has made the same tuple, its receipt stands.
    pub(crate) fn put(&self, store: &Store, scene: &SceneId) -> Result<(), StoreError> {
        let mut json = serde_json::to_vec(self).expect("strings are JSON");
        json.push(b'\n');
        match store.create(&keys::receipt(scene), &json) {
            Ok(_) | Err(StoreError::Differs { .. }) => Ok(()),
            Err(error) => Err(error),
        }
    }

    /// Its worker and all that helped.
    pub fn workers(&self) -> impl Iterator<Item = &String> {
        self.worker.iter().chain(&self.with)
    }

    /// The same as text.
    pub fn makers(&self) -> String {
        let worker = self.worker.as_deref().unwrap_or("unknown");
        let with: Vec<&str> = self.with.iter().map(String::as_str).collect();
        if with.is_empty() {
            worker.to_owned()
        } else {
            format!("{worker} with {}", with.join(", "))
        }
    }

    pub(crate) fn parse(bytes: &[u8]) -> Self {
        serde_json::from_slice(bytes).unwrap_or_default()
    }

    /// The scene's receipt, if there is one.
    pub fn get(store: &Store, scene: &SceneId) -> Result<Option<Self>, StoreError> {
        let bytes = store.get(&keys::receipt(scene))?;
        Ok(bytes.map(|bytes| Self::parse(&bytes)))
    }
}
