//! Names of a run's objects: files of the run directory, keys of an object store.

use crate::ids::SceneId;

/// Frozen rules.
pub const SPEC: &str = "spec.json";
/// Every scene, one a line.
pub const MANIFEST: &str = "manifest.jsonl";
/// Written by the coordinator when nothing is left to do.
pub const FINISHED: &str = "finished.json";
/// Folder of all tuples.
pub const TUPLES: &str = "tuples";
/// Folder of the reasons for quarantine.
pub const QUARANTINE: &str = "quarantine";

/// Folder of a scene's partials.
pub fn partials(scene: &SceneId) -> String {
    format!("partials/{scene}")
}

/// A shard's partial.
pub fn partial(scene: &SceneId, shard: u32) -> String {
    format!("partials/{scene}/{shard:06}.exr")
}

/// The shard of a [`partial`]'s name.
pub fn shard_of(key: &str) -> Option<u32> {
    key.rsplit('/').next()?.strip_suffix(".exr")?.parse().ok()
}

/// A file of a scene's tuple.
pub fn tuple(scene: &SceneId, file: &str) -> String {
    format!("{TUPLES}/{scene}/{file}")
}

/// A scene's reason for quarantine.
pub fn quarantine(scene: &SceneId) -> String {
    format!("{QUARANTINE}/{scene}.json")
}

/// Who made a scene's tuple, when it was made by a farm; not part of what comes out.
pub fn receipt(scene: &SceneId) -> String {
    format!("receipts/{scene}.json")
}
