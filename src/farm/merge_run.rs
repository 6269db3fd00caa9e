//! `merge RUN` makes tuples from complete sets of partials without reading the scenes' input files.

use super::error::FarmError;
use crate::farm::sweep::sweep;
use crate::farm::tuples::{self, encode_noise, remove_partials, write_noise};
use crate::run::{
    AccessError, Makers, Provenance, QuarantineRecord, Run, WorkerName, is_done, keys,
};
use crate::store::Store;
use bytes::Bytes;
use compose::{encode_tuple, write_tuple};
use glasshouse_line::SceneLine;
use glasshouse_line::color::SrgbEncoder;
use glasshouse_line::ids::SceneId;
use render::merge::{MergeError, Tuple, combine};
use render::partial;
use std::path::Path;

#[derive(Debug, Default)]
pub struct MergeOutcome {
    pub merged: Vec<SceneId>,
    /// Number of scenes that already had a tuple.
    pub already_merged: u64,
    /// Scenes that cannot be merged, with their reasons.
    pub refused: Vec<(SceneId, String)>,
}

/// Merges every scene that has a complete set of partials and is neither done nor in quarantine; with `dry_run`, only
/// lists these scenes. The receipts name this process as the worker that merged, and the makers of the partials. The
/// objects are in the store `elsewhere`, or in the run's folder if `elsewhere` is `None`.
pub fn merge_run(
    run: &Run,
    elsewhere: Option<&Store>,
    dry_run: bool,
    who: &WorkerName,
    on_scene: &dyn Fn(),
) -> Result<MergeOutcome, FarmError> {
    // A dry run writes nothing, not even the lock file. A store elsewhere needs no lock, because merging overwrites
    // only noise maps in it.
    let lock = if dry_run || elsewhere.is_some() {
        None
    } else {
        let lock = run.lock()?;
        sweep(run);
        Some(lock)
    };
    let store = match elsewhere {
        Some(store) => store.clone(),
        None => Store::local(run.root())?,
    };
    let mut outcome = MergeOutcome::default();
    for line in &run.lines {
        on_scene();
        if is_done(run, &store, line)? {
            outcome.already_merged += 1;
            continue;
        }
        if let Some(record) = QuarantineRecord::get(&store, &line.id)? {
            let reason = format!("scene {} is in quarantine: {}", line.id, record.reason);
            outcome.refused.push((line.id.clone(), reason));
            continue;
        }
        let mut partials = Vec::new();
        let mut unusable = None;
        let mut there = store.list(&keys::partials(&line.id))?;
        there.retain(|key| keys::shard_of(key).is_some_and(|s| s < run.layout(line).len()));
        there.sort();
        for (key, bytes) in there.iter().zip(store.get_all(&there)?) {
            let Some(bytes) = bytes else {
                continue;
            };
            match partial::decode(&Path::new(store.name()).join(key), &bytes) {
                Ok(found) => partials.push(found),
                Err(error) => unusable = Some(error.to_string()),
            }
        }
        match combine(line, run.spec.tile_px, &partials) {
            Ok(_) if dry_run => outcome.merged.push(line.id.clone()),
            Ok(tuple) => {
                if !tuple.noise.is_empty() {
                    write_noise(&store, line, &encode_noise(&tuple)?);
                }
                let makers = Makers::of(&partials);
                if !makers.are_only(&who.worker) {
                    Provenance::new(&line.id, who, &makers).put(&store, &line.id)?;
                }
                if elsewhere.is_some() {
                    tuples::write_tuple(&store, &encoded(&tuple, line)?)?;
                } else {
                    // Unlike the puts above, this call overwrites the files of an invalid tuple.
                    write_tuple(&tuple, &run.path(&keys::tuple_folder(&line.id)))
                        .map_err(|e| AccessError::Tuple(e.to_string()))?;
                }
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
    if let Some(lock) = &lock {
        run.check_lock(lock)?;
        run.check_unchanged()?;
    }
    store.check_place()?;
    Ok(outcome)
}

/// Encodes a tuple's files. Returns their keys and bytes in the order of writing.
fn encoded(tuple: &Tuple, line: &SceneLine) -> Result<Vec<(String, Bytes)>, FarmError> {
    let files = encode_tuple(tuple, &SrgbEncoder::new());
    let files = files.map_err(|e| AccessError::Tuple(e.to_string()))?.into_iter();
    Ok(files.map(|(name, bytes)| (keys::tuple(&line.id, &name), bytes.into())).collect())
}
