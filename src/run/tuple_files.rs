//! A run's tuples as the trainer reads them.

use super::{QuarantineRecord, keys};
use crate::store::{Store, StoreError};
use render::ids::SceneId;
use train::{TupleFiles, TupleFilesError};

impl TupleFiles for Store {
    fn get(&self, scene: &SceneId, file: &str) -> Result<Option<Vec<u8>>, TupleFilesError> {
        let bytes = Self::get(self, &keys::tuple(scene, file)).map_err(unavailable)?;
        Ok(bytes.map(Vec::from))
    }

    fn is_quarantined(&self, scene: &SceneId) -> Result<bool, TupleFilesError> {
        let record = QuarantineRecord::get(self, scene).map_err(unavailable)?;
        Ok(record.is_some())
    }
}

fn unavailable(error: StoreError) -> TupleFilesError {
    TupleFilesError(error.into())
}
