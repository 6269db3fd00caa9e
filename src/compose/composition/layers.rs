//! The linear layers of a tuple in memory, as `tuple.exr` stores them.

use super::Cut;
use super::stored::{StoredLayer, widened};
use crate::resample::resample;
use exr::prelude::f16;
use std::sync::OnceLock;

/// Shares of red, green and blue in luminance (IEC 61966-2-1).
pub const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// A linear layer: one plane after another (three, or one of a mask), each row by row. Values are finite and not negative.
#[derive(Clone, Debug, PartialEq)]
pub enum Layer {
    Halves(Vec<f16>),
    /// Values of a tuple with 32-bit floats.
    Floats(Vec<f32>),
    /// Values in a file that is mapped into memory.
    Stored(StoredLayer),
}

impl Layer {
    /// Splits pixels into planes. Stores halves if these have all bits of the values.
    pub fn of_pixels(pixels: &[[f32; 3]]) -> Self {
        let channel = |channel: usize| pixels.iter().map(move |pixel| pixel[channel]);
        Self::of_values(&(0..3).flat_map(channel).collect::<Vec<f32>>())
    }

    /// Makes a layer of planes. Stores halves if these have all bits of the values.
    pub fn of_values(values: &[f32]) -> Self {
        let halves: Vec<f16> = values.iter().map(|value| f16::from_f32(*value)).collect();
        let is_equal = |(value, half): (&f32, &f16)| widened(*half).to_bits() == value.to_bits();
        if values.iter().zip(&halves).all(is_equal) {
            return Self::Halves(halves);
        }
        Self::Floats(values.to_vec())
    }

    pub fn len(&self) -> usize {
        match self {
            Self::Halves(values) => values.len(),
            Self::Floats(values) => values.len(),
            Self::Stored(values) => values.len(),
        }
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    fn bytes(&self) -> usize {
        match self {
            Self::Halves(values) => size_of_val(&values[..]),
            Self::Floats(values) => size_of_val(&values[..]),
            // The system takes the pages of a file away when others need the memory.
            Self::Stored(_) => 0,
        }
    }

    /// Returns all planes.
    pub fn planes(&self) -> Vec<f32> {
        let mut planes = Vec::with_capacity(self.len());
        self.push_row(0, self.len(), &mut planes);
        planes
    }

    /// Appends a part of one row.
    fn push_row(&self, start: usize, count: usize, out: &mut Vec<f32>) {
        match self {
            Self::Halves(values) => {
                out.extend(values[start..start + count].iter().map(|half| widened(*half)));
            }
            Self::Floats(values) => out.extend_from_slice(&values[start..start + count]),
            Self::Stored(values) => values.push_row(start, count, out),
        }
    }

    /// Returns a crop, mirrored if the cut is.
    fn cut(&self, rows: usize, columns: usize, cut: Cut) -> Vec<f32> {
        let planes = self.len() / (rows * columns);
        let mut out = Vec::with_capacity(planes * cut.size * cut.size);
        for plane in 0..planes {
            for row in cut.row..cut.row + cut.size {
                let begin = out.len();
                self.push_row((plane * rows + row) * columns + cut.column, cut.size, &mut out);
                if cut.mirrored {
                    out[begin..].reverse();
                }
            }
        }
        out
    }
}

/// The linear layers of a tuple.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearTuple {
    pub rows: usize,
    pub columns: usize,
    pub input: Layer,
    pub transmission: Layer,
    pub glass_reflection: Layer,
    /// `None` if the tuple lacks this layer.
    pub clean_reflection: Option<Layer>,
    /// One plane: share of each pixel's camera samples that meet the glass. `None` if the pane fills the film.
    pub coverage: Option<Layer>,
    /// See [`Self::strength`].
    strength: OnceLock<f64>,
}

/// Layers of a tuple, by name.
#[derive(Clone, Debug)]
pub struct TupleLayers {
    pub input: Layer,
    pub transmission: Layer,
    pub glass_reflection: Layer,
    pub clean_reflection: Option<Layer>,
    pub coverage: Option<Layer>,
}

impl LinearTuple {
    /// Collects the layers of a film; returns `None` if a layer has another size.
    pub fn new(rows: usize, columns: usize, layers: TupleLayers) -> Option<Self> {
        let TupleLayers { input, transmission, glass_reflection, clean_reflection, coverage } =
            layers;
        let colour = [Some(&input), Some(&transmission), Some(&glass_reflection)];
        let colour = colour.into_iter().chain([clean_reflection.as_ref()]).flatten();
        let has_sizes = colour.map(|layer| (layer, 3)).chain(coverage.as_ref().map(|c| (c, 1)));
        let pixels = rows * columns;
        if pixels == 0 || !has_sizes.into_iter().all(|(layer, n)| layer.len() == n * pixels) {
            return None;
        }
        Some(Self {
            rows,
            columns,
            input,
            transmission,
            glass_reflection,
            clean_reflection,
            coverage,
            strength: OnceLock::new(),
        })
    }

    /// Returns the mean luminance of R~ over that of F = I - R~; 0 for a black front. The first call reads both layers.
    pub fn strength(&self) -> f64 {
        *self.strength.get_or_init(|| {
            let (mut front, reflected) = (self.input.planes(), self.glass_reflection.planes());
            subtract(&mut front, &reflected);
            let [front, reflected] =
                [front, reflected].map(|planes| luminance(channel_means(&planes)));
            if front > 0.0 { reflected / front } else { 0.0 }
        })
    }

    /// Returns the memory of all layers, bytes.
    pub fn bytes(&self) -> usize {
        let layers = [&self.input, &self.transmission, &self.glass_reflection];
        let more = [self.clean_reflection.as_ref(), self.coverage.as_ref()];
        layers.into_iter().chain(more.into_iter().flatten()).map(Layer::bytes).sum()
    }

    /// Returns a crop of a layer, scaled down to `size_px` if it is larger.
    pub(super) fn crop(&self, layer: &Layer, cut: Cut, size_px: usize) -> Vec<f32> {
        let planes = layer.cut(self.rows, self.columns, cut);
        if cut.size == size_px { planes } else { resample(&planes, [cut.size; 2], [size_px; 2]) }
    }

    /// Returns a crop of F = I - R~ in f32. F + R~ is I, bit for bit, unless R~ exceeds 8,192 I.
    pub(super) fn crop_front(&self, cut: Cut, size_px: usize) -> Vec<f32> {
        let mut front = self.input.cut(self.rows, self.columns, cut);
        subtract(&mut front, &self.glass_reflection.cut(self.rows, self.columns, cut));
        if cut.size == size_px { front } else { resample(&front, [cut.size; 2], [size_px; 2]) }
    }
}

fn subtract(from: &mut [f32], what: &[f32]) {
    for (value, other) in from.iter_mut().zip(what) {
        *value -= other;
    }
}

/// Returns the means of three planes. The order of the sums depends only on the number of values.
pub(super) fn channel_means(planes: &[f32]) -> [f64; 3] {
    let pixels = planes.len() / 3;
    [0, 1, 2].map(|channel| {
        let plane = &planes[channel * pixels..][..pixels];
        let mut sums = [0.0f64; 8];
        for chunk in plane.chunks(8) {
            for (sum, value) in sums.iter_mut().zip(chunk) {
                *sum += f64::from(*value);
            }
        }
        sums.iter().sum::<f64>() / pixels as f64
    })
}

/// Multiplies each plane by another one.
pub(super) fn multiply_planes(planes: &mut [f32], by: &[f32]) {
    for plane in planes.chunks_exact_mut(by.len()) {
        plane.iter_mut().zip(by).for_each(|(value, factor)| *value *= factor);
    }
}

/// Returns the luminance of a colour.
pub(super) fn luminance(colour: [f64; 3]) -> f64 {
    LUMINANCE.iter().zip(colour).map(|(share, value)| share * value).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_widen_exactly() {
        for bits in 0..=u16::MAX {
            let half = f16::from_bits(bits);
            if half.is_finite() {
                assert_eq!(widened(half).to_bits(), half.to_f32().to_bits(), "{bits:#x}");
            }
        }
    }

    /// F + R~ is I for all pairs of halves with R~ up to 8,192 I; a rendered R~ exceeds I only by rounding.
    #[test]
    fn front_and_reflection_add_up_to_the_input() {
        let numbers: Vec<f32> =
            (0..f16::INFINITY.to_bits()).map(|bits| widened(f16::from_bits(bits))).collect();
        // All inputs would take minutes in a debug build: a prime stride meets every exponent.
        for input in numbers.iter().step_by(37).chain([&0.0, &1.0, &65504.0]) {
            let wrong = numbers
                .iter()
                .take_while(|r| **r <= input * 8192.0)
                .filter(|r| ((input - **r) + **r).to_bits() != input.to_bits())
                .count();
            assert_eq!(wrong, 0, "{input}");
        }
    }

    #[test]
    fn layers_keep_the_bits_and_the_strength() {
        let halves = Layer::of_pixels(&[[1.0, 0.5, 0.25], [0.0, 3.0, 65504.0]]);
        assert!(matches!(&halves, Layer::Halves(v) if v.len() == 6 && v[1] == f16::from_f32(0.0)));
        let floats = Layer::of_pixels(&[[0.1, 0.5, 1e6]]);
        assert_eq!(floats, Layer::Floats(vec![0.1, 0.5, 1e6]));
        let grey = |value: f32| Layer::of_pixels(&[[value; 3]; 6]);
        let layers = |clean| TupleLayers {
            input: grey(0.75),
            transmission: grey(0.625),
            glass_reflection: grey(0.25),
            clean_reflection: clean,
            coverage: None,
        };
        let tuple = LinearTuple::new(2, 3, layers(Some(grey(2.0)))).unwrap();
        assert_eq!((tuple.strength(), tuple.bytes()), (0.5, 4 * 18 * 2));
        assert!(LinearTuple::new(2, 3, layers(Some(Layer::of_pixels(&[[1.0; 3]])))).is_none());
        assert!(LinearTuple::new(3, 3, layers(None)).is_none());
    }

    #[test]
    fn crops_are_mirrored() {
        let pixels: Vec<[f32; 3]> = (0..20).map(|k| [k as f32, 100.0 + k as f32, 0.0]).collect();
        let layer = Layer::of_pixels(&pixels);
        let cut = Cut { row: 1, column: 2, size: 2, mirrored: false };
        assert_eq!(layer.cut(4, 5, cut)[..6], [7.0, 8.0, 12.0, 13.0, 107.0, 108.0]);
        let mirrored = Cut { mirrored: true, ..cut };
        assert_eq!(layer.cut(4, 5, mirrored)[..4], [8.0, 7.0, 13.0, 12.0]);
    }
}
