//! Writes tuples to the store, and removes their scenes' partials afterwards.

use crate::farm::FarmError;
use crate::run::{AccessError, keys};
use crate::store::{Store, StoreError};
use bytes::Bytes;
use glasshouse_line::SceneLine;
use render::merge::Tuple;
use std::time::Duration;

/// Writes a tuple durably. The last file, `tuple.json`, follows all others.
pub(crate) fn write_tuple(store: &Store, files: &[(String, Bytes)]) -> Result<(), StoreError> {
    let (record, others) = files.split_last().expect("a tuple has a tuple.json");
    store.create_all(others.to_vec())?;
    store.create(&record.0, &record.1).map(|_| ())
}

/// Puts a scene's noise map, before its tuple. Ignores errors: only the report needs the map, and mentions a missing
/// one; if the store is at fault, the tuple's put fails next.
pub(crate) fn write_noise(store: &Store, line: &SceneLine, bytes: &[u8]) {
    let store = store.with_patience(Duration::ZERO);
    let _ = store.replace(&keys::noise(&line.id), bytes);
}

/// Removes a merged scene's partials and, on a disk, its folder of attempts. Ignores errors: leftovers do no harm.
pub(crate) fn remove_partials(store: &Store, line: &SceneLine) {
    let _ = store.remove_folder(&keys::partials(&line.id));
    if store.is_local() {
        // The folder remains after the removal of its last attempt.
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
