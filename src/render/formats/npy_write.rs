//! Writes NumPy arrays (`.npy`, format 1.0).

use exr::prelude::f16;
use glasshouse_line::ExrPrecision;

/// Length of the header, bytes.
const HEADER_BYTES: usize = 128;

/// Encodes `values` (C order) as a little-endian array of 32-bit floats; [`ExrPrecision::Half`] rounds them to halves.
pub fn encode_npy(shape: &[usize], values: &[f32], precision: ExrPrecision) -> Vec<u8> {
    let (code, size) = match precision {
        ExrPrecision::Half => ("<f2", 2),
        ExrPrecision::Float => ("<f4", 4),
    };
    let shape: Vec<String> = shape.iter().map(ToString::to_string).collect();
    let shape = shape.join(", ");
    let text = format!("{{'descr': '{code}', 'fortran_order': False, 'shape': ({shape}), }}");
    let text_bytes = HEADER_BYTES - 10;
    let mut bytes = Vec::with_capacity(HEADER_BYTES + size * values.len());
    bytes.extend_from_slice(b"\x93NUMPY\x01\x00");
    bytes.extend_from_slice(&(text_bytes as u16).to_le_bytes());
    bytes.extend_from_slice(text.as_bytes());
    bytes.resize(HEADER_BYTES - 1, b' ');
    bytes.push(b'\n');
    extend_floats(&mut bytes, values.iter().copied(), precision);
    bytes
}

/// Appends values as little-endian 32-bit floats; [`ExrPrecision::Half`] rounds them to halves.
pub fn extend_floats(
    bytes: &mut Vec<u8>,
    values: impl Iterator<Item = f32>,
    precision: ExrPrecision,
) {
    match precision {
        ExrPrecision::Half => bytes.extend(values.flat_map(|v| f16::from_f32(v).to_le_bytes())),
        ExrPrecision::Float => bytes.extend(values.flat_map(f32::to_le_bytes)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_independent_reader_reads_shape_and_values() {
        let values = [0.0, 1.0, -2.5, 1e-3, 7.0, f32::INFINITY];
        let floats = encode_npy(&[1, 2, 3], &values, ExrPrecision::Float);
        let read = npyz::NpyFile::new(&floats[..]).unwrap();
        assert_eq!(read.shape(), [1, 2, 3]);
        assert_eq!(read.into_vec::<f32>().unwrap(), values);

        let halves = encode_npy(&[3, 2], &values, ExrPrecision::Half);
        assert_eq!(halves.len(), HEADER_BYTES + 12);
        let read = npyz::NpyFile::new(&halves[..]).unwrap();
        assert_eq!((read.shape(), read.dtype().descr().as_str()), (&[3, 2][..], "'<f2'"));
        let read: Vec<f16> =
            halves[HEADER_BYTES..].chunks(2).map(|b| f16::from_le_bytes([b[0], b[1]])).collect();
        assert_eq!(read, values.map(f16::from_f32));
    }
}
