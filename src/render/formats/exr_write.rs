//! Writes OpenEXR files of one or more parts with ZIP compression, on one thread: equal pixels give equal bytes.

use super::exr_labels::channels_of;
use super::exr_zip::write_zip16;
use exr::image::write::layers::WritableLayers;
use exr::prelude::{
    AnyChannel, AnyChannels, Compression, Encoding, FlatSamples, Image, ImageAttributes,
    IntegerBounds, Layer, LayerAttributes, LineOrder, WritableImage, f16,
};
use glasshouse_line::ExrPrecision;
use glasshouse_line::label::LabelImages;
use std::io::Cursor;

/// Largest value of a half float.
pub(crate) const HALF_MAX: f32 = 65_504.0;

/// Encodes one layer as 32-bit float OpenEXR with channels R, G, B.
pub fn encode_rgb_exr(
    pixels: &[[f32; 3]],
    width: u32,
    height: u32,
) -> Result<Vec<u8>, exr::error::Error> {
    encode_exr(rgb_channels(pixels, ExrPrecision::Float), width, height)
}

/// Encodes named layers as the parts of one OpenEXR file, with channels R, G, B, and after them labels with their own channels.
/// [`ExrPrecision::Half`] rounds values to halves. A single layer with an empty name becomes a plain file of one part.
pub fn encode_parts_exr(
    parts: &[(&str, &[[f32; 3]])],
    labels: &LabelImages,
    width: u32,
    height: u32,
    precision: ExrPrecision,
) -> Result<Vec<u8>, exr::error::Error> {
    if let [("", pixels)] = parts {
        return encode_exr(rgb_channels(pixels, precision), width, height);
    }
    let layers = parts.iter().map(|(name, pixels)| {
        layer_of(LayerAttributes::named(*name), rgb_channels(pixels, precision), [width, height])
    });
    let labels = labels.iter().map(|(label, values)| {
        let channels = channels_of(*label, values, precision).collect();
        layer_of(LayerAttributes::named(label.name()), channels, [width, height])
    });
    let layers: Vec<Layer<AnyChannels<FlatSamples>>> = layers.chain(labels).collect();
    let bounds = IntegerBounds::new((0, 0), (width as usize, height as usize));
    write_zip16(&Image::from_layers(ImageAttributes::new(bounds), layers))
}

fn rgb_channels(pixels: &[[f32; 3]], precision: ExrPrecision) -> Vec<AnyChannel<FlatSamples>> {
    let values = |c: usize| pixels.iter().map(move |p| p[c]);
    let colours = ["R", "G", "B"].into_iter().enumerate();
    colours.map(|(c, name)| channel(name, values(c), precision)).collect()
}

/// Makes a channel. [`ExrPrecision::Half`] rounds its values to halves.
pub(crate) fn channel(
    name: &str,
    values: impl Iterator<Item = f32>,
    precision: ExrPrecision,
) -> AnyChannel<FlatSamples> {
    let samples = match precision {
        ExrPrecision::Half => FlatSamples::F16(values.map(f16::from_f32).collect()),
        ExrPrecision::Float => FlatSamples::F32(values.collect()),
    };
    AnyChannel::new(name, samples)
}

/// Encodes one part without a name.
pub(crate) fn encode_exr(
    channels: Vec<AnyChannel<FlatSamples>>,
    width: u32,
    height: u32,
) -> Result<Vec<u8>, exr::error::Error> {
    write_zip16(&Image::from_layer(layer_of(LayerAttributes::default(), channels, [width, height])))
}

fn layer_of(
    attributes: LayerAttributes,
    channels: Vec<AnyChannel<FlatSamples>>,
    [width, height]: [u32; 2],
) -> Layer<AnyChannels<FlatSamples>> {
    let encoding = Encoding {
        compression: Compression::ZIP16,
        blocks: exr::image::Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    Layer::new(
        (width as usize, height as usize),
        attributes,
        encoding,
        AnyChannels::sort(channels.into_iter().collect()),
    )
}

/// Writes the file into `bytes`, a buffer that may have reserved capacity.
pub(crate) fn write_exr_into<'image, Layers: WritableLayers<'image>>(
    image: &'image Image<Layers>,
    bytes: Vec<u8>,
) -> Result<Vec<u8>, exr::error::Error> {
    let mut bytes = Cursor::new(bytes);
    image.write().non_parallel().to_buffered(&mut bytes)?;
    Ok(bytes.into_inner())
}
