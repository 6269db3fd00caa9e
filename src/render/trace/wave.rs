//! Waves in the faces of a pane, such as the roller waves of tempered glass.
//!
//! All faces have the same height over the flat pane,
//!
//! ```text
//! z = A sin(2 pi s / L)        s = (x - P) . w
//! ```
//!
//! along the pane's normal n, with the pivot P and a unit vector w in the pane's plane. Every face is met at its height, with the normal
//! n - z' w there, and light is followed from face to face by Snell's and Fresnel's laws ([`super::rough`]).

use super::bent::{RayLanes, dot};
use super::lanes::{CHUNK, LANES, Lane, floor, max, min, sin_cos_octant};
use super::slab::Slab;
use glam::{DVec3, Vec3};

/// Waves of a pane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wave {
    /// Height of the crests, m.
    pub amplitude_m: f64,
    /// Distance from crest to crest, m.
    pub length_m: f64,
    /// Unit vector in the pane's plane across the crests, in the lens's coordinates.
    pub across_crests: DVec3,
    /// Distance of the pivot from the lens along the optical axis.
    pub distance_m: f64,
}

impl Wave {
    /// Returns the largest slope of the faces.
    pub fn largest_slope(&self) -> f64 {
        std::f64::consts::TAU * self.amplitude_m / self.length_m
    }

    /// Returns height and slope at a point relative to the pivot.
    pub fn at(&self, point: DVec3) -> (f64, f64) {
        let (sin, cos) =
            libm::sincos(std::f64::consts::TAU * point.dot(self.across_crests) / self.length_m);
        (self.amplitude_m * sin, self.largest_slope() * cos)
    }

    /// Returns the waves in coordinates with these axes. The last axis is the pane's normal.
    pub(super) fn lanes(&self, axes: [DVec3; 3]) -> WaveLanes {
        WaveLanes {
            amplitude_m: self.amplitude_m as f32,
            slope: self.largest_slope() as f32,
            wavenumber_per_m: (std::f64::consts::TAU / self.length_m) as f32,
            waves_per_m: axes.map(|axis| (axis.dot(self.across_crests) / self.length_m) as f32),
            across_crests: axes.map(|axis| axis.dot(self.across_crests) as f32),
        }
    }
}

/// Waves in f32.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct WaveLanes {
    amplitude_m: f32,
    /// Largest slope.
    slope: f32,
    wavenumber_per_m: f32,
    waves_per_m: [f32; 3],
    across_crests: [f32; 3],
}

impl WaveLanes {
    /// Returns the wave's phase at a point relative to the pivot, full turns.
    #[inline(always)]
    pub(super) fn turns(&self, point: Vec3) -> f32 {
        let [x, y, z] = self.waves_per_m;
        point.x * x + point.y * y + point.z * z
    }

    /// Returns sine and cosine of the phase.
    #[inline(always)]
    fn phase(&self, point: Vec3) -> (f32, f32) {
        sin_cos_turns(self.turns(point))
    }

    /// Returns height (m) and slope at a point relative to the pivot.
    #[inline(always)]
    fn at(&self, point: Vec3) -> (f32, f32) {
        let (sin, cos) = self.phase(point);
        (self.amplitude_m * sin, self.slope * cos)
    }

    /// Returns the unit vector across the crests.
    #[inline(always)]
    fn across_crests(&self) -> Vec3 {
        let [x, y, z] = self.across_crests;
        Vec3::new(x, y, z)
    }

    /// Returns the way of a ray to the face over the plane z = 0, m, and the slope there. The `FIRST` face is met where the ray is.
    ///
    /// Newton's step from the plane is exact to half the curvature times the square of the way to the crest, less than 1e-6 m, and
    /// the slope to a third of the cube of the step's phase.
    #[inline(always)]
    pub(super) fn meet<const FIRST: bool>(&self, point: Vec3, d: Vec3) -> (f32, f32) {
        let flat_m = if FIRST { 0.0 } else { -point.z / d.z };
        let (sin, cos) = self.phase(point + d * flat_m);
        if FIRST {
            return (0.0, self.slope * cos);
        }
        let along = dot(d, self.across_crests());
        let step_m = self.amplitude_m * sin / (d.z - self.slope * cos * along);
        let phase = self.wavenumber_per_m * along * step_m;
        (flat_m + step_m, self.slope * (cos * (1.0 - 0.5 * phase * phase) - sin * phase))
    }

    /// Returns two tangents and the normal of a face with this slope, in coordinates with the plane's normal as z.
    #[inline(always)]
    pub(super) fn frame(&self, slope: f32) -> [Vec3; 3] {
        let n = Vec3::Z - self.across_crests() * slope;
        let n = n * (1.0 / dot(n, n).sqrt());
        // The first tangent is X without its part along n, and the second n x the first.
        let length = (1.0 - n.x * n.x).sqrt();
        let inverse = 1.0 / length;
        [
            Vec3::new(length, -n.x * n.y * inverse, -n.x * n.z * inverse),
            Vec3::new(0.0, n.z * inverse, -n.y * inverse),
            n,
        ]
    }
}

/// Computes sin and cos of `turns` full turns. Of millions of turns, which lanes do not resolve, it returns numbers of at most about 1.
#[inline(always)]
pub(super) fn sin_cos_turns(turns: f32) -> (f32, f32) {
    let (quarters, _) = floor(4.0 * turns + 0.5);
    // Rounding exceeds an eighth of a turn only beyond a million turns.
    let rest = min(max(turns - 0.25 * quarters, -0.25), 0.25);
    let (sin, cos) = sin_cos_octant(rest * std::f32::consts::TAU);
    let quarter = quarters - 4.0 * floor(0.25 * quarters).0;
    let is_odd = quarter == 1.0 || quarter == 3.0;
    // Numbers are selected one by one: the compiler turns choices between pairs into branches.
    let (first, second) = (if is_odd { cos } else { sin }, if is_odd { -sin } else { cos });
    let sign = if quarter >= 2.0 { -1.0 } else { 1.0 };
    (first * sign, second * sign)
}

impl RayLanes {
    /// Returns the rays of sample `s` of the pinhole that are mirrored in the waves of the front face.
    #[inline(always)]
    pub(super) fn waved_pinhole(
        wave: &Wave,
        slab: &Slab,
        center: &[Lane; 2],
        film: &[[Lane; CHUNK]; 2],
        s: usize,
    ) -> Self {
        let lanes = wave.lanes([DVec3::X, DVec3::Y, DVec3::Z]);
        let (n, across) = (slab.normal.as_vec3(), lanes.across_crests());
        let (plane_m, pivot) = (slab.plane_distance_m as f32, Vec3::Z * wave.distance_m as f32);
        let mut rays = Self { relative: [[0.0; LANES]; 2], point: [[0.0; LANES]; 2] };
        for l in 0..LANES {
            let d = Vec3::new(center[0][l] + film[0][s][l], center[1][l] + film[1][s][l], 1.0);
            let d = d * (1.0 / dot(d, d).sqrt());
            let along = dot(d, n);
            let flat = d * (plane_m / along);
            let (height_m, slope) = lanes.at(flat - pivot);
            let point = flat + d * (height_m / (along - slope * dot(d, across)));
            let (_, slope) = lanes.at(point - pivot);
            let normal = n - across * slope;
            let normal = normal * (1.0 / dot(normal, normal).sqrt());
            let mirrored = d - normal * (2.0 * dot(d, normal));
            rays.set(l, slab, false, point, mirrored, center);
        }
        rays
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sines_and_cosines_of_turns_are_exact() {
        for i in -400..400 {
            let turns = i as f32 * 0.0137;
            let (sin, cos) = sin_cos_turns(turns);
            let angle = f64::from(turns) * std::f64::consts::TAU;
            assert!((f64::from(sin) - angle.sin()).abs() < 2e-6, "{turns}");
            assert!((f64::from(cos) - angle.cos()).abs() < 2e-6, "{turns}");
        }
    }

    /// Waves that are too short for the precision of a point have finite heights.
    #[test]
    fn sines_and_cosines_of_many_turns_are_bounded() {
        for turns in [1e6f32, 3.3e7, 1e9, 7e12, 1e30, -4e9] {
            let (sin, cos) = sin_cos_turns(turns);
            assert!(sin.abs() <= 1.1 && cos.abs() <= 1.1, "{turns}: {sin} {cos}");
        }
    }

    /// A ray meets the face at its height, and the frame has the face's normal.
    #[test]
    fn rays_meet_the_waves() {
        let wave = Wave {
            amplitude_m: 2e-4,
            length_m: 0.2,
            across_crests: DVec3::new(0.6, 0.8, 0.0),
            distance_m: 0.3,
        };
        let lanes = wave.lanes([DVec3::X, DVec3::Y, DVec3::Z]);
        for i in 0..50 {
            let x = i as f32 * 0.013 - 0.3;
            let d = Vec3::new(0.3, -0.5, if i % 2 == 0 { 0.8 } else { -0.8 }).normalize();
            let depth_m = 0.01 * (i % 3) as f32;
            let start = Vec3::new(x, 0.1, 0.02 - depth_m);
            let (way_m, of_face) = lanes.meet::<false>(start, d);
            let met = (start + d * way_m).as_dvec3();
            let (height_m, slope) = wave.at(met);
            assert!((met.z - height_m).abs() < 1e-8);
            assert!((f64::from(of_face) - slope).abs() < 1e-7, "{of_face} {slope}");
            assert_eq!(lanes.meet::<true>(met.as_vec3(), d).0, 0.0);
            let n = (DVec3::Z - slope * wave.across_crests).normalize();
            let [across, down, normal] = lanes.frame(of_face).map(Vec3::as_dvec3);
            assert!((normal - n).length() < 1e-6 && across.dot(n).abs() < 1e-6);
            assert!((across.cross(down) - n).length() < 1e-6);
        }
    }
}
