//! Names of a run's objects: keys in an object store, paths below the run's folder.

use glasshouse_line::SceneLine;
use glasshouse_line::ids::SceneId;
use render::merge::tuple_files;

/// The run's spec. Planning writes it last, and it never changes.
pub const SPEC: &str = "spec.json";
/// All scenes, one per line.
pub const MANIFEST: &str = "manifest.jsonl";
/// Scenes that planning drew, previewed and rejected.
pub(crate) const REJECTED: &str = "rejected.jsonl";
/// File that is locked by the process that works on the run's folder.
pub(crate) const LOCK: &str = "work.lock";
/// Record that the coordinator writes when every scene is done or in quarantine.
pub const FINISHED: &str = "finished.json";
/// The recipe's `[train]` table, if it has one.
pub(crate) const TRAIN: &str = "train.json";
/// Folder of procedural photographs, if planning made any.
pub const INPUTS: &str = "inputs";
/// Record that pauses or cancels the run.
pub const CONTROL: &str = "control.json";
/// Folder of all tuples.
pub const TUPLES: &str = "tuples";
/// Folder of the scenes in quarantine.
pub const QUARANTINE: &str = "quarantine";
/// Folder of noise maps, which do not belong to the tuples.
pub const NOISE: &str = "noise";
/// Folder of the logs that workers write when they end.
pub const LOGS: &str = "logs";
/// Folder of all partials.
pub const PARTIALS: &str = "partials";
/// Folder of the records of running and failed attempts.
pub const ATTEMPTS: &str = "attempts";
/// Folder of results that differ from those in the store.
pub const CONFLICTS: &str = "conflicts";
/// Folder of the tuples' provenance.
pub const RECEIPTS: &str = "receipts";
pub(crate) const REPORT: &str = "report/index.html";

/// Folders in which only commands on the run write.
pub(crate) const OBJECTS: [&str; 9] =
    [INPUTS, TUPLES, QUARANTINE, NOISE, LOGS, PARTIALS, ATTEMPTS, CONFLICTS, RECEIPTS];

/// Record of a tuple, its last file.
const RECORD: &str = "tuple.json";

/// Returns the scene of a key such as `partials/<scene>/000001.exr` or `receipts/<scene>.json`.
pub(crate) fn scene_of(key: &str) -> Option<&str> {
    let (_, rest) = key.split_once('/')?;
    match rest.split_once('/') {
        Some((scene, _)) => Some(scene),
        None => rest.strip_suffix(".json"),
    }
}

/// Returns the folder of a scene's partials.
pub fn partials(scene: &SceneId) -> String {
    format!("{PARTIALS}/{scene}")
}

pub fn partial(scene: &SceneId, shard: u32) -> String {
    format!("{PARTIALS}/{scene}/{shard:06}.exr")
}

/// Returns the shard of a [`partial`]'s key.
pub fn shard_of(key: &str) -> Option<u32> {
    key.rsplit('/').next()?.strip_suffix(".exr")?.parse().ok()
}

/// Returns the key under which `worker` puts its result for `key` if the store holds another result.
pub fn conflict(worker: &str, key: &str) -> String {
    format!("{CONFLICTS}/{worker}/{key}")
}

/// Returns the folder of a scene's tuple.
pub(crate) fn tuple_folder(scene: &SceneId) -> String {
    format!("{TUPLES}/{scene}")
}

/// Returns the key of a file of a scene's tuple.
pub fn tuple(scene: &SceneId, file: &str) -> String {
    format!("{TUPLES}/{scene}/{file}")
}

/// Returns the keys of all files of a scene's tuple, its record last.
pub(crate) fn tuple_keys(line: &SceneLine) -> impl Iterator<Item = String> {
    let files = tuple_files(line).into_iter();
    files.map(|file| tuple(&line.id, &file))
}

/// Returns the key of a scene's `tuple.json`, which is written after the tuple's other files.
pub(crate) fn tuple_record(scene: &SceneId) -> String {
    tuple(scene, RECORD)
}

/// Returns the key of a scene's noise map.
pub fn noise(scene: &SceneId) -> String {
    format!("{NOISE}/{scene}.exr")
}

/// Returns the key of a scene's quarantine record.
pub fn quarantine(scene: &SceneId) -> String {
    format!("{QUARANTINE}/{scene}.json")
}

/// Returns the folder of the attempts at a scene.
pub fn attempts(scene: &SceneId) -> String {
    format!("{ATTEMPTS}/{scene}")
}

/// Returns the key of attempt `n` at a scene's shards from `start` to `end`.
pub fn attempt(scene: &SceneId, [start, end]: [u32; 2], n: u32) -> String {
    format!("{ATTEMPTS}/{scene}/{start}-{end}.{n}.json")
}

/// Returns the key that the worker of an [`attempt`] puts again and again as a sign of life.
pub(crate) fn sign(scene: &SceneId, [start, end]: [u32; 2], n: u32) -> String {
    format!("{ATTEMPTS}/{scene}/{start}-{end}.{n}.sign")
}

/// Returns the shards and the number of an [`attempt`]'s key.
pub fn attempt_of(key: &str) -> Option<([u32; 2], u32)> {
    let (shards, n) = key.rsplit('/').next()?.strip_suffix(".json")?.split_once('.')?;
    let (start, end) = shards.split_once('-')?;
    Some(([start.parse().ok()?, end.parse().ok()?], n.parse().ok()?))
}

/// Returns the key of the first provenance of a scene's tuple, which exists if a farm made the tuple.
pub fn receipt(scene: &SceneId) -> String {
    format!("{RECEIPTS}/{scene}.json")
}

/// Returns the folder of the receipts of all workers but the first that merged a scene.
pub(crate) fn further_receipts(scene: &SceneId) -> String {
    format!("{RECEIPTS}/{scene}")
}

/// Returns the key of a receipt in [`further_receipts`]; `digest` is the receipt's.
pub(crate) fn further_receipt(scene: &SceneId, digest: &str) -> String {
    format!("{RECEIPTS}/{scene}/{digest}.json")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_read_back() {
        let scene = SceneId::new("train-1").unwrap();
        for key in [
            partial(&scene, 7),
            tuple_record(&scene),
            receipt(&scene),
            quarantine(&scene),
            attempt(&scene, [3, 64], 2),
        ] {
            assert_eq!(scene_of(&key), Some("train-1"), "{key}");
        }
        assert_eq!(scene_of("quarantine/notes.txt"), None);
        assert_eq!(scene_of(SPEC), None);
        assert_eq!(shard_of(&partial(&scene, 7)), Some(7));
        assert_eq!(shard_of("partials/train-1/0-7.json"), None);
        assert_eq!(scene_of(&further_receipt(&scene, "0123")), Some("train-1"));
        assert_eq!(attempt_of(&attempt(&scene, [3, 64], 2)), Some(([3, 64], 2)));
        assert_eq!(attempt_of(&sign(&scene, [3, 64], 2)), None);
        assert_eq!(attempt_of("attempts/train-1/notes.json"), None);
    }
}
