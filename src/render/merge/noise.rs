//! Noise map of a tuple, `RUN/noise/<scene>.exr`, for the report.
//!
//! The last doubling of the samples moves a pixel's mean (first half to all). A value of the map is the RMS of these
//! moves over the pixels of a cell and their colours, times one factor per layer that makes the RMS over all pixels the
//! layer's stated error. A cell has 2 x 2 px, because the move of one pixel is a poor estimate of its error; four
//! pixels give a better estimate in a quarter of the space. The map is not part of the tuple and may be missing.

use crate::formats::exr_read::{check_headers, decode_exr_channels};
use crate::formats::exr_write::{HALF_MAX, encode_exr};
use exr::prelude::{AnyChannel, FlatSamples, f16};
use glasshouse_line::Film;
use glasshouse_line::layer::{Layer, PerLayer};

/// Side of a cell, px; cells at the right and lower border may be smaller.
pub(super) const CELL_PX: u32 = 2;

/// Estimated RMS error of the pixels of each cell.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NoiseMap {
    /// Number of cells across.
    pub width: u32,
    /// Number of cells down.
    pub height: u32,
    /// Errors of each layer, linear, row by row; empty for layers that are not rendered, have one sample or
    /// are in closed form.
    pub layers: PerLayer<Vec<f32>>,
}

impl NoiseMap {
    /// Makes an empty map for a film.
    pub fn of(film: &Film) -> Self {
        Self {
            width: film.width.div_ceil(CELL_PX),
            height: film.height.div_ceil(CELL_PX),
            layers: PerLayer::default(),
        }
    }

    /// True if no layer has a map.
    pub fn is_empty(&self) -> bool {
        self.layers.0.iter().all(Vec::is_empty)
    }

    /// Encodes the map as OpenEXR with ZIP, one channel per layer: half floats, or floats if a value needs them.
    pub fn encode(&self) -> Result<Vec<u8>, exr::error::Error> {
        let half = self.layers.0.iter().flatten().all(|&v| v <= HALF_MAX);
        let made = self.layers.iter().filter(|(_, values)| !values.is_empty());
        let channels = made.map(|(layer, values)| {
            let samples = if half {
                FlatSamples::F16(values.iter().map(|&v| coarse(v)).collect())
            } else {
                FlatSamples::F32(values.clone())
            };
            AnyChannel::new(layer.name(), samples)
        });
        encode_exr(channels.collect(), self.width, self.height)
    }

    /// Decodes the map of a scene with this film. An error is a text for the user.
    pub fn decode(bytes: &[u8], film: &Film) -> Result<Self, String> {
        let mut map = Self::of(film);
        let size = [map.width, map.height];
        // The exr crate may panic on invalid bytes.
        let decoded = std::panic::catch_unwind(|| {
            check_headers(bytes, size, Layer::ALL.len())?;
            decode_exr_channels(bytes)
        });
        let decoded = decoded.unwrap_or_else(|_| Err("the OpenEXR reader failed".to_owned()))?;
        for (name, values) in decoded.list {
            let layer =
                Layer::from_name(&name).ok_or_else(|| format!("{name:?} is not a layer"))?;
            if !values.iter().all(|v| v.is_finite() && *v >= 0.0) {
                return Err(format!("its {name} has negative or non-finite values"));
            }
            map.layers[layer] = values;
        }
        Ok(map)
    }
}

/// Rounds to six significant bits (1.6 %): the estimate is no more precise, and shorter numbers compress better.
fn coarse(value: f32) -> f16 {
    const DROPPED: u16 = 5;
    let bits = f16::from_f32(value).to_bits();
    // Values are not negative, so a carry into the exponent rounds correctly.
    let rounded = (bits + (1 << (DROPPED - 1))) >> DROPPED << DROPPED;
    f16::from_bits(if f16::from_bits(rounded).is_finite() { rounded } else { bits })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glasshouse_line::parse_jsonl;

    /// Makes a film of 9 x 6 px, with 5 x 3 cells.
    fn film() -> Film {
        let line = r#"{"schema":"glasshouse.scene/1","id":"a","seed":1,"film":{"width":9,"height":6,"spp":16},
            "camera":{"focal_length_mm":55,"aperture_radius_m":0,"focus":{"at":"infinity"}},
            "glass":{"distance_m":0.3,"thickness_m":0.01,"ior":1.6},
            "front":{"color":"a.png","depth":"a.npy","intrinsics":{"fx":1,"fy":1,"cx":1,"cy":1}},
            "back":{"color":"b.png","depth":"b.npy","intrinsics":{"fx":1,"fy":1,"cx":1,"cy":1}}}"#;
        parse_jsonl(&line.replace('\n', " ")).unwrap()[0].film.clone()
    }

    fn map() -> NoiseMap {
        let values = |scale: f32| (0..15).map(|k| k as f32 * scale).collect();
        NoiseMap {
            layers: PerLayer([values(1e-4), Vec::new(), values(3e-3), values(0.0)]),
            ..NoiseMap::of(&film())
        }
    }

    #[test]
    fn maps_are_read_back_within_two_percent() {
        let map = map();
        let read = NoiseMap::decode(&map.encode().unwrap(), &film()).unwrap();
        for (read, wrote) in read.layers.0.iter().zip(&map.layers.0) {
            assert_eq!(read.len(), wrote.len());
            for (read, wrote) in read.iter().zip(wrote) {
                assert!((read - wrote).abs() <= 0.017 * wrote, "{read} {wrote}");
            }
        }
        let mut large = map;
        large.layers[Layer::Input][3] = 1e6;
        let read = NoiseMap::decode(&large.encode().unwrap(), &film()).unwrap();
        assert_eq!(read, large);
        assert!(!large.is_empty() && NoiseMap::default().is_empty());
        assert_eq!(coarse(HALF_MAX).to_f32(), HALF_MAX);
    }

    #[test]
    fn hostile_bytes_do_not_panic() {
        let film = film();
        let good = map().encode().unwrap();
        // The film has another size than the map.
        let mut other = film.clone();
        other.width = 11;
        let error = NoiseMap::decode(&good, &other).unwrap_err();
        assert!(error.contains("5 x 3 px"), "{error}");
        // The header and the film have a size that a file of this length cannot hold.
        let huge = NoiseMap {
            width: 4,
            height: 4,
            layers: PerLayer([vec![0.0; 16], Vec::new(), Vec::new(), Vec::new()]),
        };
        let mut bytes = huge.encode().unwrap();
        // The last column and row of the data window and the display window are 3; the loop changes them to 16383.
        let three = [3i32.to_le_bytes(), 3i32.to_le_bytes()].concat();
        let largest = [16_383i32.to_le_bytes(), 16_383i32.to_le_bytes()].concat();
        let mut found = 0;
        for at in 0..bytes.len() - 8 {
            if bytes[at..at + 8] == three {
                bytes[at..at + 8].copy_from_slice(&largest);
                found += 1;
            }
        }
        assert!(found >= 2);
        let mut film_of_it = film.clone();
        (film_of_it.width, film_of_it.height) = (32_768, 32_768);
        NoiseMap::decode(&bytes, &film_of_it).unwrap_err();
        // The file is truncated at every length, or one byte is changed.
        for end in 0..good.len() {
            NoiseMap::decode(&good[..end], &film).unwrap_err();
        }
        for at in 0..good.len() {
            let mut bytes = good.clone();
            bytes[at] ^= 0x55;
            let _ = NoiseMap::decode(&bytes, &film);
        }
    }
}
