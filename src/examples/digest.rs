//! Digests of the data of a training, which its checkpoints record.

use glasshouse_line::SceneLine;
use render::shard::scene_digest;

/// Returns the BLAKE3 (hex) of scene lines, in order.
pub fn scenes_digest(lines: &[SceneLine]) -> String {
    digest_of(lines.iter().map(scene_digest))
}

/// Returns the BLAKE3 (hex) of texts, each followed by a line break.
pub fn digest_of(parts: impl Iterator<Item = String>) -> String {
    let mut hasher = blake3::Hasher::new();
    for part in parts {
        hasher.update(part.as_bytes());
        hasher.update(b"\n");
    }
    hasher.finalize().to_hex().to_string()
}
