//! Takes scenes out of quarantine, to be tried again from the start of their attempts.

use super::keys;
use crate::store::{Store, StoreError};
use render::ids::SceneId;
use std::collections::BTreeSet;

/// Which scenes to try again.
#[derive(Clone, Copy, Debug)]
pub enum RetryScenes<'a> {
    /// All that are in quarantine.
    All,
    /// These, each of which must be.
    These(&'a [SceneId]),
    /// These, whatever is there of them: it is removed, and they are made from nothing.
    Anew(&'a [SceneId]),
}

/// What was done.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Retried {
    /// No longer in quarantine, in the manifest's order.
    #[serde(rename = "retried")]
    pub scenes: Vec<SceneId>,
    /// Records of lost attempts that were removed with them.
    #[serde(rename = "attempts_removed")]
    pub attempts: u64,
    /// Files of tuples, partials and receipts that were removed.
    #[serde(rename = "results_removed")]
    pub results: u64,
    /// The run counted as finished, so its coordinator and workers have gone home.
    pub was_finished: bool,
}

/// Why scenes cannot be tried again.
#[derive(Debug, thiserror::Error)]
pub enum RetryError {
    /// The store cannot be used.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// Some are not what they should be.
    #[error("{0}; nothing was changed")]
    Refused(String),
}

/// Removes the records of quarantine and of attempts of `which`, of a run whose scenes are `manifest`, and of those that
/// are to be made anew all results; with `dry_run` only looks. If one of them is not what it should be nothing is changed.
pub fn retry(
    store: &Store,
    manifest: &[SceneId],
    which: RetryScenes,
    dry_run: bool,
) -> Result<Retried, RetryError> {
    let there: BTreeSet<String> = store.list(keys::QUARANTINE)?.into_iter().collect();
    let is_in = |scene: &SceneId| there.contains(&keys::quarantine(scene));
    let is_known = |scene: &SceneId| manifest.contains(scene);
    let wrong: Vec<&SceneId> = match which {
        RetryScenes::All => Vec::new(),
        RetryScenes::These(scenes) => scenes.iter().filter(|scene| !is_in(scene)).collect(),
        RetryScenes::Anew(scenes) => scenes.iter().filter(|scene| !is_known(scene)).collect(),
    };
    if !wrong.is_empty() {
        return Err(RetryError::Refused(refusal(store, manifest, &wrong)?));
    }
    let asked = |scene: &SceneId| match which {
        RetryScenes::All => is_in(scene),
        RetryScenes::These(scenes) | RetryScenes::Anew(scenes) => scenes.contains(scene),
    };
    let mut retried = Retried {
        was_finished: store.get(keys::FINISHED)?.is_some(),
        ..Retried::default()
    };
    for scene in manifest.iter().filter(|s| asked(s)) {
        let attempts = store.list(&keys::attempts(scene))?;
        let results = if matches!(which, RetryScenes::Anew(_)) {
            results(store, scene)?
        } else {
            Vec::new()
        };
        // Not counted: it is no result, and may be missing.
        let noise = [keys::noise(scene)];
        retried.attempts += attempts.len() as u64;
        retried.results += results.len() as u64;
        retried.scenes.push(scene.clone());
        if !dry_run {
            store.delete(&results)?;
            if matches!(which, RetryScenes::Anew(_)) {
                store.delete(&noise)?;
            }
            // In this order, so that who is killed in between leaves it in quarantine, not free with old attempts.
            store.delete(&attempts)?;
            store.delete(&[keys::quarantine(scene)])?;
        }
    }
    if !dry_run && !retried.scenes.is_empty() {
        store.delete(&[keys::FINISHED.to_owned()])?;
    }
    Ok(retried)
}

/// All that was made of a scene: first what says that it is done.
fn results(store: &Store, scene: &SceneId) -> Result<Vec<String>, StoreError> {
    let record = keys::tuple(scene, "tuple.json");
    let mut results = store.list(&format!("{}/{scene}", keys::TUPLES))?;
    results.sort_by_key(|key| *key != record);
    results.extend(store.list(&keys::partials(scene))?);
    let receipt = keys::receipt(scene);
    if store.get(&receipt)?.is_some() {
        results.push(receipt);
    }
    Ok(results)
}

/// Says of each what it is instead.
fn refusal(store: &Store, manifest: &[SceneId], wrong: &[&SceneId]) -> Result<String, StoreError> {
    let mut reasons = Vec::new();
    for scene in wrong {
        reasons.push(if !manifest.contains(scene) {
            format!("{scene} is no scene of this run")
        } else if store.get(&keys::tuple(scene, "tuple.json"))?.is_some() {
            format!("{scene} is not in quarantine: it is done")
        } else {
            format!("{scene} is not in quarantine: it waits or is being made")
        });
    }
    Ok(reasons.join("; "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::QuarantineRecord;

    #[test]
    fn only_what_is_in_quarantine_is_taken_out() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::local(folder.path()).unwrap();
        let id = |text: &str| SceneId::new(text).unwrap();
        let manifest = [id("a"), id("b"), id("c"), id("d")];
        for scene in &manifest[..2] {
            QuarantineRecord::put(&store, scene, "no depth").unwrap();
            let attempt = format!("{}/0-4.1.json", keys::attempts(scene));
            store.create(&attempt, b"{}").unwrap();
        }
        store.create("attempts/c/0-4.1.json", b"{}").unwrap();
        store.create("tuples/d/tuple.json", b"{}").unwrap();
        store.create(keys::FINISHED, b"{}").unwrap();

        let wrong = [id("a"), id("c"), id("d"), id("e")];
        let error = retry(&store, &manifest, RetryScenes::These(&wrong), false).unwrap_err();
        let text = error.to_string();
        for part in [
            "c is not in quarantine: it waits",
            "d is not in quarantine: it is done",
            "e is no scene",
        ] {
            assert!(text.contains(part), "{text}");
        }
        assert_eq!(store.list(keys::QUARANTINE).unwrap().len(), 2);

        let one = [id("b")];
        let would = retry(&store, &manifest, RetryScenes::These(&one), true).unwrap();
        assert_eq!(store.list(keys::QUARANTINE).unwrap().len(), 2);
        let done = retry(&store, &manifest, RetryScenes::These(&one), false).unwrap();
        assert_eq!(would, done);
        assert_eq!((done.scenes, done.attempts), (vec![id("b")], 1));
        assert!(done.was_finished);
        assert_eq!(store.get(keys::FINISHED).unwrap(), None);
        assert!(store.list("attempts/b").unwrap().is_empty());

        let rest = retry(&store, &manifest, RetryScenes::All, false).unwrap();
        assert_eq!(rest.scenes, [id("a")]);
        assert!(store.list(keys::QUARANTINE).unwrap().is_empty());
        assert_eq!(store.list("attempts/c").unwrap().len(), 1);
        let none = retry(&store, &manifest, RetryScenes::All, false).unwrap();
        assert_eq!(none, Retried::default());
    }
}
