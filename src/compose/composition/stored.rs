//! Layers in files that are mapped into memory.

use exr::prelude::f16;
use std::fmt;
use std::ops::Range;
use std::sync::Arc;

/// Bytes that several layers share.
pub type SharedBytes = Arc<dyn AsRef<[u8]> + Send + Sync>;

/// Little-endian half floats or 32-bit floats in a part of shared bytes. A crop reads only its own rows.
#[derive(Clone)]
pub struct StoredLayer {
    bytes: SharedBytes,
    /// Part of the bytes.
    range: Range<usize>,
    /// 2 or 4.
    value_bytes: usize,
}

impl StoredLayer {
    /// Makes a layer of half floats (`value_bytes` = 2) or 32-bit floats (4). Returns `None` if the bytes end before the range, or if
    /// it does not hold whole values.
    pub fn new(bytes: SharedBytes, range: Range<usize>, value_bytes: usize) -> Option<Self> {
        let length = (*bytes).as_ref().get(range.clone())?.len();
        let is_known = value_bytes == 2 || value_bytes == 4;
        (is_known && length % value_bytes == 0).then_some(Self { bytes, range, value_bytes })
    }

    pub(super) fn len(&self) -> usize {
        self.range.len() / self.value_bytes
    }

    fn values(&self) -> &[u8] {
        &(*self.bytes).as_ref()[self.range.clone()]
    }

    /// Appends a part of one row.
    pub(super) fn push_row(&self, start: usize, count: usize, out: &mut Vec<f32>) {
        let part = &self.values()[self.value_bytes * start..][..self.value_bytes * count];
        if self.value_bytes == 2 {
            let halves = part.as_chunks().0.iter().map(|bytes| f16::from_le_bytes(*bytes));
            out.extend(halves.map(widened));
        } else {
            out.extend(part.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)));
        }
    }
}

/// Returns a half as a float. Equals `f16::to_f32` for all numbers, but the compiler can vectorise it.
pub(super) fn widened(half: f16) -> f32 {
    /// 2^112, the difference of the exponents' biases.
    const BIAS: f32 = f32::from_bits((112 + 127) << 23);
    let bits = u32::from(half.to_bits());
    let magnitude = f32::from_bits((bits & 0x7fff) << 13) * BIAS;
    f32::from_bits(magnitude.to_bits() | (bits & 0x8000) << 16)
}

impl PartialEq for StoredLayer {
    fn eq(&self, other: &Self) -> bool {
        self.value_bytes == other.value_bytes && self.values() == other.values()
    }
}

impl fmt::Debug for StoredLayer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "StoredLayer of {} values of {} bytes", self.len(), self.value_bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Layer, LinearTuple, TupleLayers};
    use super::*;

    /// Encodes a layer as halves or floats, after some bytes of another.
    fn stored(layer: &Layer, value_bytes: usize) -> Layer {
        let mut bytes = vec![7; 8];
        for value in layer.planes() {
            match value_bytes {
                2 => bytes.extend(f16::from_f32(value).to_le_bytes()),
                _ => bytes.extend(value.to_le_bytes()),
            }
        }
        let range = 8..bytes.len();
        Layer::Stored(StoredLayer::new(Arc::new(bytes), range, value_bytes).unwrap())
    }

    #[test]
    fn stored_layers_have_the_values_of_others() {
        let pixels: Vec<[f32; 3]> =
            (0..20).map(|k| [0.125 * k as f32, 3.0, 1.0 / (1 << k) as f32]).collect();
        let plain = Layer::of_pixels(&pixels);
        let tuple = |of: &dyn Fn(&Layer) -> Layer| {
            let grey = Layer::of_pixels(&[[0.25; 3]; 20]);
            let layers = TupleLayers {
                input: of(&plain),
                transmission: of(&plain),
                glass_reflection: of(&grey),
                clean_reflection: None,
                coverage: None,
            };
            LinearTuple::new(4, 5, layers).unwrap()
        };
        let held = tuple(&Layer::clone);
        for value_bytes in [2, 4] {
            let mapped = tuple(&|layer| stored(layer, value_bytes));
            assert_eq!(mapped.input.planes(), plain.planes());
            assert_eq!((mapped.strength(), mapped.bytes()), (held.strength(), 0));
            let cut = super::super::Cut { row: 1, column: 2, size: 3, mirrored: true };
            assert_eq!(mapped.crop_front(cut, 3), held.crop_front(cut, 3));
        }
    }

    #[test]
    fn parts_outside_of_the_bytes_are_refused() {
        let bytes = || -> SharedBytes { Arc::new(vec![0u8; 16]) };
        assert!(StoredLayer::new(bytes(), 0..16, 4).is_some());
        for (range, value_bytes) in [(0..17, 2), (8..15, 2), (0..6, 4), (0..6, 3)] {
            assert!(StoredLayer::new(bytes(), range, value_bytes).is_none());
        }
    }
}
