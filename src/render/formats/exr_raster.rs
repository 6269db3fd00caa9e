//! Reads OpenEXR images with the `exr` crate: one layer, one or three channels.

use super::error::SceneError;
use super::files::{FileFormat, NamedBytes};
use super::limits::{MAX_EXR_CHANNELS, check_size};
use super::raster::{Raster, Samples};
use ::exr::math::Vec2;
use ::exr::meta::{MetaData, header::Header};
use ::exr::prelude::{ReadChannels, ReadLayers, ReadSpecificChannel, read};
use std::io::Cursor;

const COLOR: &str = "channels R, G and B, or a single Y, without subsampling or deep data";
const DEPTH: &str = "depth as a channel Z, a single channel such as depth.Y or dd.T, or three equal channels R, G and B, \
                     without subsampling or deep data";

/// Decodes the first layer with R, G and B, else the first layer with Y and no chroma. Ignores other channels. The data
/// window is the image. 16- and 32-bit floats and 32-bit integers become `f32`, unscaled.
pub(crate) fn decode_color(file: &NamedBytes) -> Result<Raster, SceneError> {
    file.contain(FileFormat::Exr, || match color_layer(file)? {
        (Channels::Rgb, _) => read_rgb(file),
        (Channels::Single(name), _) => read_single(file, &name),
    })
}

/// Reads the size of the colour image from the header; `file` may hold only the beginning of the file.
pub(crate) fn color_size(file: &NamedBytes) -> Result<[usize; 2], SceneError> {
    file.contain(FileFormat::Exr, || Ok(color_layer(file)?.1))
}

/// Reads the size of the depth image from the header; `file` may hold only the beginning of the file.
pub(crate) fn depth_size(file: &NamedBytes) -> Result<[usize; 2], SceneError> {
    file.contain(FileFormat::Exr, || Ok(depth_layer(file)?.1))
}

/// The channels to read from a layer.
enum Channels {
    Rgb,
    Single(String),
}

fn color_layer(file: &NamedBytes) -> Result<(Channels, [usize; 2]), SceneError> {
    let headers = headers(file)?;
    let is_rgb = |header: &&Header| ["R", "G", "B"].iter().all(|name| has(header, name));
    if let Some(header) = headers.iter().find(is_rgb) {
        return Ok((Channels::Rgb, size(header)));
    }
    let is_grey = |header: &&Header| has(header, "Y") && !has(header, "RY");
    match headers.iter().find(is_grey) {
        Some(header) => Ok((Channels::Single("Y".to_owned()), size(header))),
        None => Err(wrong_channels(file, &headers, COLOR)),
    }
}

/// Finds the depth. A channel R beside G or B belongs to a colour picture, unless the three are equal, and a channel Y
/// beside RY or BY, too.
fn depth_layer(file: &NamedBytes) -> Result<(Channels, [usize; 2]), SceneError> {
    let headers = headers(file)?;
    let is_color = |header: &Header, name: &str| {
        let partners: &[&str] = match name {
            "Y" => &["RY", "BY"],
            "R" => &["G", "B"],
            _ => &[],
        };
        partners.iter().any(|partner| has(header, partner))
    };
    for name in ["Z", "Y", "R"] {
        // The reader takes the first layer with such a channel.
        if let Some(header) = headers.iter().find(|header| has(header, name))
            && !is_color(header, name)
        {
            return Ok((Channels::Single(name.to_owned()), size(header)));
        }
    }
    if let Some(found) = named_depth(&headers) {
        return Ok(found);
    }
    if let Some(header) = headers.iter().find(|h| ["R", "G", "B"].iter().all(|name| has(h, name))) {
        return Ok((Channels::Rgb, size(header)));
    }
    if let [header] = headers.as_slice()
        && let [channel] = header.channels.list.as_slice()
    {
        return Ok((Channels::Single(channel.name.to_string()), size(header)));
    }
    Err(wrong_channels(file, &headers, DEPTH))
}

/// Finds the one channel that is alone in its layer and named as a depth, as renderers write it beside colours:
/// `depth.Y` of Mitsuba, `VRayZDepth.R` of V-Ray, `dd.T`, `ViewLayer.Depth.Z` of Blender. `None` if there are several.
fn named_depth(headers: &[Header]) -> Option<(Channels, [usize; 2])> {
    let all = headers.iter().flat_map(|header| {
        header.channels.list.iter().map(move |channel| (header, channel.name.to_string()))
    });
    let all: Vec<(&Header, String)> = all.collect();
    let layer = |name: &str| name.rsplit_once('.').map(|(layer, _)| layer.to_owned());
    let is_depth = |name: &str| {
        let lower = name.to_lowercase();
        let axis = lower.rsplit_once('.').map(|(_, axis)| axis);
        let is_axis = lower == "z" || matches!(axis, Some("z" | "t"));
        lower.contains("depth") || lower.contains("distance") || is_axis
    };
    let mut found = all.iter().filter(|(_, name)| {
        let siblings = all.iter().filter(|(_, other)| layer(other) == layer(name)).count();
        is_depth(name) && (layer(name).is_none() || siblings == 1)
    });
    let (header, name) = found.next()?;
    found.next().is_none().then(|| (Channels::Single(name.clone()), size(header)))
}

fn size(header: &Header) -> [usize; 2] {
    let Vec2(width, height) = header.layer_size;
    [width, height]
}

/// Decodes the depth: the first channel Z, Y or R that is no part of a colour, else the only one that is named as a depth,
/// else equal R, G and B, else the only channel.
pub(crate) fn decode_depth(file: &NamedBytes) -> Result<Raster, SceneError> {
    file.contain(FileFormat::Exr, || match depth_layer(file)?.0 {
        Channels::Single(name) => read_single(file, &name),
        Channels::Rgb => grey_of_rgb(file, &read_rgb(file)?),
    })
}

/// Returns the one channel of a picture with equal channels; an error for colours.
fn grey_of_rgb(file: &NamedBytes, rgb: &Raster) -> Result<Raster, SceneError> {
    let Samples::F32(values) = &rgb.samples else {
        unreachable!("the reader of OpenEXR makes floats");
    };
    let pixels = values.as_chunks::<3>().0;
    let is_same = |a: f32, b: f32| a == b || (a.is_nan() && b.is_nan());
    if !pixels.iter().all(|[r, g, b]| is_same(*r, *g) && is_same(*r, *b)) {
        return Err(wrong_channels(file, &headers(file)?, DEPTH));
    }
    let red = pixels.iter().map(|pixel| pixel[0]).collect();
    Ok(Raster::plain(rgb.width, rgb.height, 1, Samples::F32(red)))
}

/// Reads the headers of all layers. Refuses sizes and channel counts beyond the limits, subsampling and deep data.
fn headers(file: &NamedBytes) -> Result<Vec<Header>, SceneError> {
    let meta = MetaData::read_from_buffered(Cursor::new(file.bytes.as_slice()), false)
        .map_err(|error| file.unreadable(FileFormat::Exr, error))?;
    for header in &meta.headers {
        let Vec2(width, height) = header.layer_size;
        check_size(&file.path, width as u64, height as u64)?;
    }
    let channel_count: usize = meta.headers.iter().map(|header| header.channels.list.len()).sum();
    // The decoder skips subsampled channels by the wrong number of bytes.
    let is_plain = meta.headers.iter().all(|header| {
        !header.deep && header.channels.list.iter().all(|channel| channel.sampling == Vec2(1, 1))
    });
    if channel_count > MAX_EXR_CHANNELS || !is_plain {
        return Err(wrong_channels(file, &meta.headers, COLOR));
    }
    Ok(meta.headers.into_vec())
}

fn has(header: &Header, name: &str) -> bool {
    header.channels.list.iter().any(|channel| channel.name.eq(name))
}

fn wrong_channels(file: &NamedBytes, headers: &[Header], expected: &'static str) -> SceneError {
    let names: Vec<String> = headers
        .iter()
        .flat_map(|header| &header.channels.list)
        .take(16)
        .map(|channel| {
            let Vec2(x, y) = channel.sampling;
            let sampling = if (x, y) == (1, 1) { String::new() } else { format!(" ({x}x{y})") };
            format!("{}{sampling}", channel.name)
        })
        .collect();
    let deep = if headers.iter().any(|header| header.deep) { "deep " } else { "" };
    file.wrong_layout(format!("{deep}channels {}", names.join(", ")), expected)
}

fn read_rgb(file: &NamedBytes) -> Result<Raster, SceneError> {
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .rgb_channels(
            |size, _| Pixels::new(size, 3),
            |pixels, at, (r, g, b): (f32, f32, f32)| pixels.set(at, [r, g, b]),
        )
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(file.bytes.as_slice()))
        .map_err(|error| file.unreadable(FileFormat::Exr, error))?;
    Ok(image.layer_data.channel_data.pixels.into_raster(3))
}

fn read_single(file: &NamedBytes, name: &str) -> Result<Raster, SceneError> {
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .specific_channels()
        .required(name)
        .collect_pixels(
            |size, _| Pixels::new(size, 1),
            |pixels: &mut Pixels, at, (value,): (f32,)| pixels.set(at, [value]),
        )
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(file.bytes.as_slice()))
        .map_err(|error| file.unreadable(FileFormat::Exr, error))?;
    Ok(image.layer_data.channel_data.pixels.into_raster(1))
}

/// An image that the decoder fills pixel by pixel.
struct Pixels {
    size: Vec2<usize>,
    values: Vec<f32>,
}

impl Pixels {
    /// Makes an image of NaN, so that pixels outside all blocks of the file are invalid instead of black.
    fn new(size: Vec2<usize>, channels: usize) -> Self {
        Self { size, values: vec![f32::NAN; size.area() * channels] }
    }

    fn set<const N: usize>(&mut self, Vec2(x, y): Vec2<usize>, pixel: [f32; N]) {
        let at = (y * self.size.width() + x) * N;
        self.values[at..at + N].copy_from_slice(&pixel);
    }

    fn into_raster(self, channels: usize) -> Raster {
        let samples = Samples::F32(self.values);
        Raster::plain(self.size.width(), self.size.height(), channels, samples)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use ::exr::prelude::{
        AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes,
        WritableImage, f16,
    };
    use std::path::PathBuf;

    /// Returns an EXR file of one layer.
    pub(crate) fn exr(width: usize, height: usize, channels: &[(&str, FlatSamples)]) -> NamedBytes {
        exr_coded(width, height, channels, Encoding::SMALL_LOSSLESS)
    }

    /// Returns an EXR file of one layer, with the blocks and the compression of `encoding`.
    pub(crate) fn exr_coded(
        width: usize,
        height: usize,
        channels: &[(&str, FlatSamples)],
        encoding: Encoding,
    ) -> NamedBytes {
        let channels = channels
            .iter()
            .map(|(name, samples)| AnyChannel::new(*name, samples.clone()))
            .collect();
        let layer = Layer::new(
            (width, height),
            LayerAttributes::named("main"),
            encoding,
            AnyChannels::sort(channels),
        );
        let mut bytes = Cursor::new(Vec::new());
        Image::from_layer(layer).write().non_parallel().to_buffered(&mut bytes).unwrap();
        NamedBytes { path: PathBuf::from("a.exr"), bytes: bytes.into_inner() }
    }

    fn floats(raster: &Raster) -> &[f32] {
        match &raster.samples {
            Samples::F32(values) => values,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn channels_of_every_type_are_read_beside_others() {
        let file = exr(
            2,
            1,
            &[
                ("R", FlatSamples::F16(vec![f16::from_f32(0.5), f16::from_f32(2.0)])),
                ("G", FlatSamples::F32(vec![0.25, 1e6])),
                ("B", FlatSamples::U32(vec![3, 4])),
                ("A", FlatSamples::F32(vec![9.0, 9.0])),
                ("ID", FlatSamples::U32(vec![7, 7])),
            ],
        );
        let raster = decode_color(&file).unwrap();
        assert_eq!((raster.width, raster.height, raster.channels), (2, 1, 3));
        assert_eq!(floats(&raster), [0.5, 0.25, 3.0, 2.0, 1e6, 4.0]);
    }

    /// The red of a colour picture is no depth. Renderers write a depth beside it under names of their own.
    #[test]
    fn a_depth_is_not_the_red_of_a_colour_picture() {
        let of = |names: &[&str]| {
            let samples = |k: usize| FlatSamples::F32(vec![k as f32 + 1.0, 9.0]);
            let list: Vec<_> = names.iter().enumerate().map(|(k, n)| (*n, samples(k))).collect();
            exr(2, 1, &list)
        };
        for (names, depth) in [
            (&["R", "G", "B", "Z"][..], 4.0),
            (&["R", "G", "B", "depth.Y"], 4.0),
            (&["R", "G", "B", "A", "VRayZDepth.R"], 5.0),
            (&["R", "G", "B", "dd.T", "nn.X", "nn.Y", "nn.Z"], 4.0),
            (&["V.Combined.R", "V.Combined.G", "V.Combined.B", "V.Depth.Z"], 4.0),
            (&["RY", "BY", "Y", "Depth"], 4.0),
            (&["R", "A"], 1.0),
            (&["R", "ID.Y"], 1.0),
        ] {
            let file = of(names);
            let raster = decode_depth(&file).map_err(|e| format!("{names:?}: {e}")).unwrap();
            assert_eq!((floats(&raster), raster.channels), (&[depth, 9.0][..], 1), "{names:?}");
            assert_eq!(depth_size(&file).unwrap(), [2, 1]);
        }
        for names in [
            &["R", "G", "B"][..],
            &["R", "G", "B", "A"],
            &["R", "G"],
            &["R", "G", "B", "shadow.Y"],
            &["R", "G", "B", "depth.X", "depth.Y"],
            &["R", "G", "B", "depth.Y", "Distance"],
            &["RY", "BY", "Y"],
        ] {
            let error = decode_depth(&of(names)).unwrap_err().to_string();
            let all = names.iter().all(|name| error.contains(name));
            assert!(all && error.contains("give depth as a channel Z"), "{names:?}: {error}");
        }
        let grey = |blue: f32| {
            let values = |v: f32| FlatSamples::F32(vec![v, f32::NAN]);
            exr(2, 1, &[("R", values(2.0)), ("G", values(2.0)), ("B", values(blue))])
        };
        assert_eq!(floats(&decode_depth(&grey(2.0)).unwrap())[0], 2.0);
        assert!(decode_depth(&grey(2.5)).is_err());
    }

    #[test]
    fn a_single_channel_is_grey_or_depth() {
        let one = |name: &str| exr(1, 2, &[(name, FlatSamples::F32(vec![1.0, 2.0]))]);
        assert_eq!(decode_color(&one("Y")).unwrap().channels, 1);
        let ones = || FlatSamples::F32(vec![1.0]);
        let beside = [("Y", ones()), ("A", ones()), ("ID", ones())];
        assert_eq!(floats(&decode_color(&exr(1, 1, &beside)).unwrap()), [1.0]);
        for name in ["Z", "Y", "R", "depth.V"] {
            assert_eq!(floats(&decode_depth(&one(name)).unwrap()), [1.0, 2.0], "{name}");
        }
        let error = decode_color(&one("depth.V")).unwrap_err().to_string();
        assert!(error.contains("channels depth.V; give channels R, G and B"), "{error}");
        let samples = FlatSamples::F32(vec![1.0]);
        let two = exr(1, 1, &[("P", samples.clone()), ("Q", samples)]);
        assert!(decode_depth(&two).unwrap_err().to_string().contains("channels P, Q"));
    }
}
