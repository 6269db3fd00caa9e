//! The rectangle of the glass and its frame, and the places at which rays meet them.

use super::super::lanes::{CHUNK, LANES, Lane};
use super::super::slab::Slab;
use glam::DVec3;

/// The edges of a pane in the plane of its front face, and an opaque frame around the glass.
#[derive(Clone, Debug, PartialEq)]
pub struct Outline {
    /// Unit vectors of the pane's axes, right and down.
    pub axes: [DVec3; 2],
    /// Distance of the axes' origin from the lens along the optical axis.
    pub distance_m: f64,
    /// Intervals of the glass along the axes.
    pub glass_m: [[f64; 2]; 2],
    /// Width of the frame, outside of the glass.
    pub frame_m: f64,
    /// Linear radiance of the frame.
    pub frame_radiance: [f32; 3],
}

impl Outline {
    /// True if all pinhole rays between these tangents (across, down) meet glass. A projection maps the rectangle to a convex
    /// quadrangle of the pane's plane.
    pub(in super::super) fn is_filled_by_glass(&self, slab: &Slab, film: [[f64; 2]; 2]) -> bool {
        let corners = [(0, 0), (0, 1), (1, 0), (1, 1)];
        corners.into_iter().all(|(i, j)| {
            let d = DVec3::new(film[0][i], film[1][j], 1.0);
            let from_pivot =
                slab.plane_distance_m / d.dot(slab.normal) * d - DVec3::Z * self.distance_m;
            (0..2).all(|k| {
                let (at, [lo, hi]) = (from_pivot.dot(self.axes[k]), self.glass_m[k]);
                // The tracer rounds entries to f32.
                lo + 1.0e-6 <= at && at <= hi - 1.0e-6
            })
        })
    }
}

/// Places at which the rays of a chunk meet the plane of the front face. Without an outline, all meet glass.
pub(in super::super) struct Entries {
    /// 1 where a ray meets glass, else 0.
    pub(in super::super) glass: [Lane; CHUNK],
    /// 1 where a ray meets the frame, else 0.
    pub(in super::super) frame: [Lane; CHUNK],
    /// True if all rays meet glass.
    pub(in super::super) all_glass: bool,
    /// True if any ray meets glass.
    pub(in super::super) any_glass: bool,
}

impl Entries {
    pub(in super::super) fn new() -> Self {
        Self {
            glass: [[1.0; LANES]; CHUNK],
            frame: [[0.0; LANES]; CHUNK],
            all_glass: true,
            any_glass: true,
        }
    }

    /// Finds the entries of `count` samples, from the directions of the pixels' centres, the directions of the rays relative to
    /// them, and the rays' points in the plane of the lens.
    #[inline(always)]
    pub(in super::super) fn find(
        &mut self,
        outline: &Outline,
        slab: &Slab,
        center: &[Lane; 2],
        relative: &[[Lane; CHUNK]; 2],
        lens: Option<&[[Lane; CHUNK]; 2]>,
        count: usize,
    ) {
        let normal = slab.normal.as_vec3();
        let (plane_m, distance_m) = (slab.plane_distance_m as f32, outline.distance_m as f32);
        let axes = outline.axes.map(DVec3::as_vec3);
        let of_glass = outline.glass_m;
        let of_frame = of_glass.map(|[lo, hi]| [lo - outline.frame_m, hi + outline.frame_m]);
        let [of_glass, of_frame] = [of_glass, of_frame].map(|of| of.map(|of| of.map(|v| v as f32)));
        let mut met = 0.0;
        for s in 0..count {
            for l in 0..LANES {
                let [ax, ay] = lens.map_or([0.0; 2], |lens| [lens[0][s][l], lens[1][s][l]]);
                let (dx, dy) = (center[0][l] + relative[0][s][l], center[1][l] + relative[1][s][l]);
                let along = dx * normal.x + dy * normal.y + normal.z;
                let z = (plane_m - (ax * normal.x + ay * normal.y)) / along;
                let from = [ax + z * dx, ay + z * dy, z - distance_m];
                let at = axes.map(|axis| from[0] * axis.x + from[1] * axis.y + from[2] * axis.z);
                let within = |of: [[f32; 2]; 2]| {
                    (at[0] >= of[0][0])
                        & (at[0] <= of[0][1])
                        & (at[1] >= of[1][0])
                        & (at[1] <= of[1][1])
                };
                let is_glass = within(of_glass);
                self.glass[s][l] = f32::from(u8::from(is_glass));
                self.frame[s][l] = f32::from(u8::from(within(of_frame) & !is_glass));
            }
            met += self.glass[s].iter().sum::<f32>();
        }
        self.all_glass = met == (count * LANES) as f32;
        self.any_glass = met > 0.0;
    }
}
