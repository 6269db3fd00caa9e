//! How a tuple gets into the store, and what is removed then.

use crate::farm::FarmError;
use crate::run::{AccessError, keys};
use crate::store::{Store, StoreError};
use bytes::Bytes;
use render::line::SceneLine;
use render::merge::Tuple;
use std::time::Duration;

/// Writes a tuple durably: what comes last, `tuple.json`, only when all else is there.
pub(in crate::farm) fn write_tuple(
    store: &Store,
    files: &[(String, Bytes)],
) -> Result<(), StoreError> {
    let (record, others) = files.split_last().expect("a tuple has a tuple.json");
    store.create_all(others.to_vec())?;
    store.create(&record.0, &record.1).map(|_| ())
}

/// Puts a scene's noise map, before its tuple. One that cannot be put is missed by the report alone, which says so; if the
/// store is at fault, the tuple comes next.
pub(in crate::farm) fn write_noise(store: &Store, line: &SceneLine, bytes: &[u8]) {
    let store = store.with_patience(Duration::ZERO);
    let _ = store.replace(&keys::noise(&line.id), bytes);
}

/// The tuple is durable: its partials, and records of attempts, are of no more use. What cannot be removed does no harm.
pub(in crate::farm) fn remove_partials(store: &Store, line: &SceneLine) {
    let _ = store.remove_folder(&keys::partials(&line.id));
    if store.is_local() {
        // The folder stays when its last attempt is removed.
        let _ = store.remove_folder(&keys::attempts(&line.id));
    }
}

/// The bytes of a tuple's noise map.
pub(in crate::farm) fn encode_noise(tuple: &Tuple) -> Result<Vec<u8>, FarmError> {
    let encoded = tuple.noise.encode();
    encoded.map_err(|e| {
        let key = keys::noise(&tuple.record.scene.id);
        FarmError::from(AccessError::Tuple(format!("cannot encode {key}: {e}")))
    })
}
