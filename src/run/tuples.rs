//! Gives training examples access to a run's tuples.

use super::{QuarantineRecord, keys};
use crate::store::{Store, StoreError};
use examples::{TupleFiles, TupleFilesError};
use glasshouse_line::ids::SceneId;
use std::collections::BTreeSet;

impl TupleFiles for Store {
    fn get(&self, scene: &SceneId, file: &str) -> Result<Option<Vec<u8>>, TupleFilesError> {
        let bytes = Self::get(self, &keys::tuple(scene, file)).map_err(unavailable)?;
        Ok(bytes.map(Vec::from))
    }

    fn is_quarantined(&self, scene: &SceneId) -> Result<bool, TupleFilesError> {
        let record = QuarantineRecord::get(self, scene).map_err(unavailable)?;
        Ok(record.is_some())
    }

    fn count(&self, scenes: &[SceneId]) -> Result<usize, TupleFilesError> {
        let there = self.list(keys::TUPLES).map_err(unavailable)?;
        let there: BTreeSet<String> = there.into_iter().collect();
        let has = |scene: &&SceneId| there.contains(&keys::tuple(scene, "tuple.json"));
        Ok(scenes.iter().filter(has).count())
    }
}

fn unavailable(error: StoreError) -> TupleFilesError {
    TupleFilesError(error.into())
}
