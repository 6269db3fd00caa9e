//! A tuple: the four images of a scene and their provenance.

use super::noise::NoiseMap;
use crate::layer::{Layer, PerLayer};
use crate::line::SceneLine;
use crate::scene::{InputDigests, SceneFacts};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The schema name of `tuple.json`.
pub const TUPLE_SCHEMA: &str = "glasshouse.tuple/1";

/// Four linear Rec.709 images and their record.
#[derive(Clone, Debug, PartialEq)]
pub struct Tuple {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Row by row. A layer that was not asked for is empty.
    pub layers: PerLayer<Vec<[f32; 3]>>,
    /// `tuple.json`.
    pub record: TupleRecord,
    /// Written beside the tuple; not part of it.
    pub noise: NoiseMap,
}

impl Tuple {
    /// The layers that were asked for.
    pub fn made(&self) -> impl Iterator<Item = (Layer, &Vec<[f32; 3]>)> {
        self.layers.iter().filter(|(_, pixels)| !pixels.is_empty())
    }
}

/// `tuple.json`: everything needed to reproduce the tuple, without anything that differs between equal runs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TupleRecord {
    /// Always [`TUPLE_SCHEMA`].
    pub schema: String,
    pub tracer_version: u32,
    /// Folder that the scene's relative paths start from, relative to this file's folder.
    pub base: String,
    /// By name: `input`, `transmission`, `glass_reflection`, `clean_reflection`.
    pub layers: BTreeMap<String, LayerRecord>,
    /// Focus, orders, dropped tail, shares.
    pub facts: SceneFacts,
    /// Digests of the input files.
    pub inputs: InputDigests,
    pub scene: SceneLine,
}

/// Statistics of one layer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LayerRecord {
    /// Samples per pixel; in adaptive scenes the maximum.
    pub samples: u32,
    /// Mean over the pixels of adaptive scenes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mean_samples: Option<f64>,
    /// Estimated RMS error of the layer, linear (see [`crate::trace::square_error`]); `null` where one sample has no
    /// halves.
    pub error_rms: Option<f64>,
    /// Mean of all pixels and colours, linear.
    pub mean: f64,
    /// Largest value, linear.
    pub max: f64,
    /// Share of the values above 1, which the PNG clips.
    pub clipped_share: f64,
    /// Share of the paths that ended on the continuation of a photograph's border.
    pub miss_share: f64,
    /// BLAKE3 of the pixels as 32-bit floats (little endian, R G B, row by row).
    pub blake3: String,
    /// The same of the pixels as rounded to half floats in `tuple.exr`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exr_blake3: Option<String>,
}

impl LayerRecord {
    /// Computes the statistics of a layer.
    pub fn new(
        pixels: &[[f32; 3]],
        samples: u32,
        error_rms: Option<f64>,
        paths: u64,
        misses: u64,
    ) -> Self {
        let values = pixels.as_flattened();
        let count = values.len() as f64;
        Self {
            samples,
            mean_samples: None,
            error_rms,
            mean: values.iter().map(|&v| f64::from(v)).sum::<f64>() / count,
            max: f64::from(values.iter().fold(0f32, |m, &v| v.max(m))),
            clipped_share: values.iter().filter(|&&v| v > 1.0).count() as f64 / count,
            miss_share: misses as f64 / paths.max(1) as f64,
            blake3: layer_digest(pixels),
            exr_blake3: None,
        }
    }
}

pub(super) fn layer_digest(pixels: &[[f32; 3]]) -> String {
    let values = pixels.as_flattened();
    let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    blake3::hash(&bytes).to_hex().to_string()
}
