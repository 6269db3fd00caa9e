//! Reads the images of a tuple and compares them with its record.

use super::tuple::TupleRecord;
use crate::formats::exr_labels::read_label;
use crate::formats::exr_read::{check_headers, decode_exr_channels};
use glasshouse_line::label::LabelImages;
use glasshouse_line::layer::{Layer, PerLayer};
use image::{ImageFormat, ImageReader};
use std::io::Cursor;

/// Decodes a PNG to check its checksums and its size. An error is a text for the user.
pub fn check_png(bytes: &[u8], width: u32, height: u32) -> Result<(), String> {
    let reader = || {
        let mut reader = ImageReader::with_format(Cursor::new(bytes), ImageFormat::Png);
        // Limits are unnecessary, because the check of the size below precedes the allocation of pixels.
        reader.no_limits();
        reader
    };
    let size = reader().into_dimensions().map_err(|e| e.to_string())?;
    if size != (width, height) {
        return Err(format!("it has {} x {} px instead of {width} x {height}", size.0, size.1));
    }
    reader().decode().map(|_| ()).map_err(|e| e.to_string())
}

/// Largest number of channels of a tuple: three for each layer, and those of all labels.
const MOST_CHANNELS: usize = 3 * Layer::ALL.len() + 6;

/// Decodes the labels of a tuple, and compares each with its digest in the record. An error is a text for the user.
pub fn decode_tuple_labels(bytes: &[u8], record: &TupleRecord) -> Result<LabelImages, String> {
    let film = &record.scene.film;
    let mut labels = LabelImages::new();
    if film.layers.labels().iter().next().is_none() {
        return Ok(labels);
    }
    check_headers(bytes, [film.width, film.height], MOST_CHANNELS)?;
    let channels = decode_exr_channels(bytes)?;
    let pixels = film.width as usize * film.height as usize;
    let values_of = |name: &str| {
        channels.list.iter().find(|(n, _)| n == name).map(|(_, values)| values.as_slice())
    };
    for label in film.layers.labels().iter() {
        let values = read_label(label, pixels, values_of)
            .ok_or_else(|| format!("it lacks a channel of the label {label}"))?;
        let Some(facts) = record.labels.get(label.name()) else {
            return Err(format!("tuple.json has no digest of the label {label}"));
        };
        let expected = facts.exr_blake3.as_ref().unwrap_or(&facts.blake3);
        if super::tuple::value_digest(&values) != *expected {
            return Err(format!("its {label} does not match its digest in tuple.json"));
        }
        labels.insert(label, values);
    }
    Ok(labels)
}

/// Decodes the layers of a tuple to linear pixels, row by row, and compares each layer with its digest in the record.
/// A layer that the tuple lacks has no pixels. An error is a text for the user.
pub fn decode_tuple_exr(
    bytes: &[u8],
    record: &TupleRecord,
) -> Result<PerLayer<Vec<[f32; 3]>>, String> {
    let film = &record.scene.film;
    check_headers(bytes, [film.width, film.height], MOST_CHANNELS)?;
    let channels = decode_exr_channels(bytes)?;
    let mut layers = PerLayer::default();
    for layer in Layer::ALL {
        let Some(facts) = record.layers.get(layer.name()) else {
            continue;
        };
        let pixels = channels.layer(layer.name())?;
        let expected = facts.exr_blake3.as_ref().unwrap_or(&facts.blake3);
        if super::tuple::layer_digest(&pixels) != *expected {
            return Err(format!("its {layer} does not match its digest in tuple.json"));
        }
        layers[layer] = pixels;
    }
    Ok(layers)
}
