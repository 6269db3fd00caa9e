//! Provenance of results: the workers that made them, to find the faulty machine when two results differ. The record
//! of a tuple is `receipts/<scene>.json`; the record of partials is in their folder and is removed with them. Commands
//! only display the contents; the coordinator also lists the receipts to find new tuples.

use super::attempts::{WorkerName, attempts};
use super::json_line;
use super::keys;
use super::task::Task;
use crate::store::{Store, StoreError};
use render::ids::SceneId;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

pub(crate) const RECEIPT_SCHEMA: &str = "glasshouse.receipt/1";
pub(crate) const MADE_BY_SCHEMA: &str = "glasshouse.made_by/1";

/// `receipts/<scene>.json`: the workers of a tuple. Fields that another version does not write are empty, and so are
/// all fields of a damaged record.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Provenance {
    /// Schema of the record, `glasshouse.receipt/1`.
    #[serde(default)]
    pub schema: String,
    #[serde(default)]
    pub scene: Option<SceneId>,
    /// The worker that merged the partials.
    #[serde(default)]
    pub worker: Option<String>,
    #[serde(default)]
    pub host: Option<String>,
    /// Version of the worker's program.
    #[serde(default)]
    pub version: Option<String>,
    /// Other workers that made partials of the tuple, as far as known.
    #[serde(default, skip_serializing_if = "BTreeSet::is_empty")]
    pub with: BTreeSet<String>,
}

impl Provenance {
    /// Makes the record of a tuple from `worker`, alone or with others. The partials must still be in the store.
    pub(crate) fn new(store: &Store, scene: &SceneId, worker: &WorkerName, alone: bool) -> Self {
        Self {
            schema: RECEIPT_SCHEMA.to_owned(),
            scene: Some(scene.clone()),
            worker: Some(worker.worker.clone()),
            host: Some(worker.host.clone()),
            version: Some(env!("CARGO_PKG_VERSION").to_owned()),
            with: if alone {
                BTreeSet::new()
            } else {
                other_workers(store, scene, None, &worker.worker).unwrap_or_default()
            },
        }
    }

    /// Puts the record. If another worker has made the same tuple, its record stays.
    pub(crate) fn put(&self, store: &Store, scene: &SceneId) -> Result<(), StoreError> {
        match store.create(&keys::receipt(scene), &json_line(self)) {
            Ok(_) | Err(StoreError::Differs { .. }) => Ok(()),
            Err(error) => Err(error),
        }
    }

    pub fn get(store: &Store, scene: &SceneId) -> Result<Option<Self>, StoreError> {
        let bytes = store.get(&keys::receipt(scene))?;
        Ok(bytes.map(|bytes| Self::parse(&bytes)))
    }

    pub(crate) fn parse(bytes: &[u8]) -> Self {
        serde_json::from_slice(bytes).unwrap_or_default()
    }

    /// Returns all workers that made parts of the tuple.
    pub fn workers(&self) -> impl Iterator<Item = &String> {
        self.worker.iter().chain(&self.with)
    }

    /// Formats the names of all workers that made parts of the tuple.
    pub fn makers(&self) -> String {
        let worker = self.worker.clone().unwrap_or_else(|| "unknown".to_owned());
        let with: Vec<&str> = self.with.iter().map(String::as_str).collect();
        if with.is_empty() { worker } else { format!("{worker} with {}", with.join(", ")) }
    }
}

/// `partials/<scene>/<start>-<end>.json`: a worker that put some partials of these shards.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct PartialsProvenance {
    pub(crate) schema: String,
    /// First shard, and one past the last.
    pub(crate) shards: [u32; 2],
    pub(crate) worker: String,
    pub(crate) host: String,
}

impl PartialsProvenance {
    /// Puts the record. Ignores a failure, because only [`other_workers`] reads the record.
    pub(crate) fn put(store: &Store, scene: &SceneId, task: &Task, worker: &WorkerName) {
        let shards = [task.shards.start, task.shards.end];
        let record = Self {
            schema: MADE_BY_SCHEMA.to_owned(),
            shards,
            worker: worker.worker.clone(),
            host: worker.host.clone(),
        };
        let _ = store.replace(&keys::made_by(scene, shards), &json_line(&record));
    }

    /// Reads the records among the keys of a scene's partials.
    fn read(store: &Store, partials: &[String]) -> Result<Vec<Self>, StoreError> {
        let mut keys: Vec<String> = partials.to_vec();
        keys.retain(|key| keys::shard_of(key).is_none());
        keys.sort();
        let found = store.get_all(&keys)?.into_iter().flatten();
        Ok(found.filter_map(|bytes| serde_json::from_slice(&bytes).ok()).collect())
    }
}

/// Returns the workers other than `me` that may have put a shard's partial, or (without a shard) a scene's tuple.
pub(crate) fn other_workers(
    store: &Store,
    scene: &SceneId,
    shard: Option<u32>,
    me: &str,
) -> Result<BTreeSet<String>, StoreError> {
    let is_of = |[start, end]: [u32; 2]| shard.is_none_or(|shard| (start..end).contains(&shard));
    let mut names = BTreeSet::new();
    if shard.is_none() {
        let tuple = Provenance::get(store, scene)?;
        names.extend(tuple.iter().flat_map(Provenance::workers).cloned());
    }
    if names.is_empty() {
        let keys = store.list(&keys::partials(scene))?;
        let partials = PartialsProvenance::read(store, &keys)?.into_iter();
        names.extend(partials.filter(|p| is_of(p.shards)).map(|p| p.worker));
        let attempts = attempts(store, scene)?.into_iter();
        names.extend(attempts.filter(|a| is_of(a.shards)).map(|a| a.worker));
    }
    names.remove(me);
    Ok(names)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn who(name: &str) -> WorkerName {
        WorkerName { worker: name.to_owned(), host: "h".to_owned() }
    }

    #[test]
    fn other_workers_are_those_of_the_shard_or_of_the_tuple() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::local(folder.path()).unwrap();
        let scene = SceneId::new("s").unwrap();
        let put = |name: &str, shards| {
            let task = Task { scene: 0, shards };
            PartialsProvenance::put(&store, &scene, &task, &who(name));
        };
        put("a", 0..8);
        put("b", 8..16);
        store.create("partials/s/000003.exr", b"x").unwrap();
        let others = |shard, me: &str| {
            let names = other_workers(&store, &scene, shard, me).unwrap();
            names.into_iter().collect::<Vec<_>>()
        };
        assert_eq!(others(Some(3), "b"), ["a"]);
        assert_eq!(others(Some(8), "a"), ["b"]);
        assert_eq!(others(Some(8), "b"), [""; 0]);
        assert_eq!(others(None, "c"), ["a", "b"]);
        store.create("receipts/s.json", br#"{"worker":"d"}"#).unwrap();
        assert_eq!(others(None, "c"), ["d"]);
    }
}
