//! Names of a run's objects: files of the run directory, keys of an object store.

use render::ids::SceneId;

/// Frozen rules.
pub const SPEC: &str = "spec.json";
/// Every scene, one a line.
pub const MANIFEST: &str = "manifest.jsonl";
/// Written by the coordinator when nothing is left to do.
pub const FINISHED: &str = "finished.json";
/// Folder of the pictures that planning made, if it made any.
pub const INPUTS: &str = "inputs";
/// What the run has been told to do, if not simply to go on.
pub const CONTROL: &str = "control.json";
/// Folder of all tuples.
pub const TUPLES: &str = "tuples";
/// Folder of the reasons for quarantine.
pub const QUARANTINE: &str = "quarantine";
/// Folder of maps of where tuples are uncertain; not part of what comes out.
pub const NOISE: &str = "noise";
/// Folder of what workers wrote down of themselves when they ended; not part of what comes out.
pub const LOGS: &str = "logs";
/// Folder of all partials.
pub const PARTIALS: &str = "partials";
/// Folder of the attempts that stand.
pub const ATTEMPTS: &str = "attempts";
/// Folder of what was made otherwise than what is there.
pub const CONFLICTS: &str = "conflicts";
/// Folder of who made what.
pub const RECEIPTS: &str = "receipts";

/// Folder of a scene's partials.
pub fn partials(scene: &SceneId) -> String {
    format!("{PARTIALS}/{scene}")
}

/// A shard's partial.
pub fn partial(scene: &SceneId, shard: u32) -> String {
    format!("{PARTIALS}/{scene}/{shard:06}.exr")
}

/// The shard of a [`partial`]'s name.
pub fn shard_of(key: &str) -> Option<u32> {
    key.rsplit('/').next()?.strip_suffix(".exr")?.parse().ok()
}

/// Who made some of a scene's partials.
pub fn made_by(scene: &SceneId, [start, end]: [u32; 2]) -> String {
    format!("{PARTIALS}/{scene}/{start}-{end}.json")
}

/// What a worker made of the object under `key`, when another had put other bytes there.
pub fn conflict(worker: &str, key: &str) -> String {
    format!("{CONFLICTS}/{worker}/{key}")
}

/// A file of a scene's tuple.
pub fn tuple(scene: &SceneId, file: &str) -> String {
    format!("{TUPLES}/{scene}/{file}")
}

/// The map of a scene's noise, beside its tuple.
pub fn noise(scene: &SceneId) -> String {
    format!("{NOISE}/{scene}.exr")
}

/// A scene's reason for quarantine.
pub fn quarantine(scene: &SceneId) -> String {
    format!("{QUARANTINE}/{scene}.json")
}

/// Folder of the attempts at a scene.
pub fn attempts(scene: &SceneId) -> String {
    format!("{ATTEMPTS}/{scene}")
}

/// Attempt `n` at a scene's shards (first, and one past the last).
pub fn attempt(scene: &SceneId, [start, end]: [u32; 2], n: u32) -> String {
    format!("{ATTEMPTS}/{scene}/{start}-{end}.{n}.json")
}

/// The shards and the number of an [`attempt`]'s name.
pub fn attempt_of(key: &str) -> Option<([u32; 2], u32)> {
    let (shards, n) = key
        .rsplit('/')
        .next()?
        .strip_suffix(".json")?
        .split_once('.')?;
    let (start, end) = shards.split_once('-')?;
    Some(([start.parse().ok()?, end.parse().ok()?], n.parse().ok()?))
}

/// Who made a scene's tuple, when it was made by a farm; not part of what comes out.
pub fn receipt(scene: &SceneId) -> String {
    format!("{RECEIPTS}/{scene}.json")
}
