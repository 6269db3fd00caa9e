//! Who made a tuple, as its worker wrote it down. To show; nothing depends on it.

use super::keys;
use crate::ids::SceneId;
use crate::store::{Store, StoreError};
use serde::{Deserialize, Serialize};

/// `receipts/<scene>.json`; of one that is damaged or of another version, what can be read of it.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Receipt {
    /// Who.
    #[serde(default)]
    pub worker: Option<String>,
    /// With which version of the program.
    #[serde(default)]
    pub version: Option<String>,
}

impl Receipt {
    pub(super) fn parse(bytes: &[u8]) -> Self {
        serde_json::from_slice(bytes).unwrap_or_default()
    }

    /// The scene's receipt, if there is one.
    pub fn get(store: &Store, scene: &SceneId) -> Result<Option<Self>, StoreError> {
        let bytes = store.get(&keys::receipt(scene))?;
        Ok(bytes.map(|bytes| Self::parse(&bytes)))
    }
}
