//! What the writer thread is given. It waits for the store, so that no thread that computes has to.

use super::finished::Encoded;
use super::open_span::OpenSpan;
use crate::run::keys;
use crate::store::{Store, StoreError};
use bytes::Bytes;
use render::line::SceneLine;
use std::sync::Arc;
use std::time::Duration;

/// Something to write, encoded already.
pub(super) struct Order<'a> {
    pub(super) span: Arc<OpenSpan<'a>>,
    pub(super) what: What,
}

/// What to write.
pub(super) enum What {
    /// A shard's partial.
    Partial { shard: u32, bytes: Vec<u8> },
    /// A scene's tuple; when it is durable, the scene's partials are removed.
    Tuple { encoded: Encoded, miss_share: f64 },
}

/// Writes a tuple durably: what comes last, `tuple.json`, only when all else is there.
pub(super) fn write_tuple(store: &Store, files: &[(String, Bytes)]) -> Result<(), StoreError> {
    let (record, others) = files.split_last().expect("a tuple has a tuple.json");
    store.create_all(others.to_vec())?;
    store.create(&record.0, &record.1).map(|_| ())
}

/// Puts a scene's noise map, before its tuple. One that cannot be put is missed by the report alone, which says so; if the
/// store is at fault, the tuple comes next.
pub(super) fn write_noise(store: &Store, line: &SceneLine, bytes: &[u8]) {
    let store = store.with_patience(Duration::ZERO);
    let _ = store.replace(&keys::noise(&line.id), bytes);
}

/// The tuple is durable: its partials, and who tried, are of no more use. What cannot be removed does no harm.
pub(super) fn remove_partials(store: &Store, line: &SceneLine) {
    if let Some(root) = store.local_root() {
        let _ = std::fs::remove_dir_all(root.join(keys::partials(&line.id)));
        let _ = std::fs::remove_dir_all(root.join(keys::attempts(&line.id)));
    } else if let Ok(partials) = store.list(&keys::partials(&line.id)) {
        let _ = store.delete(&partials);
    }
}
