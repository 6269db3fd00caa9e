//! Inspects OpenEXR files: the header of any file, and images without layers.

use super::facts::{Inspection, Problem};
use super::input::{AGAIN, Input};
use super::kind::Kind;
use exr::meta::MetaData;
use exr::prelude::{AttributeValue, SampleType, Text, Vec2};
use glasshouse_line::label::Label;
use glasshouse_line::layer::Layer;
use render::formats::limits::{MAX_PIXELS, MAX_SIDE};
use render::formats::{ExrChannels, decode_exr_channels};
use serde_json::json;
use std::io::Cursor;

const MAX_CHANNELS: usize = 256;
/// Largest ratio of pixel bytes to file bytes that a header may claim. Deflate expands at most 1,032 times.
const MOST_INFLATED: u64 = 1100;

/// Header of the first part.
pub(super) struct Head {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Names and types of the channels.
    pub(super) channels: Vec<(String, &'static str)>,
    pub(super) compression: String,
    /// Text of the attribute `glasshouse`, which partials have.
    pub(super) attribute: Option<String>,
}

impl Head {
    /// Lists the types of the channels, such as `half` or `float and half`.
    pub(super) fn precision(&self) -> String {
        let mut types: Vec<&str> = self.channels.iter().map(|(_, kind)| *kind).collect();
        types.sort_unstable();
        types.dedup();
        types.join(" and ")
    }

    /// True if the image has channels of the layer, such as `input.R`.
    pub(super) fn has_layer(&self, layer: &str) -> bool {
        self.channels.iter().any(|(name, _)| is_of(name, layer))
    }
}

fn is_of(channel: &str, layer: &str) -> bool {
    channel.strip_prefix(layer).is_some_and(|rest| rest.starts_with('.'))
}

/// Reads the header without allocating memory for the claimed sizes. Rejects unsupported files.
pub(super) fn head(bytes: &[u8]) -> Result<Head, String> {
    let meta =
        MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(|e| e.to_string())?;
    let first = meta.headers.first().ok_or("it has no layer")?;
    let Vec2(width, height) = first.layer_size;
    let list = &first.channels.list;
    if !(1..=MAX_SIDE).contains(&width)
        || !(1..=MAX_SIDE).contains(&height)
        || width * height > MAX_PIXELS
    {
        return Err(format!("its header claims {width} x {height} px"));
    }
    if list.len() > MAX_CHANNELS || first.deep || list.iter().any(|c| c.sampling != Vec2(1, 1)) {
        return Err("it has deep data, subsampled channels or more than 256 channels, which this program does not write".to_owned());
    }
    let claimed = (width * height) as u64 * first.channels.bytes_per_pixel as u64;
    if claimed / MOST_INFLATED > bytes.len() as u64 {
        return Err(format!(
            "it is truncated: {width} x {height} px of {} channels do not fit into {} bytes",
            list.len(),
            bytes.len()
        ));
    }
    let attribute = match first.own_attributes.other.get(&Text::from("glasshouse")) {
        Some(AttributeValue::Text(text)) => Some(text.to_string()),
        _ => None,
    };
    let name = |kind| match kind {
        SampleType::F16 => "half",
        SampleType::F32 => "float",
        SampleType::U32 => "integer",
    };
    Ok(Head {
        width,
        height,
        channels: list.iter().map(|c| (c.name.to_string(), name(c.sample_type))).collect(),
        compression: first.compression.to_string(),
        attribute,
    })
}

/// Returns the remedy for a damaged image.
pub(super) fn to_do(kind: Kind) -> &'static str {
    match kind {
        Kind::Partial => "nothing: `glasshouse work RUN` traces it again",
        _ => AGAIN,
    }
}

/// Inspects an image without layers: an output of `render`, a reference, or an input.
pub(super) fn read(input: &Input, head: &Head) -> Inspection {
    let mut found = Inspection::new(Kind::Exr);
    say_size(&mut found, head);
    say_layer(&mut found, input.name, "linear radiance, by `glasshouse render` or `bench`");
    let names: Vec<&String> = head.channels.iter().map(|(name, _)| name).collect();
    found.facts.value("channels", json!(names));
    match decode_exr_channels(input.bytes) {
        Ok(channels) => {
            for (name, values) in &channels.list {
                say_values(&mut found, name, values.iter());
            }
            found.may_be_whole("every pixel can be read; the file has no digest");
        }
        Err(reason) => {
            let what = format!("its pixels cannot be read: {reason}");
            found.wrong(Problem::new(what, to_do(Kind::Exr)));
        }
    }
    found
}

/// Adds the layer that the file name gives, if any, and the encoding of its values.
pub(super) fn say_layer(found: &mut Inspection, name: &str, encoding: &str) {
    let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
    if Layer::NAMES.contains(&stem) {
        found.facts.fact("layer", format!("{stem}, {encoding}"), stem);
    }
}

/// Adds size, precision and compression.
pub(super) fn say_size(found: &mut Inspection, head: &Head) {
    let (width, height) = (head.width, head.height);
    let text = format!("{width} x {height} px, {}, {}", head.precision(), head.compression);
    found.facts.say("image", text);
    found.facts.put("width", width);
    found.facts.put("height", height);
    found.facts.put("precision", head.precision());
}

/// Adds the smallest, mean and largest finite value; returns the number of non-finite values.
pub(super) fn say_values<'a>(
    found: &mut Inspection,
    name: &str,
    values: impl Iterator<Item = &'a f32>,
) -> u64 {
    let (mut least, mut most, mut sum, mut count) = (f32::INFINITY, f32::NEG_INFINITY, 0.0, 0u64);
    let (mut nan, mut infinite) = (0u64, 0u64);
    for value in values {
        if value.is_nan() {
            nan += 1;
        } else if value.is_infinite() {
            infinite += 1;
        } else {
            (least, most) = (least.min(*value), most.max(*value));
            sum += f64::from(*value);
            count += 1;
        }
    }
    let mean = sum / count as f64;
    let finite = |value: f64| (count > 0).then_some(value);
    let value = json!({
        "min": finite(least.into()), "mean": finite(mean), "max": finite(most.into()),
        "nan": nan, "infinite": infinite,
    });
    found.facts.value(name, value);
    nan + infinite
}

/// Adds the range and mean of each layer's values; returns the number of non-finite values.
pub(super) fn say_layers(found: &mut Inspection, channels: &ExrChannels) -> u64 {
    let mut not_finite = 0;
    for layer in Layer::NAMES {
        let of = channels.list.iter().filter(|(name, _)| is_of(name, layer));
        let mut values = of.flat_map(|(_, values)| values).peekable();
        if values.peek().is_some() {
            not_finite += say_values(found, layer, values);
        }
    }
    for label in Label::ALL {
        let of = channels.list.iter().filter(|(name, _)| is_of(name, label.name()));
        let mut values = of.flat_map(|(_, values)| values).peekable();
        if values.peek().is_some() {
            let infinite = say_values(found, label.name(), values);
            // A depth without a surface is infinite.
            not_finite += if label == Label::FrontDepth { 0 } else { infinite };
        }
    }
    not_finite
}
