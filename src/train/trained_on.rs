//! The tuples of a training: a later call, and a score, must find them unchanged.

use super::error::TrainError;
use examples::TupleFiles;
use glasshouse_line::SceneLine;
use glasshouse_line::ids::SceneId;
use rayon::prelude::*;
use render::atomic_file;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Name of the list in a stage's folder.
const TRAINED_ON: &str = "tuples.json";
/// Schema of [`TRAINED_ON`].
const TRAINED_ON_SCHEMA: &str = "glasshouse.trained_on/1";

/// Content of `tuples.json` in a stage's folder.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainedOn {
    schema: String,
    /// BLAKE3 (hex) of each scene's `tuple.json`, which has the digests of the tuple's other files.
    tuples: BTreeMap<SceneId, String>,
}

impl TrainedOn {
    /// Reads the list of a stage's folder; `None` without one, as in trainings of older versions.
    pub fn read(stage_folder: &Path) -> Result<Option<Self>, TrainError> {
        let path = stage_folder.join(TRAINED_ON);
        let failed = |source| TrainError::Read { path: path.clone(), source };
        let Some(bytes) = render::input_file::read_if_there(&path).map_err(failed)? else {
            return Ok(None);
        };
        serde_json::from_slice(&bytes).map(Some).map_err(|error| failed(error.into()))
    }

    /// Fails if a tuple of the list is no longer what it was.
    pub fn check(&self, stage_folder: &Path, files: &dyn TupleFiles) -> Result<(), TrainError> {
        let scenes: Vec<&SceneId> = self.tuples.keys().collect();
        let present = digests(&scenes, files)?;
        let mut changed = scenes.into_iter().zip(present).filter_map(|(scene, present)| {
            (present.as_ref() != self.tuples.get(scene)).then(|| scene.to_string())
        });
        let mut names: Vec<String> = changed.by_ref().collect();
        if names.is_empty() {
            return Ok(());
        }
        names.sort();
        Err(TrainError::OtherTuples { folder: stage_folder.to_owned(), names })
    }
}

/// Compares the tuples of train scenes with those of a training's earlier calls, if these took steps, and adds new ones to the list if
/// it `writes`.
pub(super) fn check_and_note(
    stage_folder: &Path,
    lines: &[SceneLine],
    files: &dyn TupleFiles,
    (has_steps, writes): (bool, bool),
) -> Result<(), TrainError> {
    // Without steps, nothing was learned from the tuples.
    let known = if has_steps { TrainedOn::read(stage_folder)? } else { None };
    if let Some(known) = &known {
        known.check(stage_folder, files)?;
    }
    if !writes {
        return Ok(());
    }
    let mut tuples = known.map(|known| known.tuples).unwrap_or_default();
    let new = lines.iter().map(|line| &line.id).filter(|scene| !tuples.contains_key(scene));
    let new: Vec<&SceneId> = new.collect();
    let present = digests(&new, files)?;
    let new: Vec<(SceneId, String)> = new
        .into_iter()
        .zip(present)
        .filter_map(|(scene, present)| Some((scene.clone(), present?)))
        .collect();
    tuples.extend(new);
    let list = TrainedOn { schema: TRAINED_ON_SCHEMA.to_owned(), tuples };
    let json = serde_json::to_vec(&list).expect("texts are JSON");
    let path: PathBuf = stage_folder.join(TRAINED_ON);
    Ok(atomic_file::write(&path, &json)?)
}

/// Digests the records of tuples; `None` for those that are missing.
fn digests(scenes: &[&SceneId], files: &dyn TupleFiles) -> Result<Vec<Option<String>>, TrainError> {
    let digest = |scene: &&SceneId| {
        let record = files.get(scene, "tuple.json").map_err(TrainError::Tuples)?;
        Ok(record.map(|bytes| blake3::hash(&bytes).to_hex().to_string()))
    };
    scenes.par_iter().map(digest).collect()
}
