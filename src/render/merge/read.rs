//! A tuple's `tuple.exr` read back, and held against its record.

use super::tuple::TupleRecord;
use crate::trace::LAYERS;
use exr::math::Vec2;
use exr::meta::MetaData;
use exr::meta::attribute::ChannelDescription;
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

/// Deflate makes nothing smaller than by this factor.
const MOST_COMPRESSION: u128 = 1032;

/// Looks at an EXR's headers before anything is unpacked: a damaged one may claim any size. Its pixels must be `size`, in at
/// most so many channels, and no more of them than bytes of this length can hold.
///
/// # Errors
///
/// What is wrong, in words.
pub(super) fn check_headers(bytes: &[u8], size: [u32; 2], most: usize) -> Result<(), String> {
    let meta =
        MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(|e| e.to_string())?;
    let mut claimed = 0;
    for header in &meta.headers {
        let found = [header.layer_size.width(), header.layer_size.height()];
        if found != size.map(|side| side as usize) {
            return Err(format!(
                "it has {} x {} px instead of {} x {}",
                found[0], found[1], size[0], size[1]
            ));
        }
        let is_plain = |c: &ChannelDescription| c.sampling == Vec2(1, 1);
        let channels = &header.channels;
        if header.deep || channels.list.len() > most || !channels.list.iter().all(is_plain) {
            return Err("it has other channels than were written".to_owned());
        }
        claimed += found[0] as u128 * found[1] as u128 * channels.bytes_per_pixel as u128;
    }
    if claimed > MOST_COMPRESSION * bytes.len() as u128 {
        return Err("it is shorter than the image that its header describes".to_owned());
    }
    Ok(())
}

/// The layers I, T, R~, R of a tuple, linear, row by row; empty where the tuple has not that layer. Each is held against its
/// digest in the record.
///
/// # Errors
///
/// What is wrong, in words.
pub fn decode_tuple_exr(bytes: &[u8], record: &TupleRecord) -> Result<[Vec<[f32; 3]>; 4], String> {
    let film = &record.scene.film;
    check_headers(bytes, [film.width, film.height], 3 * LAYERS.len())?;
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
