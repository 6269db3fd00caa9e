//! What the tracer sees: two surfaces, a pane, a lens, a film. Nothing here knows files.

use super::grid::Grid;
use super::mesh::Mesh;
use super::orders::OrderPlan;
use super::slab::Slab;
use super::texture::Texture;
use glam::{DMat3, DVec3};

/// A scene ready to be traced. `scene::assemble` makes and checks it.
pub struct Scene {
    /// Seed of the sample points.
    pub seed: u64,
    /// Kind of the sample points.
    pub sampling: Sampling,
    /// Camera samples a pixel, a power of two; with a target, at most.
    pub spp: u32,
    /// RMS error (linear) at which a cell of [`super::CELL_PX`] pixels takes no more samples; `None` takes all.
    pub target_error: Option<f64>,
    /// Layers I, T, R~, R that are asked for; the others are not traced and stay 0.
    pub layers: [bool; 4],
    /// The film.
    pub film: FilmPlane,
    /// The lens.
    pub lens: Lens,
    /// The pane.
    pub slab: Slab,
    /// Orders of the pane that are followed.
    pub orders: OrderPlan,
    /// Seen through the pane.
    pub front: Surface,
    /// Seen reflected in it.
    pub back: Surface,
}

/// What one side of the pane shows.
pub enum Surface {
    /// A photograph.
    Sheet(View),
    /// A triangle mesh.
    Mesh(Mesh),
}

impl From<View> for Surface {
    fn from(view: View) -> Self {
        Self::Sheet(view)
    }
}

impl From<Mesh> for Surface {
    fn from(mesh: Mesh) -> Self {
        Self::Mesh(mesh)
    }
}

/// Kind of the sample points. No manifest line can set it: it is there to be measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Sampling {
    /// Owen-scrambled Sobol points.
    #[default]
    Sobol,
    /// Independent uniform points, what the Sobol points are compared with: the error falls with the square root
    /// of their number.
    Independent,
}

/// The film in tangent space: film point (u, v) px looks along `((2u/W - 1) tan_x, (2v/H - 1) tan_y, 1)`.
#[derive(Clone, Debug, PartialEq)]
pub struct FilmPlane {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Tangents of the half fields of view, across and down.
    pub tan_half_fov: [f64; 2],
    /// Filter importance sampling: `None` is the box of one pixel.
    pub filter: Option<FilterTable>,
}

/// A thin lens, focused on a plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// Radius of the opening; 0 is a pinhole.
    pub aperture_radius_m: f64,
    /// 1 / focus distance; 0 is infinity.
    pub inverse_focus_per_m: f64,
}

/// Inverse distribution function of a filter, tabulated: from a number in [0, 1) to an offset from the pixel's
/// centre in px.
#[derive(Clone, Debug, PartialEq)]
pub struct FilterTable {
    offsets_px: Vec<f32>,
    radius_px: f64,
}

impl FilterTable {
    /// A Gaussian of standard deviation 0.5 px, cut at 2 px.
    pub fn gaussian() -> Self {
        const SIGMA_PX: f64 = 0.5;
        const RADIUS_PX: f64 = 2.0;
        const CELLS: usize = 4096;
        let scale = 1.0 / (SIGMA_PX * std::f64::consts::SQRT_2);
        let edge = libm::erf(RADIUS_PX * scale);
        let distribution = |x: f64| 0.5 + 0.5 * libm::erf(x * scale) / edge;
        // Bisection: monotone, no derivative, the same everywhere.
        let invert = |target: f64| {
            let (mut lo, mut hi) = (-RADIUS_PX, RADIUS_PX);
            for _ in 0..60 {
                let middle = 0.5 * (lo + hi);
                if distribution(middle) < target {
                    lo = middle;
                } else {
                    hi = middle;
                }
            }
            (0.5 * (lo + hi)) as f32
        };
        let mut offsets_px: Vec<f32> = (0..=CELLS)
            .map(|i| invert(i as f64 / CELLS as f64))
            .collect();
        offsets_px[0] = -RADIUS_PX as f32;
        offsets_px[CELLS] = RADIUS_PX as f32;
        Self {
            offsets_px,
            radius_px: RADIUS_PX,
        }
    }

    /// Largest offset, px.
    pub fn radius_px(&self) -> f64 {
        self.radius_px
    }

    /// Offset at `u` in [0, 1), linear between the table's entries.
    #[inline]
    pub fn offset_px(&self, u: f32) -> f32 {
        let cells = self.offsets_px.len() - 1;
        let position = u * cells as f32;
        let cell = (position as usize).min(cells - 1);
        let (a, b) = (self.offsets_px[cell], self.offsets_px[cell + 1]);
        a + (b - a) * (position - cell as f32)
    }
}

impl FilmPlane {
    /// Half fields of view by the focal length relative to the 36 x 24 mm diagonal spread over the film's diagonal.
    pub fn tan_half_fov(width: u32, height: u32, focal_length_mm: f64) -> [f64; 2] {
        let (w, h) = (f64::from(width), f64::from(height));
        let half_diagonal = (36.0f64 * 36.0 + 24.0 * 24.0).sqrt() / (2.0 * focal_length_mm);
        let diagonal = (w * w + h * h).sqrt();
        [half_diagonal * w / diagonal, half_diagonal * h / diagonal]
    }

    /// Tangents of film point (`u`, `v`), px.
    pub fn tangent(&self, u_px: f64, v_px: f64) -> [f64; 2] {
        let [tx, ty] = self.tan_half_fov;
        [
            (2.0 * u_px / f64::from(self.width) - 1.0) * tx,
            (2.0 * v_px / f64::from(self.height) - 1.0) * ty,
        ]
    }

    /// Size of a pixel, tangents.
    pub fn pixel_tangent(&self) -> [f64; 2] {
        let [tx, ty] = self.tan_half_fov;
        [
            2.0 * tx / f64::from(self.width),
            2.0 * ty / f64::from(self.height),
        ]
    }

    /// How far a sample can be from its pixel's centre, px.
    pub fn filter_radius_px(&self) -> f64 {
        self.filter.as_ref().map_or(0.5, FilterTable::radius_px)
    }
}

/// One photograph as the tracer sees it.
pub struct View {
    /// Inverse depth.
    pub grid: Grid,
    /// Radiance.
    pub texture: Texture,
    /// Focal lengths of the capture camera in depth pixels; the first is negative in a mirrored view.
    pub focal_px: [f64; 2],
    /// Principal point in grid coordinates (pixel centres at integers: cx - 0.5).
    pub principal: [f64; 2],
    /// Where the capture camera stands.
    pub pose: Pose,
    /// Pixels of the depth image, across and down (a grid doubles a side of 1).
    pub photograph_size: (usize, usize),
}

impl View {
    /// Hits outside the outermost pixel centres, where the border's continuation was needed.
    #[inline(always)]
    pub(super) fn count_outside(&self, base: [i32; 2], u: &[f32], v: &[f32]) -> u64 {
        let bounds = |n: usize, base: i32| (-base as f32, (n as i32 - 1 - base) as f32);
        let (u_min, u_max) = bounds(self.photograph_size.0, base[0]);
        let (v_min, v_max) = bounds(self.photograph_size.1, base[1]);
        let mut outside = 0;
        for (&u, &v) in u.iter().zip(v) {
            outside += u64::from((u < u_min) | (u > u_max) | (v < v_min) | (v > v_max));
        }
        outside
    }
}

/// From camera coordinates (of the mirrored world, for the back scene) to capture coordinates. A mirrored x is
/// in the sign of the view's focal length.
#[derive(Clone, Debug, PartialEq)]
pub enum Pose {
    /// Same axes; the capture camera stands `extra_m` ahead along z (0, or the untilted apex `camera`: 2 D).
    Aligned {
        /// Subtracted from z.
        extra_m: f64,
    },
    /// `capture = rotation * x + translation`.
    General {
        /// A rotation or reflection.
        rotation: DMat3,
        /// Metres.
        translation_m: DVec3,
    },
}
