//! Scenes that cannot be done, each with its reason; the farm goes on without them.

use super::run_dir::RunDir;
use crate::atomic_file::{self, WriteError};
use crate::ids::SceneId;
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
    /// Writes the record, durably.
    pub fn write(dir: &RunDir, scene: &SceneId, reason: &str) -> Result<(), WriteError> {
        let record = Self {
            schema: QUARANTINE_SCHEMA.to_owned(),
            scene: scene.clone(),
            reason: reason.to_owned(),
        };
        atomic_file::create_dir(&dir.quarantine_folder())?;
        let mut json = serde_json::to_string_pretty(&record).expect("strings are JSON");
        json.push('\n');
        atomic_file::write(&dir.quarantine(scene), json.as_bytes())
    }

    /// The scene's record, if it is in quarantine. A damaged record counts, with that as its reason.
    pub fn read(dir: &RunDir, scene: &SceneId) -> Option<Self> {
        let damaged = |what: &dyn std::fmt::Display| Self {
            schema: QUARANTINE_SCHEMA.to_owned(),
            scene: scene.clone(),
            reason: format!("its quarantine record is damaged ({what}); delete it to try again"),
        };
        Some(match std::fs::read(dir.quarantine(scene)) {
            Ok(bytes) => serde_json::from_slice(&bytes).unwrap_or_else(|e| damaged(&e)),
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return None,
            Err(e) => damaged(&e),
        })
    }
}
