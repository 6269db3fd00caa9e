//! The rectangle of the glass and its frame, and the places at which rays meet them.

use super::super::lanes::{CHUNK, LANES, Lane};
use super::super::scene::Lens;
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
    /// Returns true if all rays through `lens` whose film points lie between these tangents (across, down) meet glass, and false if none
    /// does; `None` if the bounds do not tell.
    ///
    /// A projection maps the rectangle of film points to a convex quadrangle of the pane's plane, for each point of the lens; and the square
    /// around the lens, for each film point. So all entries lie within the hull of those of the corners.
    pub(in super::super) fn fills(
        &self,
        slab: &Slab,
        lens: &Lens,
        film: [[f64; 2]; 2],
    ) -> Option<bool> {
        let corners = [(0, 0), (0, 1), (1, 0), (1, 1)];
        let entry = |(i, j): (usize, usize), (k, m): (usize, usize)| {
            let of_lens = |k: usize| [-1.0, 1.0][k] * lens.aperture_radius_m;
            let from = DVec3::new(of_lens(k), of_lens(m), 0.0);
            let d = DVec3::new(film[0][i], film[1][j], 1.0) - from * lens.inverse_focus_per_m;
            let way = (slab.plane_distance_m - from.dot(slab.normal)) / d.dot(slab.normal);
            let from_pivot = from + way * d - DVec3::Z * self.distance_m;
            [0, 1].map(|k| from_pivot.dot(self.axes[k]))
        };
        let mut bounds = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        for film in corners {
            for of_lens in corners {
                for (bounds, at) in bounds.iter_mut().zip(entry(film, of_lens)) {
                    *bounds = [bounds[0].min(at), bounds[1].max(at)];
                }
            }
        }
        // The tracer rounds entries to f32.
        let slack_m = 1.0e-6;
        let glass = self.glass_m;
        let is_inside = |k: usize| {
            glass[k][0] + slack_m <= bounds[k][0] && bounds[k][1] <= glass[k][1] - slack_m
        };
        let is_beside =
            |k: usize| bounds[k][1] < glass[k][0] - slack_m || bounds[k][0] > glass[k][1] + slack_m;
        match () {
            () if (0..2).all(is_inside) => Some(true),
            () if (0..2).any(is_beside) => Some(false),
            () => None,
        }
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
