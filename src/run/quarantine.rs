//! Scenes in quarantine, with reasons: they cannot be traced or merged, and the run continues without them.

use super::keys;
use crate::store::{Store, StoreError};
use crate::text::without_credentials;
use glasshouse_line::ids::SceneId;
use serde::{Deserialize, Serialize};

/// Schema of a [`QuarantineRecord`].
pub const QUARANTINE_SCHEMA: &str = "glasshouse.quarantine/1";

/// Content of `quarantine/<scene>.json`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct QuarantineRecord {
    /// Always [`QUARANTINE_SCHEMA`].
    pub schema: String,
    pub scene: SceneId,
    /// Error that put the scene into quarantine, such as the error of an input file, with a remedy.
    pub reason: String,
}

impl QuarantineRecord {
    /// Puts a record. If another worker was first, its record stays.
    pub fn put(store: &Store, scene: &SceneId, reason: &str) -> Result<(), StoreError> {
        let record = Self {
            schema: QUARANTINE_SCHEMA.to_owned(),
            scene: scene.clone(),
            reason: without_credentials(reason.into()).into_owned(),
        };
        let mut json = serde_json::to_string_pretty(&record).expect("strings are JSON");
        json.push('\n');
        match store.create(&keys::quarantine(scene), json.as_bytes()) {
            Ok(_) | Err(StoreError::Differs { .. }) => Ok(()),
            Err(error) => Err(error),
        }
    }

    pub fn get(store: &Store, scene: &SceneId) -> Result<Option<Self>, StoreError> {
        let bytes = store.get(&keys::quarantine(scene))?;
        Ok(bytes.map(|bytes| Self::parse(scene, &bytes)))
    }

    /// Parses a record. A damaged record keeps its scene in quarantine, with its damage as the reason.
    fn parse(scene: &SceneId, bytes: &[u8]) -> Self {
        serde_json::from_slice(bytes).unwrap_or_else(|e| Self {
            schema: QUARANTINE_SCHEMA.to_owned(),
            scene: scene.clone(),
            reason: format!("the quarantine record is damaged ({e}); delete it to try again"),
        })
    }
}
