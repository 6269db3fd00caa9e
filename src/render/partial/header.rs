//! JSON header of a partial.

use crate::scene::{InputDigests, SceneFacts};
use crate::trace::Tile;
use glasshouse_line::ids::SceneId;
use glasshouse_line::layer::{Layer, PerLayer};
use serde::{Deserialize, Serialize};

/// Schema name of a partial's header.
pub const PARTIAL_SCHEMA: &str = "glasshouse.partial/2";

/// Description and provenance of a shard's result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartialHeader {
    /// Always [`PARTIAL_SCHEMA`].
    pub schema: String,
    /// Version of the tracer that made the partial.
    pub tracer_version: u32,
    pub scene: SceneId,
    /// BLAKE3 of the scene's manifest line.
    pub line_blake3: String,
    /// BLAKE3 of the scene's input files.
    pub inputs: InputDigests,
    /// Index of the shard in the scene.
    pub shard: u32,
    /// Film size `[width, height]`, px.
    pub film: [u32; 2],
    pub tile: Tile,
    /// Half-open range of sample indices.
    pub samples: [u32; 2],
    /// Samples per pixel of each layer, as in [`crate::trace::TileResult::samples`].
    pub layer_samples: PerLayer<u32>,
    /// Samples of each layer, summed over the pixels; only for adaptive scenes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sample_sums: Option<PerLayer<u64>>,
    /// Number of paths of each layer.
    pub paths: PerLayer<u64>,
    /// Number of misses of each layer.
    pub misses: PerLayer<u64>,
    pub facts: SceneFacts,
    /// BLAKE3 of this header with this field empty, and of the pixels' bits.
    pub blake3: String,
}

impl PartialHeader {
    /// True if the layer is in closed form: it has paths, but no samples.
    pub fn is_closed_form(&self, layer: Layer) -> bool {
        self.layer_samples[layer] == 0 && self.paths[layer] > 0
    }

    /// Formats the header as the JSON text of the file.
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).expect("a header of plain numbers and strings is JSON")
    }
}
