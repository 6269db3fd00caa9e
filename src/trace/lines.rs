//! From camera rays to lines in a view's projective space, order by order.

use super::camera::{CameraBlock, Pixel};
use super::footprint::{Axis, ClosedForm, FromRays, span};
use super::lanes::{LANES, max, min};
use super::scene::{Pose, Scene, View};
use super::walk::{Lines, Span};

/// How a camera ray becomes a line.
#[derive(Clone, Copy)]
pub(super) enum Path {
    /// Through the lens, then shifted along the pane's normal by kappa = `constant + slope * gamma`, metres.
    Lens { constant: f64, slope: f64 },
    /// Through the pinhole, without glass.
    Pinhole,
}

/// Farthest base from the grid's corner, px: indices stay exact in f32 wherever a bundle looks.
const FARTHEST_BASE_PX: f64 = 1.0e6;
/// Smallest change of depth along a direction.
const TINY_DEPTH: f32 = 1.0e-6;

/// A view's constants for one pixel and path.
pub(super) struct LineMaker<'a> {
    view: &'a View,
    path: Path,
    /// Grid point of relative (0, 0).
    pub(super) base: [i32; 2],
    /// Relative grid coordinates of the pixel's centre direction.
    origin: [f32; 2],
    /// The pixel's centre direction.
    center: [f32; 2],
    normal: [f32; 3],
}

impl<'a> LineMaker<'a> {
    #[inline(always)]
    pub(super) fn new(scene: &Scene, view: &'a View, pixel: &Pixel, path: Path) -> Self {
        let direction = match &view.pose {
            Pose::Aligned { .. } => pixel.center,
            Pose::General { rotation, .. } => {
                let d = *rotation * glam::DVec3::new(pixel.center[0], pixel.center[1], 1.0);
                [d.x / d.z, d.y / d.z]
            }
        };
        let grid = [0, 1].map(|k| view.focal_px[k] * direction[k] + view.principal[k]);
        let base = grid.map(|v| v.floor().clamp(-FARTHEST_BASE_PX, FARTHEST_BASE_PX));
        Self {
            view,
            path,
            base: base.map(|v| v as i32),
            origin: [(grid[0] - base[0]) as f32, (grid[1] - base[1]) as f32],
            center: pixel.center.map(|v| v as f32),
            normal: scene.slab.normal.as_vec3().to_array(),
        }
    }

    /// The lines' hits do not depend on w: nothing needs to be walked.
    pub(super) fn is_fixed(&self) -> bool {
        matches!(self.path, Path::Pinhole)
            && matches!(self.view.pose, Pose::Aligned { extra_m: 0.0 })
    }

    /// Lines of group `g` of the camera block.
    #[inline(always)]
    pub(super) fn lines(&self, camera: &CameraBlock, g: usize) -> Lines {
        let mut lines = Lines::ZERO;
        let focal = self.view.focal_px.map(|v| v as f32);
        let (direction, lens) = match self.path {
            Path::Lens { .. } => (&camera.direction, Some(&camera.lens)),
            Path::Pinhole => (&camera.film, None),
        };
        // The line's point in the plane z = 0: lens point + kappa (n - n_z d).
        let [nx, ny, nz] = self.normal;
        let mut point = [[0f32; LANES]; 2];
        if let (Path::Lens { constant, slope }, Some(lens)) = (self.path, lens) {
            let (constant, slope) = (constant as f32, slope as f32);
            for l in 0..LANES {
                let kappa = constant + slope * camera.gamma[g][l];
                let dx = self.center[0] + direction[0][g][l];
                let dy = self.center[1] + direction[1][g][l];
                point[0][l] = lens[0][g][l] + kappa * (nx - nz * dx);
                point[1][l] = lens[1][g][l] + kappa * (ny - nz * dy);
            }
        }
        match &self.view.pose {
            Pose::Aligned { extra_m } => {
                let extra = *extra_m as f32;
                for l in 0..LANES {
                    let (rx, ry) = (direction[0][g][l], direction[1][g][l]);
                    lines.x[l] = self.origin[0] + focal[0] * rx;
                    lines.y[l] = self.origin[1] + focal[1] * ry;
                    lines.sx[l] = focal[0] * (point[0][l] + extra * (self.center[0] + rx));
                    lines.sy[l] = focal[1] * (point[1][l] + extra * (self.center[1] + ry));
                }
            }
            Pose::General {
                rotation,
                translation_m,
            } => {
                let m = rotation.as_mat3();
                let t = translation_m.as_vec3();
                let shift =
                    [0, 1].map(|k| (self.view.principal[k] - f64::from(self.base[k])) as f32);
                for l in 0..LANES {
                    let dx = self.center[0] + direction[0][g][l];
                    let dy = self.center[1] + direction[1][g][l];
                    let (px, py) = (point[0][l], point[1][l]);
                    let row = |k: usize| m.x_axis[k] * dx + m.y_axis[k] * dy + m.z_axis[k];
                    let start = |k: usize| m.x_axis[k] * px + m.y_axis[k] * py + t[k];
                    // A line along the capture camera's own plane projects to infinity: kept finite.
                    let depth = row(2);
                    let inverse = 1.0 / max(depth.abs(), TINY_DEPTH).copysign(depth);
                    let (qx, qy) = (row(0) * inverse, row(1) * inverse);
                    lines.x[l] = focal[0] * qx + shift[0];
                    lines.y[l] = focal[1] * qy + shift[1];
                    lines.sx[l] = focal[0] * (start(0) - start(2) * qx);
                    lines.sy[l] = focal[1] * (start(1) - start(2) * qy);
                }
            }
        }
        lines
    }

    /// The part of the bundle's lines worth walking.
    #[inline(always)]
    pub(super) fn span(
        &self,
        scene: &Scene,
        pixel: &Pixel,
        camera: &CameraBlock,
        groups: usize,
    ) -> Span {
        match &self.view.pose {
            Pose::Aligned { extra_m } => {
                let footprint = self.closed_form(scene, pixel, *extra_m);
                span(&self.view.grid, self.base, &footprint)
            }
            Pose::General { .. } => {
                let footprint = self.footprint_of_rays(camera, groups);
                span(&self.view.grid, self.base, &footprint)
            }
        }
    }

    #[inline(always)]
    pub(super) fn closed_form(&self, scene: &Scene, pixel: &Pixel, extra_m: f64) -> ClosedForm {
        let n = scene.slab.normal;
        let (kappa, aperture, inverse_focus) = match self.path {
            Path::Lens { constant, slope } => (
                pixel.gamma.map(|gamma| constant + slope * gamma),
                scene.lens.aperture_radius_m,
                scene.lens.inverse_focus_per_m,
            ),
            Path::Pinhole => ([0.0; 2], 0.0, 0.0),
        };
        let axis = |k: usize, normal: f64| Axis {
            focal_px: self.view.focal_px[k] as f32,
            center: self.center[k],
            half_width: pixel.half_width[k] as f32,
            origin: self.origin[k],
            ends: kappa.map(|kappa| [(extra_m - kappa * n.z) as f32, (kappa * normal) as f32]),
        };
        ClosedForm {
            axes: [axis(0, n.x), axis(1, n.y)],
            aperture_m: aperture as f32,
            inverse_focus_per_m: inverse_focus as f32,
        }
    }

    #[inline(always)]
    pub(super) fn footprint_of_rays(&self, camera: &CameraBlock, groups: usize) -> FromRays {
        let low = [f32::INFINITY; 2];
        let high = [f32::NEG_INFINITY; 2];
        let mut bounds = [[low, high], [low, high]];
        for g in 0..groups {
            let lines = self.lines(camera, g);
            for (what, [x, y]) in [[&lines.x, &lines.y], [&lines.sx, &lines.sy]]
                .iter()
                .enumerate()
            {
                for l in 0..LANES {
                    let [lo, hi] = &mut bounds[what];
                    *lo = [min(x[l], lo[0]), min(y[l], lo[1])];
                    *hi = [max(x[l], hi[0]), max(y[l], hi[1])];
                }
            }
        }
        let flat = |[lo, hi]: [[f32; 2]; 2]| [lo[0], lo[1], hi[0], hi[1]];
        FromRays {
            origin: flat(bounds[0]),
            slope: flat(bounds[1]),
        }
    }
}
