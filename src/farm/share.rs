//! Puts files of the run into the store, for workers without access to the run's folder.

use super::error::FarmError;
use crate::run::{Run, RunError, keys};
use crate::store::{Store, StoreError};
use glasshouse_line::{Roots, SceneLine, is_url};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Largest number of objects put in one call.
const AT_ONCE: usize = 32;

/// Puts the run's manifest, spec and own photographs into the store, and removes the mark of a finished run.
pub(super) fn share_run(run: &Run, store: &Store) -> Result<(), FarmError> {
    share_inputs(run, store)?;
    for (key, path) in
        [(keys::MANIFEST, run.path(keys::MANIFEST)), (keys::SPEC, run.path(keys::SPEC))]
    {
        let bytes =
            render::input_file::read(&path).map_err(|source| RunError::Read { path, source })?;
        store.create(key, &bytes)?;
    }
    store.delete(&[keys::FINISHED.to_owned()])?;
    Ok(())
}

/// Returns the run's own roots: folders below the run's folder, with photographs that planning made.
fn own_roots(run: &Run) -> impl Iterator<Item = (&String, &PathBuf)> {
    let roots = run.spec.roots.iter();
    roots.filter(|(_, folder)| folder.is_relative() && !is_url(folder))
}

/// Puts the files that the scenes need from the run's own roots into the store, unless the store is the run's folder.
/// Skips files that are absent here: another coordinator has put them into the store, or the workers' machines have
/// them.
fn share_inputs(run: &Run, store: &Store) -> Result<(), StoreError> {
    let is_own = |root: &Path| root.canonicalize().ok() == run.root().canonicalize().ok();
    if store.local_root().is_some_and(is_own) {
        return Ok(());
    }
    let own: BTreeMap<&String, &PathBuf> = own_roots(run).collect();
    let mut wanted = BTreeSet::new();
    for (_, text) in run.lines.iter().flat_map(SceneLine::paths) {
        let path = text.split_once(':').and_then(|(name, rest)| {
            Some(own.get(&name.to_owned())?.join(rest).to_str()?.to_owned())
        });
        wanted.extend(path);
    }
    if wanted.is_empty() {
        return Ok(());
    }
    let there: BTreeSet<String> = store.list(keys::INPUTS)?.into_iter().collect();
    let missing: Vec<String> = wanted.difference(&there).cloned().collect();
    for keys in missing.chunks(AT_ONCE) {
        let read = |key: &String| {
            Some((key.clone(), render::input_file::read(&run.root().join(key)).ok()?.into()))
        };
        store.create_all(keys.iter().filter_map(read).collect())?;
    }
    Ok(())
}

impl Run {
    /// Replaces the run's own roots by folders in `store`, except for roots that exist on this machine or are in
    /// `given`.
    pub fn take_inputs_from(&mut self, store: &Store, given: &Roots) {
        let own: Vec<(String, PathBuf)> = own_roots(self)
            .filter(|(name, folder)| {
                given.get(name).is_none() && !self.root().join(folder).is_dir()
            })
            .map(|(name, folder)| (name.clone(), folder.clone()))
            .collect();
        for (name, folder) in own {
            self.roots.replace(&name, Path::new(store.name()).join(folder));
        }
    }
}
