//! Exposes a sensor: from the light of its photosites to the numbers of its converter (DN).
//!
//! ```text
//! dn = round(black + gain e + read + row),   e = min(photons(light white_e), full_well)
//! ```
//!
//! Janesick, "Photon Transfer", SPIE 2007; Wei et al., "A physics-based noise formation model for extreme low-light raw
//! denoising", CVPR 2020, for the distribution of read noise and for row noise.

use super::philox::{RowWords, philox};
use super::photons::Photons;
use crate::quantiles::Quantiles;
use glasshouse_line::Sensor;
use render::trace::Isa;

/// The last word of counters: of photosites, and of rows.
const PHOTOSITE: u32 = 0;
const ROW: u32 = 1;

/// Exposes photosites of raw values, row by row. The noise of a photosite is a function of the seed, its row and its
/// column alone.
pub(super) fn expose(raw: &[f32], width: usize, sensor: &Sensor, seed: u64, isa: Isa) -> Vec<u16> {
    let key = [seed as u32, (seed >> 32) as u32];
    let tukey = sensor.read_noise_lambda.map(Quantiles::tukey);
    let photons = Photons::tables();
    let (normal, read) = (Quantiles::normal(), tukey.as_ref().unwrap_or(Quantiles::normal()));
    let white_e = sensor.white_e() as f32;
    let full_well_e = sensor.full_well_e.map_or(f32::INFINITY, |e| e as f32);
    let (gain, read_dn, row_dn) =
        (sensor.gain_dn_per_e as f32, sensor.read_noise_dn as f32, sensor.row_noise_dn as f32);
    let (black, most) = (sensor.black_level_dn as f32, sensor.white_level_dn() as f32);
    let mut words = RowWords::new(width);
    let mut numbers = Vec::with_capacity(raw.len());
    for (y, row) in raw.chunks_exact(width.max(1)).enumerate() {
        let of_row = black + row_dn * normal.of(philox([0, y as u32, 0, ROW], key)[0]);
        words.fill([y as u32, 0, PHOTOSITE], key, isa);
        numbers.extend(row.iter().enumerate().map(|(x, light)| {
            let [a, b, c] = words.at(x);
            let electrons = photons.electrons(light * white_e, [a, b]).min(full_well_e);
            let dn = of_row + gain * electrons + read_dn * read.of(c);
            // Adding a half before the truncation rounds numbers that are not negative.
            (dn + 0.5).clamp(0.0, most) as u16
        }));
    }
    numbers
}

/// Returns the raw values of converter numbers: 0 at the black level and 1 at white. Noise makes some negative.
pub(super) fn raw_values(numbers: &[u16], sensor: &Sensor) -> Vec<f32> {
    let black = sensor.black_level_dn as f32;
    let scale = 1.0 / (sensor.gain_dn_per_e * sensor.white_e()) as f32;
    numbers.iter().map(|dn| (f32::from(*dn) - black) * scale).collect()
}
