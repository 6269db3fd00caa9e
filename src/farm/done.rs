//! What of a run is done, as its store tells.

use super::error::FarmError;
use super::keys;
use super::quarantine::QuarantineRecord;
use super::run_dir::Run;
use crate::manifest::SceneLine;
use crate::merge::{is_record_of, is_written, tuple_files};
use crate::store::Store;
use std::collections::BTreeSet;

/// The scene's tuple is there, whole, and made from this line by this version of the tracer.
pub(super) fn is_done(store: &Store, line: &SceneLine) -> Result<bool, FarmError> {
    if let Some(root) = store.local_root() {
        return Ok(is_written(
            &root.join(keys::TUPLES).join(line.id.as_str()),
            line,
        ));
    }
    let files = tuple_files(line);
    let names: Vec<String> = files.iter().map(|f| keys::tuple(&line.id, f)).collect();
    let Some(record) = store.get(names.last().expect("tuple.json is one of them"))? else {
        return Ok(false);
    };
    let there: BTreeSet<String> = store
        .list(&format!("{}/{}", keys::TUPLES, line.id))?
        .into_iter()
        .collect();
    Ok(is_record_of(&record, line) && names.iter().all(|name| there.contains(name)))
}

/// Scenes of a run by what is known of them.
#[derive(Debug, Default)]
pub struct Progress {
    /// By place in the manifest: the tuple is there.
    pub done: Vec<bool>,
    /// By place in the manifest: in quarantine, for this reason.
    pub quarantined: Vec<Option<String>>,
}

impl Progress {
    /// Of nothing.
    pub fn new(scenes: usize) -> Self {
        Self {
            done: vec![false; scenes],
            quarantined: vec![None; scenes],
        }
    }

    /// Nothing is left to do.
    pub fn is_finished(&self) -> bool {
        self.missing().next().is_none()
    }

    /// Scenes that are neither done nor in quarantine.
    pub fn missing(&self) -> impl Iterator<Item = usize> {
        (0..self.done.len()).filter(|&s| !self.done[s] && self.quarantined[s].is_none())
    }

    /// Looks again. A scene that was done stays done: what is in the store is not taken back.
    pub fn update(&mut self, run: &Run, store: &Store) -> Result<(), FarmError> {
        let tuples: BTreeSet<String> = store.list(keys::TUPLES)?.into_iter().collect();
        let quarantined: BTreeSet<String> = store.list(keys::QUARANTINE)?.into_iter().collect();
        for (index, line) in run.lines.iter().enumerate() {
            if !self.done[index] && tuples.contains(&keys::tuple(&line.id, "tuple.json")) {
                self.done[index] = is_done(store, line)?;
            }
            self.quarantined[index] = if quarantined.contains(&keys::quarantine(&line.id)) {
                QuarantineRecord::get(store, &line.id)?.map(|record| record.reason)
            } else {
                None
            };
        }
        Ok(())
    }
}
