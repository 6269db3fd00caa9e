//! A tuple's `tuple.exr` read back, and held against its record.

use super::tuple::TupleRecord;
use crate::trace::LAYERS;
use exr::meta::MetaData;
use exr::prelude::{FlatSamples, ReadChannels, ReadLayers, read};
use image::{ImageFormat, ImageReader};
use std::io::Cursor;

/// An EXR's channels, by name.
pub struct ExrChannels {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// Names (`input.R`, ...) and values, row by row; halves as floats, which is exact.
    pub list: Vec<(String, Vec<f32>)>,
}

impl ExrChannels {
    /// Pixels of the tuple's layer of that name, from `NAME.R`, `NAME.G`, `NAME.B`.
    ///
    /// # Errors
    ///
    /// Which channel is missing, in words.
    pub fn layer(&self, name: &str) -> Result<Vec<[f32; 3]>, String> {
        let of = |colour: &str| {
            let name = format!("{name}.{colour}");
            let found = self.list.iter().find(|(n, _)| *n == name);
            found
                .map(|(_, values)| values)
                .ok_or(format!("it has no channel {name}"))
        };
        let (r, g, b) = (of("R")?, of("G")?, of("B")?);
        let pixels = r.iter().zip(g).zip(b);
        Ok(pixels.map(|((r, g), b)| [*r, *g, *b]).collect())
    }
}

/// Decodes the first layer of an EXR whose channels are floats.
///
/// # Errors
///
/// What is wrong with it, in words.
pub fn decode_exr_channels(bytes: &[u8]) -> Result<ExrChannels, String> {
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))
        .map_err(|e| e.to_string())?;
    let layer = image.layer_data;
    let mut list = Vec::new();
    for channel in layer.channel_data.list {
        // Nothing here writes integers.
        if matches!(channel.sample_data, FlatSamples::U32(_)) {
            return Err(format!("channel {} holds integers", channel.name));
        }
        let values = channel.sample_data.values_as_f32().collect();
        list.push((channel.name.to_string(), values));
    }
    Ok(ExrChannels {
        width: layer.size.width(),
        height: layer.size.height(),
        list,
    })
}

/// Decodes a PNG to see whether it is whole (its checksums are PNG's own) and of this size.
///
/// # Errors
///
/// What is wrong with it, in words.
pub fn check_png(bytes: &[u8], width: u32, height: u32) -> Result<(), String> {
    let reader = || {
        let mut reader = ImageReader::with_format(Cursor::new(bytes), ImageFormat::Png);
        // The size is known, and looked at before anything of that size is unpacked.
        reader.no_limits();
        reader
    };
    let size = reader().into_dimensions().map_err(|e| e.to_string())?;
    if size != (width, height) {
        return Err(format!(
            "it has {} x {} px, its record says {width} x {height}",
            size.0, size.1
        ));
    }
    reader().decode().map(|_| ()).map_err(|e| e.to_string())
}

/// The layers I, T, R~, R of a tuple, linear, row by row; empty where the tuple has not that layer. Each is held against its
/// digest in the record.
///
/// # Errors
///
/// What is wrong, in words.
pub fn decode_tuple_exr(bytes: &[u8], record: &TupleRecord) -> Result<[Vec<[f32; 3]>; 4], String> {
    let film = &record.scene.film;
    // Before anything is unpacked: a damaged header may claim any size.
    let meta =
        MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(|e| e.to_string())?;
    for header in &meta.headers {
        let size = [header.layer_size.width(), header.layer_size.height()];
        if size != [film.width as usize, film.height as usize] {
            return Err(format!(
                "it has {} x {} px, its record says {} x {}",
                size[0], size[1], film.width, film.height
            ));
        }
    }
    let channels = decode_exr_channels(bytes)?;
    let mut layers = [const { Vec::new() }; 4];
    for (layer, name) in layers.iter_mut().zip(LAYERS) {
        let Some(facts) = record.layers.get(name) else {
            continue;
        };
        *layer = channels.layer(name)?;
        let expected = facts.exr_blake3.as_ref().unwrap_or(&facts.blake3);
        if super::tuple::layer_digest(layer) != *expected {
            return Err(format!(
                "its {name} is not what was rendered: the digest in tuple.json differs"
            ));
        }
    }
    Ok(layers)
}
