//! Writing a tuple to the store, and removing the scene's partials after that.

use crate::farm::FarmError;
use crate::run::{AccessError, keys};
use crate::store::{Store, StoreError};
use bytes::Bytes;
use render::line::SceneLine;
use render::merge::Tuple;
use std::time::Duration;

/// Writes a tuple durably: the last file, `tuple.json`, only after all others.
pub(crate) fn write_tuple(store: &Store, files: &[(String, Bytes)]) -> Result<(), StoreError> {
    let (record, others) = files.split_last().expect("a tuple has a tuple.json");
    store.create_all(others.to_vec())?;
    store.create(&record.0, &record.1).map(|_| ())
}

/// Puts a scene's noise map, before its tuple. A failure is ignored: only the report needs the map, and says if it is missing;
/// if the store is at fault, the put of the tuple fails next.
pub(crate) fn write_noise(store: &Store, line: &SceneLine, bytes: &[u8]) {
    let store = store.with_patience(Duration::ZERO);
    let _ = store.replace(&keys::noise(&line.id), bytes);
}

/// Removes the partials and the records of attempts of a scene whose tuple is durable. Failures do no harm.
pub(crate) fn remove_partials(store: &Store, line: &SceneLine) {
    let _ = store.remove_folder(&keys::partials(&line.id));
    if store.is_local() {
        // The folder stays when its last attempt is removed.
        let _ = store.remove_folder(&keys::attempts(&line.id));
    }
}

pub(crate) fn encode_noise(tuple: &Tuple) -> Result<Vec<u8>, FarmError> {
    let encoded = tuple.noise.encode();
    encoded.map_err(|e| {
        let key = keys::noise(&tuple.record.scene.id);
        FarmError::from(AccessError::Tuple(format!("cannot encode {key}: {e}")))
    })
}
