//! Who made the partials of a scene that several workers share: a note beside them, to name who was wrong if two workers
//! disagree. It goes when they go, and nothing depends on it.

use super::attempts::{WorkerName, attempts};
use super::keys;
use super::receipt::Receipt;
use super::task::Task;
use crate::store::{Store, StoreError};
use render::ids::SceneId;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// The schema name of a note.
pub(crate) const MADE_BY_SCHEMA: &str = "glasshouse.made_by/1";

/// `partials/<scene>/<start>-<end>.json`: this worker had these shards and left some of them in the store.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct MadeBy {
    /// Always [`MADE_BY_SCHEMA`].
    pub schema: String,
    /// First shard, and one past the last.
    pub shards: [u32; 2],
    /// Who.
    pub worker: String,
    /// On which machine.
    pub host: String,
}

impl MadeBy {
    /// Leaves the note. One that cannot be left is missed only by who asks.
    pub(crate) fn leave(store: &Store, scene: &SceneId, task: &Task, who: &WorkerName) {
        let shards = [task.shards.start, task.shards.end];
        let note = Self {
            schema: MADE_BY_SCHEMA.to_owned(),
            shards,
            worker: who.worker.clone(),
            host: who.host.clone(),
        };
        let mut json = serde_json::to_vec(&note).expect("strings and numbers are JSON");
        json.push(b'\n');
        let _ = store.replace(&keys::made_by(scene, shards), &json);
    }

    /// The notes among the names of a scene's partials.
    pub(crate) fn read(store: &Store, partials: &[String]) -> Result<Vec<Self>, StoreError> {
        let mut notes: Vec<String> = partials.to_vec();
        notes.retain(|key| keys::shard_of(key).is_none());
        notes.sort();
        let found = store.get_all(&notes)?.into_iter().flatten();
        Ok(found
            .filter_map(|bytes| serde_json::from_slice(&bytes).ok())
            .collect())
    }
}

/// Workers other than `me` that may have put a shard's partial, or (without a shard) a scene's tuple.
pub(crate) fn who_else(
    store: &Store,
    scene: &SceneId,
    shard: Option<u32>,
    me: &str,
) -> Result<BTreeSet<String>, StoreError> {
    let is_of = |[start, end]: [u32; 2]| shard.is_none_or(|shard| (start..end).contains(&shard));
    let mut names = BTreeSet::new();
    if shard.is_none() {
        names.extend(
            Receipt::get(store, scene)?
                .iter()
                .flat_map(Receipt::workers)
                .cloned(),
        );
    }
    if names.is_empty() {
        let there = store.list(&keys::partials(scene))?;
        let notes = MadeBy::read(store, &there)?.into_iter();
        names.extend(notes.filter(|n| is_of(n.shards)).map(|n| n.worker));
        let tried = attempts(store, scene)?.into_iter();
        names.extend(tried.filter(|a| is_of(a.shards)).map(|a| a.worker));
    }
    names.remove(me);
    Ok(names)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn who(name: &str) -> WorkerName {
        WorkerName {
            worker: name.to_owned(),
            host: "h".to_owned(),
        }
    }

    #[test]
    fn who_else_had_a_shard() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::local(folder.path()).unwrap();
        let scene = SceneId::new("s").unwrap();
        let leave = |name: &str, shards| {
            let task = Task { scene: 0, shards };
            MadeBy::leave(&store, &scene, &task, &who(name));
        };
        leave("a", 0..8);
        leave("b", 8..16);
        store.create("partials/s/000003.exr", b"x").unwrap();
        let else_of = |shard, me: &str| {
            let names = who_else(&store, &scene, shard, me).unwrap();
            names.into_iter().collect::<Vec<_>>()
        };
        assert_eq!(else_of(Some(3), "b"), ["a"]);
        assert_eq!(else_of(Some(8), "a"), ["b"]);
        assert_eq!(else_of(Some(8), "b"), [""; 0]);
        assert_eq!(else_of(None, "c"), ["a", "b"]);
        store
            .create("receipts/s.json", br#"{"worker":"d"}"#)
            .unwrap();
        assert_eq!(else_of(None, "c"), ["d"]);
    }
}
