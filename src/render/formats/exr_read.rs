//! Reads OpenEXR files that this program wrote: checks the headers, then decodes all channels of the first part.

use exr::image::{AnyChannels, Layer};
use exr::math::Vec2;
use exr::meta::MetaData;
use exr::meta::attribute::ChannelDescription;
use exr::meta::header::Header;
use exr::prelude::{FlatSamples, ReadChannels, ReadLayers, read};
use std::io::Cursor;

/// The size and the channels of an EXR file's first part.
pub struct ExrChannels {
    /// Width, px.
    pub width: usize,
    /// Height, px.
    pub height: usize,
    /// Names (`input.R`, ...) and values, row by row. Halves become floats without rounding.
    pub list: Vec<(String, Vec<f32>)>,
}

impl ExrChannels {
    /// Returns a tuple's layer from the channels `NAME.R`, `NAME.G` and `NAME.B`. An error names a missing channel.
    pub fn layer(&self, name: &str) -> Result<Vec<[f32; 3]>, String> {
        let of = |colour: &str| {
            let name = format!("{name}.{colour}");
            let found = self.list.iter().find(|(n, _)| *n == name);
            found.map(|(_, values)| values).ok_or(format!("it has no channel {name}"))
        };
        let (r, g, b) = (of("R")?, of("G")?, of("B")?);
        let pixels = r.iter().zip(g).zip(b);
        Ok(pixels.map(|((r, g), b)| [*r, *g, *b]).collect())
    }
}

/// Decodes the first part of an EXR file, and refuses integer channels. An error is a text for the user.
pub fn decode_exr_channels(bytes: &[u8]) -> Result<ExrChannels, String> {
    let layer = first_layer(bytes)?;
    let mut list = Vec::new();
    for channel in layer.channel_data.list {
        // This program writes no integers.
        if matches!(channel.sample_data, FlatSamples::U32(_)) {
            return Err(format!("channel {} holds integers", channel.name));
        }
        let values = channel.sample_data.values_as_f32().collect();
        list.push((channel.name.to_string(), values));
    }
    Ok(ExrChannels { width: layer.size.width(), height: layer.size.height(), list })
}

/// Decodes the first part with all its channels.
pub(crate) fn first_layer(bytes: &[u8]) -> Result<Layer<AnyChannels<FlatSamples>>, String> {
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))
        .map_err(|e| e.to_string())?;
    Ok(image.layer_data)
}

/// Reads the headers of all parts, without an allocation of the size that they claim.
pub(crate) fn headers(bytes: &[u8]) -> Result<Vec<Header>, String> {
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false);
    Ok(meta.map_err(|e| e.to_string())?.headers.into_vec())
}

/// Checks that the pixels described by the headers take at most `most` bytes.
pub(crate) fn check_claim(headers: &[Header], most: u128) -> Result<(), String> {
    let bytes = |header: &Header| {
        let size = header.layer_size;
        size.width() as u128 * size.height() as u128 * header.channels.bytes_per_pixel as u128
    };
    if headers.iter().map(bytes).sum::<u128>() > most {
        return Err("it is shorter than the image that its header describes".to_owned());
    }
    Ok(())
}

/// Largest compression factor of Deflate.
const MOST_COMPRESSION: u128 = 1032;

/// Checks an EXR file's headers before the pixels are unpacked, since a damaged header may claim any size. Every part
/// must have `size` and at most `most` channels, without subsampling and deep data, and the file must be long enough.
pub(crate) fn check_headers(bytes: &[u8], size: [u32; 2], most: usize) -> Result<(), String> {
    let headers = headers(bytes)?;
    for header in &headers {
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
            return Err("its channels differ from the expected ones".to_owned());
        }
    }
    check_claim(&headers, MOST_COMPRESSION * bytes.len() as u128)
}
