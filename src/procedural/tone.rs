//! Encoding of linear radiance: exposure, film curve, sRGB.

use glam::Vec3;

const TABLE_COUNT: usize = 4096;

/// The tone curve of one photograph.
#[derive(Debug)]
pub(super) struct Tone {
    exposure: f32,
    /// sRGB codes of evenly spaced linear values from 0 to 1.
    table: Vec<f32>,
}

impl Tone {
    /// Finds the exposure that brings the mean code of `radiances` to `brightness`.
    pub(super) fn aimed(radiances: &[Vec3], brightness: f32) -> Self {
        let code = |c: f32| {
            if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * libm::powf(c, 1.0 / 2.4) - 0.055 }
        };
        let table = (0..=TABLE_COUNT).map(|i| code(i as f32 / TABLE_COUNT as f32)).collect();
        let mut tone = Self { exposure: 1.0, table };
        let (mut low, mut high) = (1e-3, 1e3);
        for _ in 0..20 {
            tone.exposure = f32::sqrt(low * high);
            let sum: f32 = radiances.iter().map(|&c| tone.coded(c).element_sum() / 3.0).sum();
            if sum < brightness * radiances.len() as f32 {
                low = tone.exposure;
            } else {
                high = tone.exposure;
            }
        }
        tone
    }

    /// Encodes a radiance as sRGB codes, 0..1.
    pub(super) fn coded(&self, radiance: Vec3) -> Vec3 {
        // Desaturates a little, because the film curve adds saturation.
        let grey = radiance.dot(Vec3::new(0.2126, 0.7152, 0.0722));
        let x = radiance.lerp(Vec3::splat(grey), 0.14) * self.exposure;
        // Narkowicz's fit of the ACES film curve: soft shoulder, deep shadows.
        let film = x * (x * 2.51 + 0.03) / (x * (x * 2.43 + 0.59) + 0.14);
        let look = |c: f32| {
            let at = (c.clamp(0.0, 1.0) * TABLE_COUNT as f32).min(TABLE_COUNT as f32 - 0.001);
            let i = at as usize;
            let t = at - i as f32;
            self.table[i] * (1.0 - t) + self.table[i + 1] * t
        };
        Vec3::new(look(film.x), look(film.y), look(film.z))
    }
}
