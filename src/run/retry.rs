//! `retry`: takes scenes out of quarantine and removes their attempts, or resets scenes.

use super::keys;
use crate::store::{Store, StoreError};
use glasshouse_line::ids::SceneId;
use std::collections::BTreeSet;

/// Scenes to try again.
#[derive(Clone, Copy, Debug)]
pub enum RetryScenes<'a> {
    /// All scenes in quarantine.
    All,
    /// These scenes, which must be in quarantine.
    These(&'a [SceneId]),
    /// These scenes, in any state; `retry` removes all their results.
    Anew(&'a [SceneId]),
}

/// Result of [`retry`].
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Retried {
    /// Scenes to try again, in the manifest's order.
    #[serde(rename = "retried")]
    pub scenes: Vec<SceneId>,
    /// Number of removed records of attempts.
    #[serde(rename = "attempts_removed")]
    pub attempts: u64,
    /// Number of removed files of tuples, partials and provenance.
    #[serde(rename = "results_removed")]
    pub results: u64,
    /// True if the run was finished, so that its coordinator and workers have ended.
    pub was_finished: bool,
}

/// Reason why scenes cannot be tried again.
#[derive(Debug, thiserror::Error)]
pub enum RetryError {
    /// The store cannot be used.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// Some scenes are not in quarantine or not in the manifest.
    #[error("{0}; nothing was changed")]
    Refused(String),
}

/// Removes the quarantine records and attempts of `which`, and all results of [`RetryScenes::Anew`], from a run with
/// the scenes `manifest`; with `dry_run`, only counts them. A refusal changes nothing.
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
    let mut retried =
        Retried { was_finished: store.get(keys::FINISHED)?.is_some(), ..Retried::default() };
    let chosen: Vec<&SceneId> = manifest.iter().filter(|scene| asked(scene)).collect();
    if !dry_run && !chosen.is_empty() {
        // The mark goes first: a kill before the end leaves a run that is open and has too few open scenes, which another
        // `retry` completes; a mark that went last would leave a finished run with open scenes, which no worker does.
        store.delete(&[keys::FINISHED.to_owned()])?;
    }
    for scene in chosen {
        let is_anew = matches!(which, RetryScenes::Anew(_));
        let attempts = store.list(&keys::attempts(scene))?;
        let results = if is_anew { results(store, scene)? } else { Vec::new() };
        retried.attempts += attempts.len() as u64;
        retried.results += results.len() as u64;
        retried.scenes.push(scene.clone());
        if !dry_run {
            // The first key is the tuple's record, if it exists; one call would remove all keys in any order.
            let (record, rest) = results.split_at(results.len().min(1));
            store.delete(record)?;
            store.delete(rest)?;
            if is_anew {
                // The noise map is not a result and may be missing, so the count leaves it out.
                store.delete(&[keys::noise(scene)])?;
            }
            // The quarantine record goes last, because a scene out of quarantine must have no old attempts.
            store.delete(&attempts)?;
            store.delete(&[keys::quarantine(scene)])?;
        }
    }
    Ok(retried)
}

/// Returns the keys of all results of a scene, the tuple's record first: without its record, the tuple is not done.
fn results(store: &Store, scene: &SceneId) -> Result<Vec<String>, StoreError> {
    let record = keys::tuple_record(scene);
    let mut results = store.list(&keys::tuple_folder(scene))?;
    results.sort_by_key(|key| *key != record);
    results.extend(store.list(&keys::partials(scene))?);
    results.extend(store.list(&keys::further_receipts(scene))?);
    let receipt = keys::receipt(scene);
    if store.get(&receipt)?.is_some() {
        results.push(receipt);
    }
    Ok(results)
}

/// Describes the state of each refused scene.
fn refusal(store: &Store, manifest: &[SceneId], wrong: &[&SceneId]) -> Result<String, StoreError> {
    let mut reasons = Vec::new();
    for scene in wrong {
        reasons.push(if !manifest.contains(scene) {
            format!("{scene} is not a scene of this run")
        } else if store.get(&keys::tuple_record(scene))?.is_some() {
            format!("{scene} is not in quarantine: it is done")
        } else {
            format!("{scene} is not in quarantine: it is waiting or in progress")
        });
    }
    Ok(reasons.join("; "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::QuarantineRecord;

    #[test]
    fn only_scenes_in_quarantine_are_retried() {
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
            "c is not in quarantine: it is waiting",
            "d is not in quarantine: it is done",
            "e is not a scene",
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
