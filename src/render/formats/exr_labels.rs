//! Channels of labels in OpenEXR files: `coverage.Y`, `front_depth.Z`, `ghosts.R`, ...

use super::exr_write::channel;
use exr::prelude::{AnyChannel, FlatSamples};
use glasshouse_line::ExrPrecision;
use glasshouse_line::label::{Label, LabelImages};

/// Returns the precision of a label in a file whose layers have `precision`. Halves are too coarse for a depth.
pub fn label_precision(label: Label, precision: ExrPrecision) -> ExrPrecision {
    if label == Label::FrontDepth { ExrPrecision::Float } else { precision }
}

/// Makes the channels of labels.
pub(crate) fn label_channels(
    labels: &LabelImages,
    precision: ExrPrecision,
) -> impl Iterator<Item = AnyChannel<FlatSamples>> + '_ {
    labels.iter().flat_map(move |(label, values)| {
        channels_of(*label, values, precision).map(move |mut channel| {
            channel.name = format!("{label}.{}", channel.name).as_str().into();
            channel
        })
    })
}

/// Makes the channels of one label, without its name.
pub(super) fn channels_of(
    label: Label,
    values: &[f32],
    precision: ExrPrecision,
) -> impl Iterator<Item = AnyChannel<FlatSamples>> + '_ {
    let names = label.channels();
    names.iter().enumerate().map(move |(c, name)| {
        let of_channel = values.iter().skip(c).step_by(names.len()).copied();
        channel(name, of_channel, label_precision(label, precision))
    })
}

/// Joins the channels of a label of `pixels` pixels, which `values_of` finds by their names. Returns `None` if one is missing.
pub(crate) fn read_label<'a>(
    label: Label,
    pixels: usize,
    values_of: impl Fn(&str) -> Option<&'a [f32]>,
) -> Option<Vec<f32>> {
    let names = label.channels();
    let mut values = vec![0.0; names.len() * pixels];
    for (c, name) in names.iter().enumerate() {
        let of_channel = values_of(&format!("{label}.{name}"))?;
        for (value, of_channel) in values.iter_mut().skip(c).step_by(names.len()).zip(of_channel) {
            *value = *of_channel;
        }
    }
    Some(values)
}
