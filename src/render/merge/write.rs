//! Encodes `tuple.exr`, the layers' PNGs, and `tuple.json`.

use super::photographs::photographs;
use super::tuple::{TUPLE_SCHEMA_1, Tuple, TupleRecord, file_digest};
use crate::atomic_file::WriteError;
use crate::formats::exr_labels::label_channels;
use crate::formats::exr_write::{HALF_MAX, channel, encode_exr};
use crate::trace::TRACER_VERSION;
use exr::prelude::f16;
use glasshouse_line::color::{SrgbEncoder, linear_to_srgb16};
use glasshouse_line::layer::PerLayer;
use glasshouse_line::{ExrPrecision, SceneLine};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use std::collections::BTreeMap;
use std::path::Path;

/// Name of a tuple's record, its last file.
const RECORD: &str = "tuple.json";

/// Returns the names of a tuple's files, in the order of writing.
pub fn tuple_files(line: &SceneLine) -> Vec<String> {
    let mut names = tuple_images(line);
    names.push(RECORD.to_owned());
    names
}

/// Returns the names of a tuple's files except for its record: `tuple.exr`, a PNG of each layer, and the photographs.
pub fn tuple_images(line: &SceneLine) -> Vec<String> {
    let mut names = layer_images(line);
    names.extend(photographs(line).into_iter().map(str::to_owned));
    names
}

/// Returns the names of `tuple.exr` and of the layers' PNGs.
fn layer_images(line: &SceneLine) -> Vec<String> {
    let pngs = line.film.layers.names().map(|name| format!("{name}.png"));
    std::iter::once("tuple.exr".to_owned()).chain(pngs).collect()
}

/// Reason why a tuple cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum TupleWriteError {
    #[error(transparent)]
    File(#[from] WriteError),
    #[error("cannot encode {name}: {reason}")]
    Encode { name: String, reason: String },
}

impl TupleWriteError {
    /// Makes the error of a file that cannot be encoded.
    pub fn encode(name: &str, reason: &dyn std::fmt::Display) -> Self {
        Self::Encode { name: name.to_owned(), reason: reason.to_string() }
    }
}

/// True if the folder contains the complete tuple of this scene line, made by this version of the tracer.
pub fn is_written(folder: &Path, line: &SceneLine) -> bool {
    let Ok(text) = crate::input_file::read_to_string(&folder.join(RECORD)) else {
        return false;
    };
    is_record_of(text.as_bytes(), line, TRACER_VERSION)
        && tuple_files(line).iter().all(|name| folder.join(name).is_file())
}

/// True if the bytes are the `tuple.json` of this scene line, made by this version of the tracer and any of the camera.
pub fn is_record_of(bytes: &[u8], line: &SceneLine, tracer_version: u32) -> bool {
    let record: Result<TupleRecord, _> = serde_json::from_slice(bytes);
    record.is_ok_and(|r| {
        r.scene == *line && r.tracer_version == tracer_version && r.check_complete().is_ok()
    })
}

/// True if the bytes are the `tuple.json` of this scene line, made by this or an older version of the tracer.
pub fn is_readable_record_of(bytes: &[u8], line: &SceneLine) -> bool {
    (1..=TRACER_VERSION).any(|version| is_record_of(bytes, line, version))
}

/// Encodes `tuple.exr` or the PNG of a layer. The crate `compose` encodes the photographs.
pub fn encode_layer_image(
    tuple: &Tuple,
    encoder: &SrgbEncoder,
    name: &str,
) -> Result<Vec<u8>, TupleWriteError> {
    if name == "tuple.exr" {
        return encode_tuple_exr(tuple).map_err(|e| TupleWriteError::encode(name, &e));
    }
    let stem = name.strip_suffix(".png").unwrap_or(name);
    let (_, pixels) = tuple
        .made()
        .find(|(layer, _)| layer.name() == stem)
        .ok_or_else(|| TupleWriteError::encode(name, &"the tuple has no such layer"))?;
    encode_png(encoder, pixels, tuple.width, tuple.height)
        .map_err(|e| TupleWriteError::encode(name, &e))
}

/// Encodes `tuple.json` with the digests of the tuple's `images`. Returns its name and bytes.
pub fn encode_tuple_record(
    record: &TupleRecord,
    images: &[(String, Vec<u8>)],
) -> Result<(String, Vec<u8>), TupleWriteError> {
    let digests = images.iter().map(|(name, bytes)| (name.clone(), file_digest(bytes)));
    let record = TupleRecord { files: digests.collect(), ..record.clone() };
    Ok((RECORD.to_owned(), record_bytes(&record)?))
}

/// Encodes `tuple.json` as older versions of the program did, without digests of files ([`TUPLE_SCHEMA_1`]).
pub fn encode_tuple_record_1(record: &TupleRecord) -> Result<Vec<u8>, TupleWriteError> {
    let schema = TUPLE_SCHEMA_1.to_owned();
    record_bytes(&TupleRecord { schema, files: BTreeMap::new(), ..record.clone() })
}

fn record_bytes(record: &TupleRecord) -> Result<Vec<u8>, TupleWriteError> {
    let mut json =
        serde_json::to_string_pretty(record).map_err(|e| TupleWriteError::encode(RECORD, &e))?;
    json.push('\n');
    Ok(json.into_bytes())
}

/// Encodes a layer as 8-bit sRGB PNG. Clips values above 1.
pub fn encode_png(
    encoder: &SrgbEncoder,
    pixels: &[[f32; 3]],
    width: u32,
    height: u32,
) -> Result<Vec<u8>, image::ImageError> {
    let bytes: Vec<u8> = pixels.as_flattened().iter().map(|&v| encoder.encode(v)).collect();
    encode_rgb8_png(&bytes, [width, height])
}

/// Encodes a layer as 16-bit sRGB PNG. Clips values above 1.
pub fn encode_png16(
    pixels: &[[f32; 3]],
    width: u32,
    height: u32,
) -> Result<Vec<u8>, image::ImageError> {
    let values = pixels.as_flattened().iter();
    // The encoder converts the native byte order to that of PNG.
    let bytes: Vec<u8> = values.flat_map(|&v| linear_to_srgb16(v).to_ne_bytes()).collect();
    png(&bytes, [width, height], ExtendedColorType::Rgb16)
}

/// Encodes 8-bit RGB as PNG.
pub fn encode_rgb8_png(rgb: &[u8], size: [u32; 2]) -> Result<Vec<u8>, image::ImageError> {
    png(rgb, size, ExtendedColorType::Rgb8)
}

fn png(
    bytes: &[u8],
    [width, height]: [u32; 2],
    color: ExtendedColorType,
) -> Result<Vec<u8>, image::ImageError> {
    let mut png = Vec::new();
    PngEncoder::new_with_quality(&mut png, CompressionType::Fast, FilterType::Adaptive)
        .write_image(bytes, width, height, color)?;
    Ok(png)
}

/// True if `tuple.exr` stores half floats: the scene requests them, and no value exceeds their range.
pub(super) fn is_half(line: &SceneLine, layers: &PerLayer<Vec<[f32; 3]>>) -> bool {
    let mut values = layers.0.iter().flatten().flatten();
    line.film.exr == ExrPrecision::Half && values.all(|&v| v <= HALF_MAX)
}

/// Rounds the pixels to half floats.
pub(super) fn halved(pixels: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let pixels = pixels.iter();
    pixels.map(|p| p.map(|v| f16::from_f32(v).to_f32())).collect()
}

/// Encodes all layers and labels in one file, with channels `input.R`, ...: half floats if the scene requests them and no value
/// exceeds their range, otherwise floats.
pub fn encode_tuple_exr(tuple: &Tuple) -> Result<Vec<u8>, exr::error::Error> {
    let precision = if is_half(&tuple.record.scene, &tuple.layers) {
        ExrPrecision::Half
    } else {
        ExrPrecision::Float
    };
    let mut list = Vec::new();
    for (layer, pixels) in tuple.made() {
        for (c, colour) in ["R", "G", "B"].into_iter().enumerate() {
            let values = pixels.iter().map(|p| p[c]);
            list.push(channel(&format!("{layer}.{colour}"), values, precision));
        }
    }
    list.extend(label_channels(&tuple.labels, precision));
    encode_exr(list, tuple.width, tuple.height)
}
