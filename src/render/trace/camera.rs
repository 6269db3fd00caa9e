//! Camera samples of one pixel, in lanes: film point, lens point, direction, and optics of the glass in this direction.

use super::lanes::{LANES, Lane, sin_cos_octant};
use super::sampler::{BLOCK, PixelSeed, points};
use super::scene::Scene;

/// Number of groups of sixteen samples in a block.
pub(super) const GROUPS: usize = BLOCK / LANES;

pub(super) struct Pixel {
    seed: PixelSeed,
    /// Direction of the pixel's centre, tangents.
    pub(super) center: [f64; 2],
    /// Half the width and half the height of the area that the pixel's film points cover, tangents.
    pub(super) half_width: [f64; 2],
    /// Interval that contains gamma (see [`super::slab`]) of all samples of the pixel.
    pub(super) gamma: [f64; 2],
}

impl Pixel {
    #[inline(always)]
    pub(super) fn new(scene: &Scene, x: u32, y: u32) -> Self {
        let center = scene.film.tangent(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let radius_px = scene.film.filter_radius_px();
        let half_width = scene.film.pixel_tangent().map(|size| size * radius_px);
        // The angle between two directions is at most their distance in the tangent plane. With cosine c and sine s at
        // the centre, the cosines within `reach` lie in [c cos(reach) - s sin(reach), c + s sin(reach)].
        let spread = scene.lens.aperture_radius_m * scene.lens.inverse_focus_per_m;
        let [rx, ry] = half_width.map(|h| h + spread);
        let reach = (rx * rx + ry * ry).sqrt();
        let n = scene.slab.normal;
        let length = (1.0 + center[0] * center[0] + center[1] * center[1]).sqrt();
        let cos = ((center[0] * n.x + center[1] * n.y + n.z) / length).clamp(-1.0, 1.0);
        let sin = (1.0 - cos * cos).sqrt();
        let lo = (cos * (1.0 - 0.5 * reach * reach) - sin * reach).clamp(1.0e-4, 1.0);
        let hi = (cos + sin * reach).clamp(lo, 1.0);
        let gamma = [scene.slab.gamma(lo), scene.slab.gamma(hi)];
        Self { seed: PixelSeed::new(scene.seed, x, y), center, half_width, gamma }
    }
}

/// Camera samples of one block; film points and directions are relative to the pixel's centre direction.
pub(super) struct CameraBlock {
    pub(super) film: [[Lane; GROUPS]; 2],
    /// Directions of the rays through the lens points (x, y at z = 1).
    pub(super) direction: [[Lane; GROUPS]; 2],
    pub(super) lens: [[Lane; GROUPS]; 2],
    /// Ratio tan_t / tan_i (see [`super::slab`]).
    pub(super) gamma: [Lane; GROUPS],
    /// Reflectance of a face for s and p polarised light.
    pub(super) reflectance: [[Lane; GROUPS]; 2],
    /// Transmittance of a face, 1 - reflectance, for s and p polarised light.
    pub(super) transmittance: [[Lane; GROUPS]; 2],
    /// Values of 1 / cos_t; filled only if the glass absorbs light.
    pub(super) inverse_cos_t: [Lane; GROUPS],
}

impl CameraBlock {
    pub(super) fn new() -> Box<Self> {
        let lanes = [[0.0; LANES]; GROUPS];
        let pair = [lanes; 2];
        Box::new(Self {
            film: pair,
            direction: pair,
            lens: pair,
            gamma: lanes,
            reflectance: pair,
            transmittance: pair,
            inverse_cos_t: lanes,
        })
    }

    /// Fills the block with the pixel's samples `first .. first + count`.
    #[inline(always)]
    pub(super) fn fill(&mut self, scene: &Scene, pixel: &Pixel, first: u32, count: u32) {
        let groups = (count as usize).div_ceil(LANES);
        let [size_x, size_y] = scene.film.pixel_tangent().map(|v| v as f32);
        let [film_x, film_y] = &mut self.film;
        points(scene.sampling, &pixel.seed, 0, first, &mut film_x[..groups], &mut film_y[..groups]);
        for g in 0..groups {
            if let Some(table) = &scene.film.filter {
                film_x[g] = film_x[g].map(|u| table.offset_px(u) * size_x);
                film_y[g] = film_y[g].map(|u| table.offset_px(u) * size_y);
            } else {
                for l in 0..LANES {
                    film_x[g][l] = (film_x[g][l] - 0.5) * size_x;
                    film_y[g][l] = (film_y[g][l] - 0.5) * size_y;
                }
            }
        }
        let aperture = scene.lens.aperture_radius_m as f32;
        if aperture > 0.0 {
            let [lens_x, lens_y] = &mut self.lens;
            points(
                scene.sampling,
                &pixel.seed,
                1,
                first,
                &mut lens_x[..groups],
                &mut lens_y[..groups],
            );
            for g in 0..groups {
                for l in 0..LANES {
                    let (x, y) = concentric_disc(lens_x[g][l], lens_y[g][l]);
                    lens_x[g][l] = x * aperture;
                    lens_y[g][l] = y * aperture;
                }
            }
        }
        // Rays through film point p meet on the plane of focus: direction = p - a / zf, with a the lens point.
        let inverse_focus = scene.lens.inverse_focus_per_m as f32;
        for axis in 0..2 {
            for g in 0..groups {
                for l in 0..LANES {
                    self.direction[axis][g][l] =
                        self.film[axis][g][l] - self.lens[axis][g][l] * inverse_focus;
                }
            }
        }
        self.fill_glass(scene, pixel, groups);
    }

    #[inline(always)]
    fn fill_glass(&mut self, scene: &Scene, pixel: &Pixel, groups: usize) {
        let ior = scene.slab.ior as f32;
        let excess = (scene.slab.ior * scene.slab.ior - 1.0) as f32;
        let normal = scene.slab.normal.as_vec3();
        let center = pixel.center.map(|v| v as f32);
        let tilted = scene.slab.is_tilted();
        let absorbs = scene.slab.absorbs();
        for g in 0..groups {
            for l in 0..LANES {
                let dx = center[0] + self.direction[0][g][l];
                let dy = center[1] + self.direction[1][g][l];
                let square = 1.0 + (dx * dx + dy * dy);
                // Without tilt, the dot product of (dx, dy, 1) and the normal is 1.
                let along = if tilted { dx * normal.x + dy * normal.y + normal.z } else { 1.0 };
                let root = (excess * square + along * along).sqrt();
                let gamma = along / root;
                self.gamma[g][l] = gamma;
                for (q, factor) in [1.0, ior * ior].into_iter().enumerate() {
                    let slope = factor * gamma;
                    let inverse = 1.0 / (1.0 + slope);
                    let amplitude = (1.0 - slope) * inverse;
                    self.reflectance[q][g][l] = amplitude * amplitude;
                    // 1 - R = 4 g / (1 + g)^2 with g = `slope` avoids cancellation at grazing incidence.
                    self.transmittance[q][g][l] = 4.0 * slope * inverse * inverse;
                }
                if absorbs {
                    self.inverse_cos_t[g][l] = ior * square.sqrt() / root;
                }
            }
        }
    }
}

/// Applies Shirley and Chiu's concentric map from the unit square to the unit disc.
#[inline(always)]
fn concentric_disc(u: f32, v: f32) -> (f32, f32) {
    let (a, b) = (2.0 * u - 1.0, 2.0 * v - 1.0);
    let wide = a.abs() > b.abs();
    let (radius, other) = if wide { (a, b) } else { (b, a) };
    let radius = if radius == 0.0 { 1.0e-30 } else { radius };
    let (sin, cos) = sin_cos_octant(other / radius * std::f32::consts::FRAC_PI_4);
    if wide { (radius * cos, radius * sin) } else { (radius * sin, radius * cos) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn disc_points_are_uniform() {
        let seed = PixelSeed::new(1, 2, 3);
        let n = 1 << 16;
        let (mut x2, mut r2, mut inner) = (0.0, 0.0, 0);
        for i in 0..n {
            let s = super::super::sampler::sample(&seed, i);
            let (x, y) = concentric_disc(s[2], s[3]);
            let square = f64::from(x * x + y * y);
            assert!(square <= 1.000_001);
            x2 += f64::from(x * x);
            r2 += square;
            inner += u32::from(square < 0.25);
        }
        assert!((x2 / f64::from(n) - 0.25).abs() < 1e-4);
        assert!((r2 / f64::from(n) - 0.5).abs() < 1e-4);
        assert!((f64::from(inner) / f64::from(n) - 0.25).abs() < 1e-3);
        assert_eq!(concentric_disc(1.0, 0.5).0, 1.0);
        assert_eq!(concentric_disc(0.5, 1.0).1, 1.0);
        assert!(concentric_disc(0.5, 0.5).0.abs() < 1e-20);
    }
}
