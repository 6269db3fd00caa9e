//! What the writer thread is given. It waits for the store, so that no thread that computes has to.

use super::error::FarmError;
use super::finished::Files;
use super::keys;
use super::open_span::OpenSpan;
use crate::manifest::SceneLine;
use crate::store::Store;
use std::sync::Arc;

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
    Tuple { files: Files, miss_share: f64 },
}

/// Writes a tuple durably, `tuple.json` last, then removes the scene's partials.
pub(super) fn write_tuple(
    store: &Store,
    line: &SceneLine,
    mut files: Files,
) -> Result<(), FarmError> {
    let (name, record) = files.pop().expect("a tuple has a tuple.json");
    let objects = files
        .into_iter()
        .map(|(name, bytes)| (keys::tuple(&line.id, &name), bytes));
    store.create_all(objects.collect())?;
    store.create(&keys::tuple(&line.id, &name), &record)?;
    remove_partials(store, line);
    Ok(())
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
