//! Natural texture of surfaces: noise over many octaves, another one on each piece, as on stone, bark, cloth or gravel.
//!
//! Surfaces without it are smooth, and pictures of them have half the sharpness of photographs (docs/proof/runs.md).

use super::listing::Place;
use super::material::Material;
use super::noise::noise3;
use super::random::Stream;
use glam::Vec3;

/// Number of octaves, each half as long as the one before.
const OCTAVES: usize = 9;

/// Standard deviation of value noise in space, measured.
const NOISE_DEVIATION: f32 = 0.17;

/// Largest standard deviation of the albedo's logarithm.
const LARGEST_CONTRAST: f32 = 0.7;

/// Variation of a surface's albedo.
#[derive(Clone, Copy, Debug)]
pub(super) struct Texture {
    seed: i32,
    /// Standard deviation of the albedo's logarithm by the coarsest octave.
    octave_contrast: f32,
    /// Cells per metre of the coarsest noise, along each axis.
    frequency_per_m: Vec3,
    /// Contrast of an octave over that of the one before.
    persistence: f32,
    /// True for sparse, strong spots.
    has_spots: bool,
}

impl Texture {
    /// Draws the texture of a material on one piece of a place. Solids of one piece and one colour share it.
    pub(super) fn new(place: Place, place_key: u64, piece: u32, material: &Material) -> Self {
        let colour = material.main.to_array().map(|channel| u64::from(channel.to_bits()));
        let [red, green, blue] = colour;
        let seed = u64::from(material.seed.cast_unsigned());
        let mut draw = Stream::new(&[place_key, u64::from(piece), seed, red, green, blue]);
        let log_uniform =
            |draw: &mut Stream, low: f32, high: f32| low * libm::powf(high / low, draw.unit());
        let octave_contrast = log_uniform(&mut draw, 0.08, 0.5);
        // Outdoors, surfaces are farther away, and have the coarser textures of walls and meadows.
        let [low, high] = match place {
            Place::Indoors => [3.0, 40.0],
            Place::Outdoor => [0.4, 5.0],
        };
        let frequency_per_m = Vec3::splat(log_uniform(&mut draw, low, high));
        // Fibres, grain and strokes: two in five textures are longer along one axis.
        let stretch = if draw.chance(0.4) { draw.range(0.12, 0.5) } else { 1.0 };
        let stretched = draw.pick(&[Vec3::X, Vec3::Y, Vec3::Z]) * (stretch - 1.0) + Vec3::ONE;
        Self {
            seed: draw.seed(),
            octave_contrast,
            frequency_per_m: frequency_per_m * stretched,
            persistence: draw.range(0.85, 1.15),
            has_spots: draw.chance(0.4),
        }
    }

    /// Returns the factor of the albedo at texture point `p`, m. Its mean is about 1.
    pub(super) fn factor(&self, p: Vec3, footprint_m: f32) -> f32 {
        let (mut sum, mut variance) = (0.0, 0.0);
        for (octave, (frequency_per_m, contrast)) in (0i16..).zip(self.octaves(footprint_m)) {
            let shifted = p * frequency_per_m + Vec3::splat(0.37 * f32::from(octave));
            let seed = self.seed.wrapping_add(i32::from(octave));
            let noise = (noise3(shifted, seed) - 0.5) / NOISE_DEVIATION;
            sum += contrast * noise;
            variance += contrast * contrast;
        }
        if variance == 0.0 {
            return 1.0;
        }
        let deviation = variance.sqrt();
        let mut deviations = (sum / deviation).clamp(-3.0, 3.0);
        if self.has_spots {
            // A normal number times its magnitude has a standard deviation of 3^(1/2).
            deviations *= deviations.abs() / 1.732;
        }
        let contrast = deviation.min(LARGEST_CONTRAST);
        libm::expf(contrast * (deviations - 0.5 * contrast))
    }

    /// Yields the frequency (cells per metre) and the contrast of each octave. Octaves finer than the footprint would alias,
    /// and fade out.
    fn octaves(&self, footprint_m: f32) -> impl Iterator<Item = (Vec3, f32)> {
        let coarsest = (self.frequency_per_m, self.octave_contrast);
        let next = |&(frequency_per_m, contrast): &(Vec3, f32)| {
            Some((frequency_per_m * 2.0, contrast * self.persistence))
        };
        core::iter::successors(Some(coarsest), next)
            .take(OCTAVES)
            .map(move |(frequency_per_m, contrast)| {
                let cells = footprint_m * frequency_per_m.max_element();
                (frequency_per_m, contrast * (1.2 - cells).clamp(0.0, 1.0))
            })
            .take_while(|&(_, contrast)| contrast > 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::super::material::plain;
    use super::*;

    /// At footprints from 1 mm to 5 cm, factors of many textures have a mean of about 1 and their contrast.
    #[test]
    fn factors_keep_the_mean_and_the_contrast() {
        for footprint_m in [0.001f32, 0.01, 0.05] {
            let (mut mean, mut ratio, mut count) = (0.0, 0.0, 0.0);
            for piece in 0..60 {
                let texture = Texture::new(Place::Outdoor, 7, piece, &plain(0x808080));
                if texture.frequency_per_m.max_element() * footprint_m > 0.25 {
                    continue;
                }
                let logs: Vec<f32> = (0..4000)
                    .map(|k| {
                        let k = k as f32;
                        let p = Vec3::new(k * 0.317, k * 0.211, k * 0.131);
                        let factor = texture.factor(p, footprint_m);
                        mean += factor;
                        libm::logf(factor)
                    })
                    .collect();
                let centre = logs.iter().sum::<f32>() / 4000.0;
                let variance =
                    logs.iter().map(|l| (l - centre) * (l - centre)).sum::<f32>() / 4000.0;
                let octaves = texture.octaves(footprint_m);
                let contrast = octaves.map(|(_, contrast)| contrast * contrast).sum::<f32>().sqrt();
                ratio += variance.sqrt() / contrast.min(LARGEST_CONTRAST);
                count += 1.0;
            }
            assert!(count > 5.0);
            let (mean, ratio) = (mean / 4000.0 / count, ratio / count);
            assert!((0.95..1.1).contains(&mean), "{mean} at {footprint_m} m");
            assert!((0.85..1.15).contains(&ratio), "{ratio} at {footprint_m} m");
        }
    }

    /// Without aliasing, and without an edge at the distance where the texture ends.
    #[test]
    fn a_texture_fades_out_with_its_coarsest_octave() {
        for piece in 0..60 {
            let texture = Texture::new(Place::Indoors, 7, piece, &plain(0x808080));
            let at = |cells| {
                let footprint_m = cells / texture.frequency_per_m.max_element();
                texture.factor(Vec3::new(0.3, 0.7, 0.2), footprint_m)
            };
            assert!((at(1.19) - 1.0).abs() < 0.03, "{}", at(1.19));
            assert_eq!(at(1.21), 1.0);
        }
    }

    #[test]
    fn pieces_and_places_differ_and_solids_of_a_piece_do_not() {
        let at = |place, piece| {
            Texture::new(Place::Indoors, place, piece, &plain(0x406080)).factor(Vec3::ONE, 0.001)
        };
        assert_eq!(at(1, 2).to_bits(), at(1, 2).to_bits());
        assert_ne!(at(1, 2).to_bits(), at(1, 3).to_bits());
        assert_ne!(at(1, 2).to_bits(), at(2, 2).to_bits());
    }
}
