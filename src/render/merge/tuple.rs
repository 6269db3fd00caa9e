//! A tuple: the images of a scene, up to four, and their provenance.

use super::noise::NoiseMap;
use super::photographs::PhotographRecord;
use super::write::tuple_images;
use crate::formats::exr_labels::label_precision;
use crate::scene::{InputDigests, MISSED_SHARE, SceneFacts};
use exr::prelude::f16;
use glasshouse_line::label::{Label, LabelImages};
use glasshouse_line::layer::{Layer, PerLayer};
use glasshouse_line::{ExrPrecision, SceneLine};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Schema name of `tuple.json`.
pub const TUPLE_SCHEMA: &str = "glasshouse.tuple/2";
/// Older schema, without digests of the files.
pub const TUPLE_SCHEMA_1: &str = "glasshouse.tuple/1";

/// Up to four linear Rec.709 images and their record.
#[derive(Clone, Debug, PartialEq)]
pub struct Tuple {
    /// Width, px.
    pub width: u32,
    /// Height, px.
    pub height: u32,
    /// Pixels of each layer, row by row; empty for layers that the scene does not request.
    pub layers: PerLayer<Vec<[f32; 3]>>,
    /// Labels that the scene requests.
    pub labels: LabelImages,
    /// Content of `tuple.json`.
    pub record: TupleRecord,
    /// Noise map; not part of the tuple's files.
    pub noise: NoiseMap,
}

impl Tuple {
    /// Iterates over the requested layers.
    pub fn made(&self) -> impl Iterator<Item = (Layer, &Vec<[f32; 3]>)> {
        self.layers.iter().filter(|(_, pixels)| !pixels.is_empty())
    }
}

/// Content of `tuple.json`: statistics and provenance of a tuple, without data that differ between equal runs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TupleRecord {
    /// [`TUPLE_SCHEMA`] or, in tuples of older versions of the program, [`TUPLE_SCHEMA_1`].
    pub schema: String,
    pub tracer_version: u32,
    /// BLAKE3 of each other file of the tuple, by its name; empty with [`TUPLE_SCHEMA_1`].
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub files: BTreeMap<String, String>,
    /// Base folder of the scene's relative paths, relative to this file's folder.
    pub base: String,
    /// Statistics of each requested layer by its name: `input`, `transmission`, `glass_reflection`, `clean_reflection`.
    pub layers: BTreeMap<String, LayerRecord>,
    /// Statistics of each requested label by its name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub labels: BTreeMap<String, LabelRecord>,
    /// Version and exposure of the photographs, if the scene has a sensor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub photographs: Option<PhotographRecord>,
    /// Facts from loading the scene, such as focus, orders and dropped light.
    pub facts: SceneFacts,
    /// Digests of the input files.
    pub inputs: InputDigests,
    pub scene: SceneLine,
}

impl TupleRecord {
    /// Parses the content of `tuple.json`.
    pub fn parse(json: &[u8]) -> Result<Self, serde_json::Error> {
        let text = std::str::from_utf8(json).map_err(serde::de::Error::custom)?;
        serde_json::from_str(text)
    }

    /// Compares the bytes of a file with its digest. Accepts all bytes if the record has no digests
    /// ([`TUPLE_SCHEMA_1`]). An error is a text for the user.
    pub fn check_file(&self, name: &str, bytes: &[u8]) -> Result<(), String> {
        match self.files.get(name) {
            Some(digest) if *digest == file_digest(bytes) => Ok(()),
            Some(_) => Err("its bytes do not match their digest in tuple.json".to_owned()),
            None if self.files.is_empty() => Ok(()),
            None => Err("tuple.json has no digest of it".to_owned()),
        }
    }

    /// Checks that the record has statistics of its scene's layers, and digests of the tuple's files or an older schema
    /// without them. An error is a text for the user.
    pub fn check_complete(&self) -> Result<(), String> {
        let layers = self.scene.film.layers.names();
        if let Some(name) = layers.into_iter().find(|name| !self.layers.contains_key(*name)) {
            return Err(format!("`layers` lacks the scene's layer {name}"));
        }
        let labels = self.scene.film.layers.labels();
        if let Some(label) = labels.iter().find(|label| !self.labels.contains_key(label.name())) {
            return Err(format!("`labels` lacks the scene's label {label}"));
        }
        if self.scene.sensor.is_some() != self.photographs.is_some() {
            return Err(
                "`photographs` must be given if and only if the scene has a sensor".to_owned()
            );
        }
        let is_name = |name: &&String| !name.contains(['/', '\\']);
        if let Some(name) = self.files.keys().find(|name| !is_name(name)) {
            return Err(format!("`files` has {name:?}, which is not the name of a file beside it"));
        }
        match self.schema.as_str() {
            TUPLE_SCHEMA => {
                let images = tuple_images(&self.scene);
                match images.iter().find(|name| !self.files.contains_key(*name)) {
                    Some(name) => Err(format!("`files` lacks the digest of {name}")),
                    None => Ok(()),
                }
            }
            TUPLE_SCHEMA_1 if self.files.is_empty() => Ok(()),
            TUPLE_SCHEMA_1 => Err(format!("{TUPLE_SCHEMA_1} has no `files`")),
            other => Err(format!("its schema is {other:?}")),
        }
    }
}

/// Computes the digest of a tuple's file for [`TupleRecord::files`].
pub(super) fn file_digest(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex().to_string()
}

/// Statistics of one layer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LayerRecord {
    /// Samples per pixel of the layer's strongest order; in adaptive scenes the maximum. 0 if the layer is in closed form.
    pub samples: u32,
    /// Mean number of samples per pixel; only for adaptive scenes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mean_samples: Option<f64>,
    /// Estimated RMS error of the layer, linear (see [`crate::trace::square_error`]): 0 in closed form, and `null` for a
    /// single sample, which has no half.
    pub error_rms: Option<f64>,
    /// Bound of the light that is in a wrong order, linear, of any pixel and colour (`facts.dropped`); only of I and R~.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dropped: Option<f64>,
    /// Bound of the light that rough faces take from the layer, linear, of any pixel and colour (`facts.shadowed`); only of I and R~.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shadowed: Option<f64>,
    /// Mean over all pixels and colours, linear.
    pub mean: f64,
    /// Largest value, linear.
    pub max: f64,
    /// Share of the values above 1, which the PNG clips.
    pub clipped_share: f64,
    /// Share of the paths that ended on the continuation of a photograph's border or hit no triangle of a mesh.
    pub miss_share: f64,
    /// BLAKE3 of the pixels as 32-bit floats (little endian, R G B, row by row).
    pub blake3: String,
    /// BLAKE3 of the pixels after rounding, if `tuple.exr` has half floats.
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
            dropped: None,
            shadowed: None,
            mean: values.iter().map(|&v| f64::from(v)).sum::<f64>() / count,
            max: f64::from(values.iter().fold(0f32, |m, &v| v.max(m))),
            clipped_share: values.iter().filter(|&&v| v > 1.0).count() as f64 / count,
            miss_share: misses as f64 / paths.max(1) as f64,
            blake3: layer_digest(pixels),
            exr_blake3: None,
        }
    }
}

impl LayerRecord {
    /// Sets the bounds of misplaced and of lost light.
    pub(super) fn bound(&mut self, layer: Layer, facts: &SceneFacts) {
        let dropped = match layer {
            Layer::Input => facts.dropped.front + facts.dropped.back,
            Layer::GlassReflection => facts.dropped.back,
            Layer::Transmission | Layer::CleanReflection => return,
        };
        (self.dropped, self.shadowed) = (Some(dropped), Some(facts.shadowed));
    }
}

/// Share of the mean of I above which misplaced or lost light is worth a note.
const NOTED_SHARE: f64 = 0.01;

/// Returns remarks on the light that the input lacks or has in a wrong place, from the statistics of the layers.
pub fn light_notes(layers: &BTreeMap<String, LayerRecord>) -> Vec<String> {
    let most = layers.iter().max_by(|(_, a), (_, b)| a.miss_share.total_cmp(&b.miss_share));
    let missed = most.filter(|(_, layer)| layer.miss_share > MISSED_SHARE).map(|(name, layer)| {
        format!(
            "{:.0} % of the paths of {name} miss the photograph, whose border stands for what lies beyond: check its intrinsics \
             (and their \"size\"), or take a longer focal length, less tilt or apex \"mirror\"",
            100.0 * layer.miss_share
        )
    });
    let Some(input) = layers.get(Layer::Input.name()) else {
        return missed.into_iter().collect();
    };
    let is_much = |bound: &f64| *bound > NOTED_SHARE * input.mean;
    let percent = |bound: f64| 100.0 * bound / input.mean;
    let dropped = input.dropped.filter(is_much).map(|bound| {
        format!(
            "up to {:.1} % of I's mean light may be in the wrong place of a pixel: the pane has more orders of light than are followed",
            percent(bound)
        )
    });
    let shadowed = input.shadowed.filter(is_much).map(|bound| {
        format!(
            "up to {:.1} % of I's mean light may be lost in a pixel: facets of rough glass hide each other at such angles",
            percent(bound)
        )
    });
    dropped.into_iter().chain(shadowed).chain(missed).collect()
}

/// Statistics of one label.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LabelRecord {
    /// Mean of the finite values.
    pub mean: f64,
    /// Largest finite value.
    pub max: f64,
    /// Share of the values that are finite; only depths can be infinite.
    pub finite_share: f64,
    /// BLAKE3 of the values as 32-bit floats (little endian, channels of a pixel together, row by row).
    pub blake3: String,
    /// BLAKE3 of the values after rounding, if `tuple.exr` has them as half floats.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exr_blake3: Option<String>,
}

impl LabelRecord {
    /// Computes the statistics of a label. `half` is true if the layers of `tuple.exr` are half floats.
    pub(super) fn new(label: Label, values: &[f32], half: bool) -> Self {
        let finite = || values.iter().filter(|value| value.is_finite()).map(|&v| f64::from(v));
        let count = finite().count();
        let precision = if half { ExrPrecision::Half } else { ExrPrecision::Float };
        let is_half = label_precision(label, precision) == ExrPrecision::Half;
        Self {
            mean: finite().sum::<f64>() / count.max(1) as f64,
            max: finite().fold(0.0, f64::max),
            finite_share: count as f64 / values.len() as f64,
            blake3: value_digest(values),
            exr_blake3: is_half.then(|| {
                let halves = values.iter().map(|v| f16::from_f32(*v).to_f32());
                value_digest(&halves.collect::<Vec<f32>>())
            }),
        }
    }
}

pub(super) fn layer_digest(pixels: &[[f32; 3]]) -> String {
    value_digest(pixels.as_flattened())
}

/// Computes the digest of values.
pub(super) fn value_digest(values: &[f32]) -> String {
    let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    blake3::hash(&bytes).to_hex().to_string()
}
