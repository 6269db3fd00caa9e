//! Encodes and decodes partials as OpenEXR bytes.

use super::{Maker, Partial, PartialHeader};
use crate::formats::exr_labels::{label_channels, read_label};
use crate::formats::exr_read::{check_claim, first_layer, headers};
use crate::formats::exr_write::write_exr_into;
use crate::trace::PixelMeans;
use exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Encoding, FlatSamples, Image, IntegerBounds,
    Layer as Part, LayerAttributes, Text, Vec2,
};
use glasshouse_line::ExrPrecision;
use glasshouse_line::label::{Label, LabelImages};
use glasshouse_line::layer::Layer;
use std::path::{Path, PathBuf};

/// Error for a file that is not a usable partial. The shard of this file is traced again.
#[derive(Debug, thiserror::Error)]
#[error("partial {} is not usable: {reason}; it will be traced again", path.display())]
pub struct PartialError {
    pub path: PathBuf,
    pub reason: String,
}

/// Name of the OpenEXR attribute that contains the header.
const ATTRIBUTE: &str = "glasshouse";
/// Name of the OpenEXR attribute that contains the [`Maker`].
const MAKER_ATTRIBUTE: &str = "glasshouse_maker";
const COLOURS: [&str; 3] = ["R", "G", "B"];
/// Number of pixels that `planes` splits into channels at once.
const BLOCK_PIXELS: usize = 128;
/// Memory reserved for the header and the line offsets of an encoded file, bytes.
const HEADER_BYTES: usize = 1 << 16;

/// Lists the channels of a file: name, part (0: all samples, 1: first half, 2: first quarter), layer and colour.
fn channels() -> impl Iterator<Item = (String, usize, Layer, usize)> {
    ["", "_half", "_quarter"].into_iter().enumerate().flat_map(|(part, suffix)| {
        Layer::ALL.into_iter().flat_map(move |layer| {
            let colours = COLOURS.iter().enumerate();
            colours.map(move |(c, colour)| (format!("{layer}{suffix}.{colour}"), part, layer, c))
        })
    })
}

fn value(pixel: &mut PixelMeans, part: usize, layer: Layer, colour: usize) -> &mut f32 {
    let means = match part {
        0 => &mut pixel.mean,
        1 => &mut pixel.half,
        _ => &mut pixel.quarter,
    };
    &mut means[layer as usize][colour]
}

/// Returns the values of the channels, in the order of [`channels`].
fn planes(pixels: &[PixelMeans]) -> Vec<Vec<f32>> {
    let places: Vec<_> = channels().map(|(_, part, layer, c)| (part, layer, c)).collect();
    let mut planes: Vec<Vec<f32>> =
        places.iter().map(|_| Vec::with_capacity(pixels.len())).collect();
    // A block is small enough to stay in the cache for all channels.
    for block in pixels.chunks(BLOCK_PIXELS) {
        for (plane, &(part, layer, c)) in planes.iter_mut().zip(&places) {
            let layer = layer as usize;
            match part {
                0 => plane.extend(block.iter().map(|pixel| pixel.mean[layer][c])),
                1 => plane.extend(block.iter().map(|pixel| pixel.half[layer][c])),
                _ => plane.extend(block.iter().map(|pixel| pixel.quarter[layer][c])),
            }
        }
    }
    planes
}

/// Encodes a partial as the bytes of its file.
pub fn encode(partial: &Partial) -> Result<Vec<u8>, exr::error::Error> {
    encode_as(&partial.header, partial)
}

pub(super) fn encode_as(
    header: &PartialHeader,
    partial: &Partial,
) -> Result<Vec<u8>, exr::error::Error> {
    let (tile, pixels) = (header.tile, partial.pixels.as_slice());
    let list = channels()
        .zip(planes(pixels))
        .map(|((name, ..), samples)| AnyChannel::new(name.as_str(), FlatSamples::F32(samples)))
        .chain(label_channels(&partial.labels, ExrPrecision::Float));
    let mut attributes = LayerAttributes {
        layer_position: Vec2(tile.x as i32, tile.y as i32),
        ..LayerAttributes::default()
    };
    attributes
        .other
        .insert(Text::from(ATTRIBUTE), AttributeValue::Text(Text::from(header.to_json().as_str())));
    if let Some(maker) = &partial.maker {
        let text = AttributeValue::Text(Text::from(maker.to_json().as_str()));
        attributes.other.insert(Text::from(MAKER_ATTRIBUTE), text);
    }
    let layer = Part::new(
        (tile.width as usize, tile.height as usize),
        attributes,
        Encoding::UNCOMPRESSED,
        AnyChannels::sort(list.collect()),
    );
    let mut image = Image::from_layer(layer);
    image.attributes.display_window =
        IntegerBounds::from_dimensions((header.film[0] as usize, header.film[1] as usize));
    let length = size_of_val(pixels) + HEADER_BYTES;
    write_exr_into(&image, Vec::with_capacity(length))
}

/// Decodes a partial and checks its digest and its numbers. Only the error uses `path`.
pub fn decode(path: &Path, bytes: &[u8]) -> Result<Partial, PartialError> {
    // The exr crate may panic on invalid bytes.
    let result = std::panic::catch_unwind(|| decode_inner(bytes));
    result
        .unwrap_or_else(|_| Err("the OpenEXR reader failed".to_owned()))
        .map_err(|reason| PartialError { path: path.to_owned(), reason })
}

fn decode_inner(bytes: &[u8]) -> Result<Partial, String> {
    // This check precedes the allocation of pixels. Partials are uncompressed, so a file is longer than its pixels.
    check_claim(&headers(bytes)?, bytes.len() as u128)?;
    let layer = first_layer(bytes)?;
    let header = match layer.attributes.other.get(&Text::from(ATTRIBUTE)) {
        Some(AttributeValue::Text(json)) => {
            serde_json::from_str::<PartialHeader>(&json.to_string()).map_err(|e| e.to_string())?
        }
        _ => return Err(format!("it has no {ATTRIBUTE} attribute")),
    };
    let count = layer.size.area();
    if count != header.tile.width as usize * header.tile.height as usize {
        return Err("its size differs from its tile's".to_owned());
    }
    let mut pixels = vec![PixelMeans::default(); count];
    for (name, part, of, c) in channels() {
        let channel = layer.channel_data.list.iter().find(|channel| channel.name.eq(name.as_str()));
        let Some(FlatSamples::F32(samples)) = channel.map(|channel| &channel.sample_data) else {
            return Err(format!("it has no float channel {name}"));
        };
        for (pixel, &sample) in pixels.iter_mut().zip(samples) {
            *value(pixel, part, of, c) = sample;
        }
    }
    let values_of = |name: &str| {
        let of_name = |channel: &&AnyChannel<FlatSamples>| channel.name.eq(name);
        let channel = layer.channel_data.list.iter().find(of_name)?;
        match &channel.sample_data {
            FlatSamples::F32(samples) => Some(samples.as_slice()),
            _ => None,
        }
    };
    let mut labels = LabelImages::new();
    for label in Label::ALL {
        if let Some(values) = read_label(label, count, values_of) {
            labels.insert(label, values);
        }
    }
    let maker = match layer.attributes.other.get(&Text::from(MAKER_ATTRIBUTE)) {
        Some(AttributeValue::Text(json)) => Maker::parse(&json.to_string()),
        _ => None,
    };
    let partial = Partial { header, pixels, labels, maker };
    if !partial.is_intact() {
        return Err("its digest does not match its content".to_owned());
    }
    match partial.nonsense() {
        Some(reason) => Err(reason),
        None => Ok(partial),
    }
}
