//! Photographs of a tuple: their names, and the exposure that their meter chose. The camera itself is in the crate `compose`.

use super::tuple::Tuple;
use super::write::{halved, is_half};
use glasshouse_line::layer::Layer;
use glasshouse_line::{SENSOR_VERSION, SceneLine, SensorExposure};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// Name of the photograph of the input, a JPEG.
pub const PHOTO: &str = "photo.jpg";
/// Name of the sensor's numbers, an Adobe DNG.
pub const RAW: &str = "raw.dng";

/// Photographs of other layers without noise, PNGs.
const NOISELESS: [(&str, Layer); 2] = [
    ("photo_transmission.png", Layer::Transmission),
    ("photo_glass_reflection.png", Layer::GlassReflection),
];

/// Returns the names of a scene's photographs; none without a sensor.
pub fn photographs(line: &SceneLine) -> Vec<&'static str> {
    let Some(sensor) = &line.sensor else {
        return Vec::new();
    };
    let asked = line.film.layers.asked();
    let others = NOISELESS.into_iter().filter(|(_, layer)| asked[*layer]).map(|(name, _)| name);
    std::iter::once(PHOTO).chain(others).chain(sensor.raw.then_some(RAW)).collect()
}

/// Returns the layer that a photograph shows.
pub fn photographed_layer(name: &str) -> Option<Layer> {
    let noiseless = NOISELESS.into_iter().find(|(n, _)| *n == name).map(|(_, layer)| layer);
    if [PHOTO, RAW].contains(&name) { Some(Layer::Input) } else { noiseless }
}

/// Provenance of a tuple's photographs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhotographRecord {
    /// [`SENSOR_VERSION`] of the program that made them.
    pub sensor_version: u32,
    /// Factor of the light: the sensor's exposure, metered on the input of `tuple.exr`.
    pub exposure_factor: f64,
}

impl PhotographRecord {
    /// Meters the input of a tuple for a sensor.
    pub fn new(exposure: SensorExposure, input: &[[f32; 3]]) -> Self {
        let brightest = input.iter().map(|[r, g, b]| r.max(*g).max(*b).max(0.0));
        Self {
            sensor_version: SENSOR_VERSION,
            exposure_factor: metered_factor(exposure, brightest),
        }
    }
}

impl Tuple {
    /// Returns the pixels of a layer as `tuple.exr` stores them.
    pub fn stored(&self, layer: Layer) -> Cow<'_, [[f32; 3]]> {
        let pixels = &self.layers[layer];
        if is_half(&self.record.scene, &self.layers) {
            Cow::Owned(halved(pixels))
        } else {
            Cow::Borrowed(pixels)
        }
    }
}

/// Returns the factor of the light that a meter chooses, given the brightest channel of each pixel; 1 for a black input.
pub fn metered_factor(exposure: SensorExposure, brightest: impl Iterator<Item = f32>) -> f64 {
    match exposure {
        SensorExposure::Factor { factor } => factor,
        SensorExposure::Metered { percentile: at, level } => {
            let top = f64::from(percentile(brightest, at));
            if top > 0.0 { level / top } else { 1.0 }
        }
    }
}

/// Returns a percentile, from 0 to 100, of numbers that are not negative: the value of the nearest rank.
pub fn percentile(values: impl Iterator<Item = f32>, at: f64) -> f32 {
    // The bits of numbers that are not negative have the order of the numbers.
    let mut bits: Vec<u32> = values.map(f32::to_bits).collect();
    if bits.is_empty() {
        return 0.0;
    }
    let rank = (at / 100.0 * (bits.len() - 1) as f64).round() as usize;
    let (_, value, _) = bits.select_nth_unstable(rank);
    f32::from_bits(*value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn meters_give_a_percentile_its_level() {
        let input: Vec<[f32; 3]> = (0..=100).map(|k| [0.0, k as f32 * 0.02, 0.01]).collect();
        let metered = |percentile| SensorExposure::Metered { percentile, level: 0.9 };
        let factor = |exposure| PhotographRecord::new(exposure, &input).exposure_factor;
        assert!((factor(metered(50.0)) - 0.9).abs() < 1e-6);
        assert!((factor(metered(100.0)) - 0.45).abs() < 1e-6);
        assert_eq!(factor(SensorExposure::Factor { factor: 3.0 }), 3.0);
        let black = PhotographRecord::new(metered(99.0), &[[0.0; 3]; 4]);
        assert_eq!(black, PhotographRecord { sensor_version: 1, exposure_factor: 1.0 });
    }
}
