//! Provenance of results: the workers that made them, to find the faulty machine when two results differ.
//!
//! Each partial names its maker in its file. A worker that merges partials puts a *receipt* with the makers of all of
//! them **before** it puts the first file of the tuple, and partials are removed after the tuple. Hence, whatever is
//! killed between any two of these steps:
//!
//! | killed | left behind | names of the makers |
//! |---|---|---|
//! | before the receipt | partials | in the partials |
//! | between receipt and `tuple.json` | partials, a receipt, files of a tuple that does not count | in both |
//! | after `tuple.json` | tuple and receipt | in the receipt |
//!
//! Several workers may merge the same scene, and files of both may be in the tuple. The first one puts
//! `receipts/<scene>.json`, each other one puts `receipts/<scene>/<digest>.json`, and no receipt is ever replaced, so
//! readers take the union. A receipt may therefore name more workers than those with a part in the tuple, but never
//! fewer.

use super::attempts::{WorkerName, attempts};
use super::json_line;
use super::keys;
use crate::store::{Put, Store, StoreError};
use glasshouse_line::ids::SceneId;
use render::partial::{self, Maker, Partial};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::path::Path;

pub(crate) const RECEIPT_SCHEMA: &str = "glasshouse.receipt/1";

/// The makers of the partials of a tuple.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Makers {
    pub(crate) workers: BTreeSet<String>,
    /// Number of partials that name no maker, as those of earlier versions.
    pub(crate) unknown: u32,
}

impl Makers {
    pub(crate) fn of<'p>(partials: impl IntoIterator<Item = &'p Partial>) -> Self {
        let mut makers = Self::default();
        for partial in partials {
            match &partial.maker {
                Some(maker) => {
                    makers.workers.insert(maker.worker.clone());
                }
                None => makers.unknown += 1,
            }
        }
        makers
    }

    /// True if `me` made every partial.
    pub(crate) fn are_only(&self, me: &str) -> bool {
        self.unknown == 0 && self.workers.iter().all(|worker| worker == me)
    }
}

impl WorkerName {
    /// Returns the name for the files of partials.
    pub(crate) fn maker(&self) -> Maker {
        Maker { worker: self.worker.clone(), host: self.host.clone() }
    }
}

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
    /// Other workers that made partials of the tuple.
    #[serde(default, skip_serializing_if = "BTreeSet::is_empty")]
    pub with: BTreeSet<String>,
    /// Number of partials of the tuple with an unknown maker.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub unknown: u32,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_zero(count: &u32) -> bool {
    *count == 0
}

impl Provenance {
    /// Makes the record of a tuple that `worker` merges from partials of `makers`.
    pub(crate) fn new(scene: &SceneId, worker: &WorkerName, makers: &Makers) -> Self {
        let mut with = makers.workers.clone();
        with.remove(&worker.worker);
        Self {
            schema: RECEIPT_SCHEMA.to_owned(),
            scene: Some(scene.clone()),
            worker: Some(worker.worker.clone()),
            host: Some(worker.host.clone()),
            version: Some(env!("CARGO_PKG_VERSION").to_owned()),
            with,
            unknown: makers.unknown,
        }
    }

    /// Puts the record durably, beside those of other workers. Call it before the first file of the tuple is put.
    pub(crate) fn put(&self, store: &Store, scene: &SceneId) -> Result<(), StoreError> {
        let bytes = json_line(self);
        match store.create(&keys::receipt(scene), &bytes) {
            Ok(Put::New | Put::Same) => Ok(()),
            Err(StoreError::Differs { .. }) => {
                let digest = blake3::hash(&bytes).to_hex();
                store.create(&keys::further_receipt(scene, &digest[..16]), &bytes).map(|_| ())
            }
            Err(error) => Err(error),
        }
    }

    /// Returns the record of a scene's tuple: the first receipt, with the workers of all others.
    pub fn get(store: &Store, scene: &SceneId) -> Result<Option<Self>, StoreError> {
        let mut keys = store.list(&keys::further_receipts(scene))?;
        keys.sort();
        keys.insert(0, keys::receipt(scene));
        let found = store.get_all(&keys)?.into_iter().flatten();
        let mut receipts = found.map(|bytes| Self::parse(&bytes));
        let Some(mut first) = receipts.next() else {
            return Ok(None);
        };
        for other in receipts {
            first.with.extend(other.workers().cloned());
            first.unknown = first.unknown.max(other.unknown);
        }
        if let Some(worker) = &first.worker {
            first.with.remove(worker);
        }
        Ok(Some(first))
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
        let mut with: Vec<String> = self.with.iter().cloned().collect();
        if self.unknown > 0 {
            with.push(format!("unknown makers of {} partials", self.unknown));
        }
        if with.is_empty() { worker } else { format!("{worker} with {}", with.join(", ")) }
    }
}

/// `partials/<scene>/<start>-<end>.json`: a worker that put some partials of these shards. Versions before 0.2 wrote it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct PartialsProvenance {
    pub(crate) schema: String,
    /// First shard, and one past the last.
    pub(crate) shards: [u32; 2],
    pub(crate) worker: String,
    pub(crate) host: String,
}

impl PartialsProvenance {
    /// Reads the records among the keys of a scene's partials.
    fn read(store: &Store, partials: &[String]) -> Result<Vec<Self>, StoreError> {
        let mut keys: Vec<String> = partials.to_vec();
        keys.retain(|key| keys::shard_of(key).is_none());
        keys.sort();
        let found = store.get_all(&keys)?.into_iter().flatten();
        Ok(found.filter_map(|bytes| serde_json::from_slice(&bytes).ok()).collect())
    }
}

/// Returns the workers other than `me` that put a shard's partial, or (without a shard) a scene's tuple. If the partial
/// or the receipts name none, returns those that may have.
pub(crate) fn other_workers(
    store: &Store,
    scene: &SceneId,
    shard: Option<u32>,
    me: &str,
) -> Result<BTreeSet<String>, StoreError> {
    let is_of = |[start, end]: [u32; 2]| shard.is_none_or(|shard| (start..end).contains(&shard));
    let mut names = BTreeSet::new();
    if let Some(shard) = shard {
        let key = keys::partial(scene, shard);
        let there =
            store.get(&key)?.and_then(|bytes| partial::decode(Path::new(&key), &bytes).ok());
        names.extend(there.and_then(|there| there.maker).map(|maker| maker.worker));
    } else {
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

    fn makers(names: &[&str]) -> Makers {
        Makers { workers: names.iter().map(|name| (*name).to_owned()).collect(), unknown: 0 }
    }

    fn others(store: &Store, shard: Option<u32>, me: &str) -> Vec<String> {
        let scene = SceneId::new("s").unwrap();
        other_workers(store, &scene, shard, me).unwrap().into_iter().collect()
    }

    #[test]
    fn other_workers_are_those_of_the_shard_or_of_the_tuple() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::local(folder.path()).unwrap();
        for (name, shards) in [("a", [0, 8]), ("b", [8, 16])] {
            let note =
                format!(r#"{{"schema":"x","shards":{shards:?},"worker":"{name}","host":"h"}}"#);
            let key = format!("partials/s/{}-{}.json", shards[0], shards[1]);
            store.create(&key, note.as_bytes()).unwrap();
        }
        store.create("partials/s/000003.exr", b"x").unwrap();
        assert_eq!(others(&store, Some(3), "b"), ["a"]);
        assert_eq!(others(&store, Some(8), "a"), ["b"]);
        assert_eq!(others(&store, Some(8), "b"), [""; 0]);
        assert_eq!(others(&store, None, "c"), ["a", "b"]);
        store.create("receipts/s.json", br#"{"worker":"d"}"#).unwrap();
        assert_eq!(others(&store, None, "c"), ["d"]);
    }

    /// Two workers merge the same scene: whatever the order of their puts, both and their partials' makers are named.
    #[test]
    fn receipts_of_several_workers_add_up() {
        let scene = SceneId::new("s").unwrap();
        let first = Provenance::new(&scene, &who("a"), &makers(&["a", "b"]));
        let second = Provenance::new(&scene, &who("c"), &makers(&["b", "d"]));
        for order in [[&first, &second, &first], [&second, &first, &second]] {
            let folder = tempfile::tempdir().unwrap();
            let store = Store::local(folder.path()).unwrap();
            assert_eq!(Provenance::get(&store, &scene).unwrap(), None);
            for receipt in order {
                receipt.put(&store, &scene).unwrap();
            }
            let found = Provenance::get(&store, &scene).unwrap().unwrap();
            assert_eq!(found.worker, order[0].worker);
            let all: BTreeSet<&str> = found.workers().map(String::as_str).collect();
            assert_eq!(all, BTreeSet::from(["a", "b", "c", "d"]));
            assert_eq!(found.workers().count(), 4);
            assert_eq!(store.list("receipts").unwrap().len(), 2);
        }
    }

    #[test]
    fn partials_without_a_maker_are_counted() {
        let scene = SceneId::new("s").unwrap();
        let makers = Makers { unknown: 3, ..makers(&["a"]) };
        assert!(!makers.are_only("a"));
        let receipt = Provenance::new(&scene, &who("a"), &makers);
        assert_eq!(receipt.makers(), "a with unknown makers of 3 partials");
        assert_eq!(Provenance::parse(&json_line(&receipt)), receipt);
    }
}
