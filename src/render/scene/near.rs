//! Measures the share of a side between the lens and the pane.

use super::error::{AssembleError, MAX_TOO_NEAR_SHARE};
use super::photograph::Sheet;
use super::place::Placed;
use crate::trace::{NEAR_M, Slab};
use glam::DVec3;

/// The pane and the field of view of the measurement.
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

impl Counts {
    /// Counts points, given as (z, distance from the lens along the pane's normal).
    fn of(points: impl Iterator<Item = (f64, f64)>, plane_distance_m: f64) -> Self {
        let mut counts = Self { all: 0, near: 0, nearest_m: f64::INFINITY };
        for (z_m, height_m) in points {
            counts.all += 1;
            counts.near += u64::from(height_m < plane_distance_m);
            counts.nearest_m = counts.nearest_m.min(z_m);
        }
        counts
    }
}

impl Near<'_> {
    /// Returns the share of points nearer than the pane; an error above [`MAX_TOO_NEAR_SHARE`]. `height` maps capture
    /// coordinates to the distance from the lens along the pane's normal. Meshes are already in the lens's coordinates.
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
        let point = |i: usize, j: usize, w: f32| {
            let z = 1.0 / f64::from(w);
            let x = (i as f64 + 0.5 - k.cx) / k.fx * z;
            let y = (j as f64 + 0.5 - k.cy) / k.fy * z;
            (z, height(DVec3::new(x, y, z)))
        };
        // The height is linear in z and in the direction, so its minimum over the box that contains all vertices is at one of the
        // corners. The margin covers rounding.
        let (right, bottom) = (sheet.width - 1, sheet.height - 1);
        let corners = [(0, 0), (right, 0), (0, bottom), (right, bottom)];
        let ends = sheet.grid.extremes();
        let lowest_m = corners
            .into_iter()
            .flat_map(|(i, j)| ends.map(|w| point(i, j, w).1))
            .fold(f64::INFINITY, f64::min);
        if lowest_m > self.slab.plane_distance_m * 1.000_001 {
            return Counts { all: 1, near: 0, nearest_m: 1.0 / f64::from(ends[1]) };
        }
        let pixels = sheet.inverse_depths_per_m().zip(&*sheet.valid).enumerate();
        let points = pixels.filter(|(_, (_, valid))| **valid);
        let points = points.map(|(q, (w, _))| point(q % sheet.width, q / sheet.width, w));
        Counts::of(points, self.slab.plane_distance_m)
    }

    /// Counts only vertices in the field of view, because a mesh may surround the lens.
    fn of_vertices(&self, vertices_m: &[DVec3]) -> Counts {
        let is_in_view = |v: &&DVec3| {
            v.z >= NEAR_M && v.x.abs() <= self.reach[0] * v.z && v.y.abs() <= self.reach[1] * v.z
        };
        let points = vertices_m.iter().filter(is_in_view).map(|v| (v.z, v.dot(self.slab.normal)));
        Counts::of(points, self.slab.plane_distance_m)
    }
}
