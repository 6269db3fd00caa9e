//! A run's tuples as the trainer asks for them.

use crate::run::keys;
use crate::run::quarantine::QuarantineRecord;
use render::ids::SceneId;
use crate::store::Store;
use train::{TupleFiles, TupleFilesError};
use bytes::Bytes;
use std::collections::BTreeSet;

impl TupleFiles for Store {
    fn get(&self, scene: &SceneId, file: &str) -> Result<Option<Bytes>, TupleFilesError> {
        Ok(Self::get(self, &keys::tuple(scene, file))?)
    }

    fn is_quarantined(&self, scene: &SceneId) -> Result<bool, TupleFilesError> {
        Ok(QuarantineRecord::get(self, scene)?.is_some())
    }

    fn count(&self, scenes: &[SceneId]) -> Result<usize, TupleFilesError> {
        let there: BTreeSet<String> = self.list(keys::TUPLES)?.into_iter().collect();
        let has = |scene: &&SceneId| there.contains(&keys::tuple(scene, "tuple.json"));
        Ok(scenes.iter().filter(has).count())
    }
}
