//! Scenes that cannot be done, each with its reason; the farm goes on without them.

use super::keys;
use super::run_dir::RunDir;
use crate::store::{Store, StoreError};
use render::ids::SceneId;
use serde::{Deserialize, Serialize};

/// The schema name of a quarantine record.
pub const QUARANTINE_SCHEMA: &str = "glasshouse.quarantine/1";

/// `quarantine/<scene>.json`
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct QuarantineRecord {
    /// Always [`QUARANTINE_SCHEMA`].
    pub schema: String,
    /// The scene.
    pub scene: SceneId,
    /// What happened, to which file, and what to do.
    pub reason: String,
}

impl QuarantineRecord {
    /// Puts the record. If another worker was first, its reason stands.
    pub fn put(store: &Store, scene: &SceneId, reason: &str) -> Result<(), StoreError> {
        let record = Self {
            schema: QUARANTINE_SCHEMA.to_owned(),
            scene: scene.clone(),
            reason: reason.to_owned(),
        };
        let mut json = serde_json::to_string_pretty(&record).expect("strings are JSON");
        json.push('\n');
        match store.create(&keys::quarantine(scene), json.as_bytes()) {
            Ok(_) | Err(StoreError::Differs { .. }) => Ok(()),
            Err(error) => Err(error),
        }
    }

    /// The scene's record in a store, if it is in quarantine.
    pub fn get(store: &Store, scene: &SceneId) -> Result<Option<Self>, StoreError> {
        let bytes = store.get(&keys::quarantine(scene))?;
        Ok(bytes.map(|bytes| Self::parse(scene, &bytes)))
    }

    /// A damaged record counts, with that as its reason.
    fn parse(scene: &SceneId, bytes: &[u8]) -> Self {
        serde_json::from_slice(bytes).unwrap_or_else(|e| Self::damaged(scene, &e))
    }

    fn damaged(scene: &SceneId, what: &dyn std::fmt::Display) -> Self {
        Self {
            schema: QUARANTINE_SCHEMA.to_owned(),
            scene: scene.clone(),
            reason: format!("its quarantine record is damaged ({what}); delete it to try again"),
        }
    }

    /// The scene's record, if it is in quarantine. A damaged record counts, with that as its reason.
    pub fn read(dir: &RunDir, scene: &SceneId) -> Option<Self> {
        Some(match std::fs::read(dir.quarantine(scene)) {
            Ok(bytes) => Self::parse(scene, &bytes),
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return None,
            Err(e) => Self::damaged(scene, &e),
        })
    }
}
