//! What of a run is done, as its store tells.

use super::error::AccessError;
use super::keys;
use super::quarantine::QuarantineRecord;
use super::run_dir::Run;
use crate::store::Store;
use render::line::SceneLine;
use render::merge::{is_record_of, is_written, tuple_files};
use std::collections::BTreeSet;

/// The file of a tuple that is put last.
const LAST: &str = "tuple.json";
/// Records in memory at once.
const RECORDS_AT_ONCE: usize = 256;

/// The scene's tuple is there, whole, and made from this line by this version of the tracer.
pub(crate) fn is_done(store: &Store, line: &SceneLine) -> Result<bool, AccessError> {
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
    /// Receipts at the last look.
    receipts: BTreeSet<String>,
}

impl Progress {
    /// Of nothing.
    pub fn new(scenes: usize) -> Self {
        Self {
            done: vec![false; scenes],
            quarantined: vec![None; scenes],
            receipts: BTreeSet::new(),
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

    /// Looks at everything: lists all tuples, several keys a scene.
    pub fn look(&mut self, run: &Run, store: &Store) -> Result<(), AccessError> {
        let tuples = set(store.list(keys::TUPLES)?);
        let has_record = |line: &SceneLine| tuples.contains(&keys::tuple(&line.id, LAST));
        let mut new = Vec::new();
        for (scene, line) in run.lines.iter().enumerate() {
            self.done[scene] &= has_record(line);
            if !self.done[scene] && has_record(line) {
                new.push(scene);
            }
        }
        self.check(run, store, &new, &tuples)?;
        self.receipts = set(store.list(keys::RECEIPTS)?);
        self.look_at_quarantine(run, store).map(|_| ())
    }

    /// Looks for news: lists receipts, one key a scene, which workers of a farm put when a tuple is there. True if
    /// something was taken back that had been there, so that [`Self::look`] is due.
    pub fn look_for_news(&mut self, run: &Run, store: &Store) -> Result<bool, AccessError> {
        let receipts = set(store.list(keys::RECEIPTS)?);
        let gone = self.receipts.difference(&receipts).next().is_some();
        for (scene, line) in run.lines.iter().enumerate() {
            if !self.done[scene] && receipts.contains(&keys::receipt(&line.id)) {
                self.done[scene] = is_done(store, line)?;
            }
        }
        self.receipts = receipts;
        Ok(self.look_at_quarantine(run, store)? || gone)
    }

    /// True if a scene was taken out.
    fn look_at_quarantine(&mut self, run: &Run, store: &Store) -> Result<bool, AccessError> {
        let there = set(store.list(keys::QUARANTINE)?);
        let mut freed = false;
        for (known, line) in self.quarantined.iter_mut().zip(&run.lines) {
            if !there.contains(&keys::quarantine(&line.id)) {
                freed |= known.take().is_some();
            } else if known.is_none() {
                *known = QuarantineRecord::get(store, &line.id)?.map(|record| record.reason);
            }
        }
        Ok(freed)
    }

    /// Looks closer at scenes whose last file is listed among `tuples`.
    fn check(
        &mut self,
        run: &Run,
        store: &Store,
        scenes: &[usize],
        tuples: &BTreeSet<String>,
    ) -> Result<(), AccessError> {
        if store.local_root().is_some() {
            for &scene in scenes {
                self.done[scene] = is_done(store, &run.lines[scene])?;
            }
            return Ok(());
        }
        for scenes in scenes.chunks(RECORDS_AT_ONCE) {
            let record = |&scene: &usize| keys::tuple(&run.lines[scene].id, LAST);
            let records: Vec<String> = scenes.iter().map(record).collect();
            for (&scene, record) in scenes.iter().zip(store.get_all(&records)?) {
                let line = &run.lines[scene];
                let mut files = tuple_files(line).into_iter();
                self.done[scene] = record.is_some_and(|record| is_record_of(&record, line))
                    && files.all(|file| tuples.contains(&keys::tuple(&line.id, &file)));
            }
        }
        Ok(())
    }
}

fn set(keys: Vec<String>) -> BTreeSet<String> {
    keys.into_iter().collect()
}
