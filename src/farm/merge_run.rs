//! `merge RUN`: tuples from complete partials, without the scenes' input files.

use super::error::FarmError;
use super::quarantine::QuarantineRecord;
use super::run_dir::Run;
use super::sweep::sweep;
use super::writer::remove_partials;
use crate::ids::SceneId;
use crate::merge::{MergeError, combine, is_written, write_tuple};
use crate::partial;
use crate::store::Store;

/// What merging did.
#[derive(Debug, Default)]
pub struct MergeOutcome {
    /// Tuples written now.
    pub merged: Vec<SceneId>,
    /// Tuples that were there before.
    pub already_merged: u64,
    /// Scenes that cannot be merged, with the reason.
    pub refused: Vec<(SceneId, String)>,
}

/// Merges every scene whose partials are complete; with `dry_run` only says which.
pub fn merge_run(run: &Run, dry_run: bool, on_scene: &dyn Fn()) -> Result<MergeOutcome, FarmError> {
    // A dry run writes nothing, not even the lock's file.
    let _lock = if dry_run { None } else { Some(run.lock()?) };
    if !dry_run {
        sweep(run);
    }
    let store = Store::local(run.dir.root())?;
    let mut outcome = MergeOutcome::default();
    for line in &run.lines {
        on_scene();
        if is_written(&run.dir.tuple(&line.id), line) {
            outcome.already_merged += 1;
            continue;
        }
        if let Some(record) = QuarantineRecord::read(&run.dir, &line.id) {
            outcome.refused.push((
                line.id.clone(),
                format!("scene {} is in quarantine: {}", line.id, record.reason),
            ));
            continue;
        }
        let layout = run.layout(line);
        let mut partials = Vec::new();
        let mut unusable = None;
        for index in 0..layout.len() {
            let path = run.dir.partial(&line.id, index);
            let Ok(bytes) = std::fs::read(&path) else {
                continue;
            };
            match partial::decode(&path, &bytes) {
                Ok(found) => partials.push(found),
                Err(error) => unusable = Some(error.to_string()),
            }
        }
        match combine(line, run.spec.tile_px, &partials) {
            Ok(_) if dry_run => outcome.merged.push(line.id.clone()),
            Ok(tuple) => {
                write_tuple(&tuple, &run.dir.tuple(&line.id))
                    .map_err(|e| FarmError::Tuple(e.to_string()))?;
                remove_partials(&store, line);
                outcome.merged.push(line.id.clone());
            }
            Err(error @ MergeError::Gaps { .. }) => {
                let reason =
                    unusable.map_or_else(|| error.to_string(), |u| format!("{error}; {u}"));
                outcome.refused.push((line.id.clone(), reason));
            }
            Err(error) => outcome.refused.push((line.id.clone(), error.to_string())),
        }
    }
    Ok(outcome)
}
