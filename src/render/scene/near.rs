//! How much of a side stands between the lens and the pane.

use super::error::{AssembleError, MAX_TOO_NEAR_SHARE};
use super::photograph::Sheet;
use super::place::Placed;
use crate::trace::{NEAR_M, Slab};
use glam::DVec3;

/// The pane and the view that surfaces are measured against.
pub(super) struct Near<'a> {
    pub(super) slab: &'a Slab,
    /// `glass.distance_m`, for errors.
    pub(super) distance_m: f64,
    /// Tangents of half the field of view.
    pub(super) reach: [f64; 2],
}

struct Counts {
    all: u64,
    near: u64,
    nearest_m: f64,
}

impl Near<'_> {
    /// Share that is nearer than the pane; an error above [`MAX_TOO_NEAR_SHARE`]. `height` is that of a point in
    /// capture coordinates over the lens, along the pane's normal; meshes are already in the lens's coordinates.
    pub(super) fn share(
        &self,
        side: &'static str,
        placed: &Placed,
        height: impl Fn(DVec3) -> f64,
    ) -> Result<f64, AssembleError> {
        let counts = match placed {
            Placed::Sheet(sheet) => self.of_sheet(sheet, height),
            Placed::Mesh(mesh) => self.of_vertices(&mesh.vertices_m),
        };
        let Counts { all, near, nearest_m } = counts;
        let share = near as f64 / all.max(1) as f64;
        if share <= MAX_TOO_NEAR_SHARE {
            return Ok(share);
        }
        let distance_m = self.distance_m;
        Err(match placed {
            Placed::Sheet(_) => AssembleError::TooNear { side, share, distance_m, nearest_m },
            Placed::Mesh(_) => AssembleError::MeshTooNear { side, share, distance_m, nearest_m },
        })
    }

    fn of_sheet(&self, sheet: &Sheet, height: impl Fn(DVec3) -> f64) -> Counts {
        let k = &sheet.intrinsics;
        let (mut all, mut near, mut nearest_m) = (0u64, 0u64, f64::INFINITY);
        let pixels = sheet.inverse_depth_per_m.iter().zip(&sheet.valid).enumerate();
        for (q, (&w, _)) in pixels.filter(|(_, (_, valid))| **valid) {
            let (i, j) = (q % sheet.width, q / sheet.width);
            let z = 1.0 / f64::from(w);
            let x = (i as f64 + 0.5 - k.cx) / k.fx * z;
            let y = (j as f64 + 0.5 - k.cy) / k.fy * z;
            all += 1;
            near += u64::from(height(DVec3::new(x, y, z)) < self.slab.plane_distance_m);
            nearest_m = nearest_m.min(z);
        }
        Counts { all, near, nearest_m }
    }

    /// A mesh may surround the lens: only what is in the field of view can stand in the way.
    fn of_vertices(&self, vertices_m: &[DVec3]) -> Counts {
        let (mut all, mut near, mut nearest_m) = (0u64, 0u64, f64::INFINITY);
        for v in vertices_m {
            let is_in_view = v.z >= NEAR_M
                && v.x.abs() <= self.reach[0] * v.z
                && v.y.abs() <= self.reach[1] * v.z;
            if is_in_view {
                all += 1;
                near += u64::from(v.dot(self.slab.normal) < self.slab.plane_distance_m);
                nearest_m = nearest_m.min(v.z);
            }
        }
        Counts { all, near, nearest_m }
    }
}
