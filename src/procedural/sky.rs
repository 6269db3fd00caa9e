//! The sky with clouds and a hazy skyline.

use super::material::color;
use super::noise::{band, cloudy, noise2};
use glam::Vec3;

/// Colours and clouds of a sky.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sky {
    pub(super) zenith: Vec3,
    pub(super) horizon: Vec3,
    pub(super) cloud: Vec3,
    /// Cloud cover, 0..1.
    pub(super) cover: f32,
    pub(super) seed: i32,
}

impl Sky {
    /// Returns the radiance from `direction`, a unit vector.
    pub(super) fn radiance(&self, direction: Vec3) -> Vec3 {
        let y = direction.y;
        let up = y.max(0.0);
        let t = 1.0 - (1.0 - up) * (1.0 - up) * (1.0 - up);
        let mut sky = self.horizon.lerp(self.zenith, t);
        if y > 0.01 {
            let (x, z) = (direction.x / (y + 0.12), direction.z / (y + 0.12));
            let n = cloudy(x * 0.9, z * 0.9, 0.0, self.seed);
            let fine = cloudy(x * 5.0, z * 5.0, 0.0, self.seed + 9);
            let dense = ((0.75 * n + 0.25 * fine - 0.72 + 0.45 * self.cover) * 5.0).clamp(0.0, 1.0);
            let shade = 0.75 + 0.25 * (fine * 1.4).min(1.0);
            sky = sky.lerp(self.cloud * shade, dense * (y * 9.0).min(1.0));
        }
        let azimuth = libm::atan2f(direction.x, direction.z);
        let hills = 0.02 + 0.05 * noise2(azimuth * 5.0, 0.0, self.seed);
        let trees = 0.012 + 0.03 * cloudy(azimuth * 24.0, 4.0, 0.0, self.seed);
        let far = self.horizon * color(0x9fb0b8);
        let near = self.horizon * color(0x66785f);
        sky.lerp(far, band(y, -2.0, hills, 0.004)).lerp(near, band(y, -2.0, trees, 0.004))
    }

    /// Returns the radiance without clouds and skyline, for reflections.
    pub(super) fn smooth_radiance(&self, up: f32) -> Vec3 {
        if up > 0.0 { self.horizon.lerp(self.zenith, up) } else { self.horizon * 0.3 }
    }
}
