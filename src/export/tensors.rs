//! Converts a tuple to tensors: planes of linear light with the values and the precision of `tuple.exr`.

use super::request::{ExportFormat, PixelEncoding};
use super::sample::{label_file, layer_file, made};
use glasshouse_line::label::LabelImages;
use glasshouse_line::layer::PerLayer;
use glasshouse_line::{ExrPrecision, SceneLine};
use render::formats::{extend_floats, label_precision};

/// An array of little-endian floats, plane after plane.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Tensor {
    /// `ID.LAYER` or `ID.LABEL`, of `[A-Za-z0-9_.-]`.
    pub(super) name: String,
    pub(super) precision: ExrPrecision,
    /// Channels (if there are three), height and width.
    pub(super) shape: Vec<usize>,
    pub(super) bytes: Vec<u8>,
}

/// Returns a tensor for each layer and each label of a tuple, in the order of [`glasshouse_line::layer::Layer`], then of
/// [`glasshouse_line::label::Label`]. `precision` is that of the layers in `tuple.exr`.
pub(super) fn tensors(
    line: &SceneLine,
    layers: &PerLayer<Vec<[f32; 3]>>,
    labels: &LabelImages,
    precision: ExrPrecision,
) -> Vec<Tensor> {
    const PLACE: (ExportFormat, PixelEncoding) = (ExportFormat::Safetensors, PixelEncoding::Linear);
    let of_layers = made(line).map(|(layer, _)| Tensor {
        name: layer_file(PLACE.0, PLACE.1, line, layer),
        precision,
        shape: shape(line, 3),
        bytes: planes(layers.0[layer].as_flattened(), 3, precision),
    });
    let of_labels = labels.iter().map(|(label, values)| {
        let channels = label.channels().len();
        let precision = label_precision(*label, precision);
        Tensor {
            name: label_file(PLACE.0, line, *label),
            precision,
            shape: shape(line, channels),
            bytes: planes(values, channels, precision),
        }
    });
    of_layers.chain(of_labels).collect()
}

fn shape(line: &SceneLine, channels: usize) -> Vec<usize> {
    let size = [line.film.height, line.film.width].map(|side| side as usize);
    (channels > 1).then_some(channels).into_iter().chain(size).collect()
}

/// Encodes values with the channels of a pixel together as one plane after the other.
fn planes(values: &[f32], channels: usize, precision: ExrPrecision) -> Vec<u8> {
    let value_bytes = match precision {
        ExrPrecision::Half => 2,
        ExrPrecision::Float => 4,
    };
    let mut bytes = Vec::with_capacity(value_bytes * values.len());
    for channel in 0..channels {
        let plane = values.iter().skip(channel).step_by(channels).copied();
        extend_floats(&mut bytes, plane, precision);
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_follow_each_other() {
        let values = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        let floats = planes(&values, 3, ExrPrecision::Float);
        assert_eq!(floats_of(&floats), [1.0, 4.0, 2.0, 5.0, 3.0, 6.0]);
        assert_eq!(planes(&values, 1, ExrPrecision::Half).len(), 12);
        assert_eq!(planes(&[1.0], 1, ExrPrecision::Half), [0x00, 0x3c]);
    }

    fn floats_of(bytes: &[u8]) -> Vec<f32> {
        bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
    }
}
