//! Partials as OpenEXR bytes.

use super::{Partial, PartialHeader};
use crate::trace::{LAYERS, PixelMeans};
use exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Encoding, FlatSamples, Image, IntegerBounds, Layer,
    LayerAttributes, MetaData, ReadChannels, ReadLayers, Text, Vec2, WritableImage, read,
};
use std::io::Cursor;
use std::path::{Path, PathBuf};

/// A file that is no usable partial. It is traced again.
#[derive(Debug, thiserror::Error)]
#[error("partial {} is not usable: {reason}; it will be traced again", path.display())]
pub struct PartialError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong.
    pub reason: String,
}

/// Name of the header attribute.
const ATTRIBUTE: &str = "glasshouse";
const COLOURS: [&str; 3] = ["R", "G", "B"];
/// Pixels that are split into channels at once.
const BLOCK_PIXELS: usize = 128;
/// More than a file's header and line offsets take.
const HEADER_BYTES: usize = 1 << 16;

/// Channel name, and where its value stands in a pixel.
fn channels() -> impl Iterator<Item = (String, usize, usize, usize)> {
    ["", "_half", "_quarter"]
        .into_iter()
        .enumerate()
        .flat_map(|(part, suffix)| {
            LAYERS.iter().enumerate().flat_map(move |(layer, name)| {
                let colours = COLOURS.iter().enumerate();
                colours.map(move |(c, colour)| (format!("{name}{suffix}.{colour}"), part, layer, c))
            })
        })
}

fn value(pixel: &mut PixelMeans, part: usize, layer: usize, colour: usize) -> &mut f32 {
    let means = match part {
        0 => &mut pixel.mean,
        1 => &mut pixel.half,
        _ => &mut pixel.quarter,
    };
    &mut means[layer][colour]
}

/// The channels' values, in the order of [`channels`].
fn planes(pixels: &[PixelMeans]) -> Vec<Vec<f32>> {
    let places: Vec<_> = channels()
        .map(|(_, part, layer, c)| (part, layer, c))
        .collect();
    let mut planes: Vec<Vec<f32>> = places
        .iter()
        .map(|_| Vec::with_capacity(pixels.len()))
        .collect();
    // So few pixels at a time that they stay in the cache for all channels.
    for block in pixels.chunks(BLOCK_PIXELS) {
        for (plane, &(part, layer, c)) in planes.iter_mut().zip(&places) {
            match part {
                0 => plane.extend(block.iter().map(|pixel| pixel.mean[layer][c])),
                1 => plane.extend(block.iter().map(|pixel| pixel.half[layer][c])),
                _ => plane.extend(block.iter().map(|pixel| pixel.quarter[layer][c])),
            }
        }
    }
    planes
}

/// The file's bytes.
pub fn encode(partial: &Partial) -> Result<Vec<u8>, exr::error::Error> {
    encode_as(&partial.header, &partial.pixels)
}

pub(super) fn encode_as(
    header: &PartialHeader,
    pixels: &[PixelMeans],
) -> Result<Vec<u8>, exr::error::Error> {
    let tile = header.tile;
    let list = channels()
        .zip(planes(pixels))
        .map(|((name, ..), samples)| AnyChannel::new(name.as_str(), FlatSamples::F32(samples)));
    let mut attributes = LayerAttributes {
        layer_position: Vec2(tile.x as i32, tile.y as i32),
        ..LayerAttributes::default()
    };
    attributes.other.insert(
        Text::from(ATTRIBUTE),
        AttributeValue::Text(Text::from(header.to_json().as_str())),
    );
    let layer = Layer::new(
        (tile.width as usize, tile.height as usize),
        attributes,
        Encoding::UNCOMPRESSED,
        AnyChannels::sort(list.collect()),
    );
    let mut image = Image::from_layer(layer);
    image.attributes.display_window =
        IntegerBounds::from_dimensions((header.film[0] as usize, header.film[1] as usize));
    let length = size_of_val(pixels) + HEADER_BYTES;
    let mut bytes = Cursor::new(Vec::with_capacity(length));
    image.write().non_parallel().to_buffered(&mut bytes)?;
    Ok(bytes.into_inner())
}

/// Reads a partial and checks its digest. `path` is for the error's text.
pub fn decode(path: &Path, bytes: &[u8]) -> Result<Partial, PartialError> {
    // The exr crate may panic on bytes that are no image.
    let result = std::panic::catch_unwind(|| decode_inner(bytes));
    result
        .unwrap_or_else(|_| Err("the OpenEXR reader gave up on it".to_owned()))
        .map_err(|reason| PartialError {
            path: path.to_owned(),
            reason,
        })
}

fn decode_inner(bytes: &[u8]) -> Result<Partial, String> {
    // Before anything of the claimed size is allocated: partials are not compressed, so a file holds its pixels.
    let meta =
        MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(|e| e.to_string())?;
    let claimed = meta.headers.iter().fold(0u128, |sum, header| {
        let size = header.layer_size;
        sum + size.width() as u128 * size.height() as u128 * header.channels.bytes_per_pixel as u128
    });
    if claimed > bytes.len() as u128 {
        return Err("it is shorter than the image that its header describes".to_owned());
    }
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))
        .map_err(|e| e.to_string())?;
    let layer = &image.layer_data;
    let header = match layer.attributes.other.get(&Text::from(ATTRIBUTE)) {
        Some(AttributeValue::Text(json)) => {
            serde_json::from_str::<PartialHeader>(&json.to_string()).map_err(|e| e.to_string())?
        }
        _ => return Err(format!("it has no {ATTRIBUTE} attribute")),
    };
    let count = layer.size.area();
    if count != header.tile.width as usize * header.tile.height as usize {
        return Err("its size is not its tile's".to_owned());
    }
    let mut pixels = vec![PixelMeans::default(); count];
    for (name, part, layer_index, c) in channels() {
        let channel = layer
            .channel_data
            .list
            .iter()
            .find(|channel| channel.name.eq(name.as_str()));
        let Some(FlatSamples::F32(samples)) = channel.map(|channel| &channel.sample_data) else {
            return Err(format!("it has no float channel {name}"));
        };
        for (pixel, &sample) in pixels.iter_mut().zip(samples) {
            *value(pixel, part, layer_index, c) = sample;
        }
    }
    let partial = Partial { header, pixels };
    if partial.is_intact() {
        Ok(partial)
    } else {
        Err("its digest does not fit its content".to_owned())
    }
}
