//! The JSON attribute of a partial.

use crate::ids::SceneId;
use crate::layer::PerLayer;
use crate::scene::{InputDigests, SceneFacts};
use crate::trace::Tile;
use serde::{Deserialize, Serialize};

/// The schema name of a partial's header.
pub const PARTIAL_SCHEMA: &str = "glasshouse.partial/2";

/// Description of a shard's result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartialHeader {
    /// Always [`PARTIAL_SCHEMA`].
    pub schema: String,
    /// Version of the tracer that made it.
    pub tracer_version: u32,
    pub scene: SceneId,
    /// BLAKE3 of the scene's manifest line.
    pub line_blake3: String,
    /// BLAKE3 of the scene's input files.
    pub inputs: InputDigests,
    /// Shard number in the scene.
    pub shard: u32,
    /// Film size `[width, height]`, px.
    pub film: [u32; 2],
    pub tile: Tile,
    /// Half-open range of sample indices.
    pub samples: [u32; 2],
    /// Samples per pixel of each layer.
    pub layer_samples: PerLayer<u32>,
    /// Only for adaptive scenes: samples of each layer, summed over the pixels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sample_sums: Option<PerLayer<u64>>,
    /// Paths of each layer.
    pub paths: PerLayer<u64>,
    /// Paths that ended on the border's continuation.
    pub misses: PerLayer<u64>,
    /// Facts about the scene.
    pub facts: SceneFacts,
    /// BLAKE3 of this header without this field, and of the pixels' bits.
    pub blake3: String,
}

impl PartialHeader {
    /// As in the file.
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).expect("a header of plain numbers and strings is JSON")
    }
}
