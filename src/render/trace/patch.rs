//! Sixteen pixels of the film that are traced together, in lanes, and bounds of the camera samples of a square.

use super::lanes::{LANES, Lane};
use super::sampler::{PixelSeed, SeedLanes};
use super::scene::{FilmPlane, Scene};

/// Width and height of a patch, px. Patches begin at multiples of this length, wherever a tile begins.
pub(super) const PATCH_PX: u32 = 4;

/// Returns the corners of up to `count` x `count` patches that lie all over a film.
pub(super) fn all_over(film: &FilmPlane, count: u32) -> Vec<(u32, u32)> {
    let corners = |length_px: u32| {
        let last = length_px.saturating_sub(1) / PATCH_PX;
        let mut corners: Vec<u32> = (0..count).map(|i| last * i / (count - 1) * PATCH_PX).collect();
        corners.dedup();
        corners
    };
    let columns = corners(film.width);
    let rows = corners(film.height).into_iter();
    rows.flat_map(|y| columns.iter().map(move |x| (*x, y))).collect()
}

/// A patch of 4 x 4 px: lane l is pixel (l % 4, l / 4). Lanes beyond the film are traced, but count nowhere.
pub(super) struct Patch {
    /// Column and row of the upper left pixel.
    pub(super) corner: [u32; 2],
    pub(super) seeds: SeedLanes,
    /// Directions of the pixels' centres, tangents.
    pub(super) center: [Lane; 2],
    /// The same, before they are rounded.
    pub(super) exact_center: [[f64; LANES]; 2],
}

impl Patch {
    /// Makes the patch with the upper left pixel (`x`, `y`).
    #[inline(always)]
    pub(super) fn new(scene: &Scene, x: u32, y: u32) -> Self {
        let pixel = |l: usize| (x + l as u32 % PATCH_PX, y + l as u32 / PATCH_PX);
        let mut exact_center = [[0.0; LANES]; 2];
        for l in 0..LANES {
            let (x, y) = pixel(l);
            let tangent = scene.film.tangent(f64::from(x) + 0.5, f64::from(y) + 0.5);
            (0..2).for_each(|k| exact_center[k][l] = tangent[k]);
        }
        Self {
            corner: [x, y],
            seeds: SeedLanes::new(|l| {
                let (x, y) = pixel(l);
                PixelSeed::new(scene.seed, x, y)
            }),
            center: exact_center.map(|axis| axis.map(|v| v as f32)),
            exact_center,
        }
    }
}

impl Patch {
    /// Returns the tangents between which the film points of the patch lie, across and down.
    pub(super) fn film_bounds(&self, scene: &Scene) -> [[f64; 2]; 2] {
        let radius_px = scene.film.filter_radius_px();
        [0, 1].map(|k| {
            let reach = scene.film.pixel_tangent()[k] * radius_px;
            [self.exact_center[k][0] - reach, self.exact_center[k][LANES - 1] + reach]
        })
    }
}

/// Bounds of the camera samples of all pixels of a square.
pub(super) struct Area {
    /// Direction of the square's centre, tangents.
    pub(super) center: [f64; 2],
    /// Half the width and half the height of the area that the film points cover, tangents.
    pub(super) half_width: [f64; 2],
    /// Interval that contains the cosines of incidence of all samples.
    pub(super) cos_i: [f64; 2],
    /// The same of gamma (see [`super::slab`]).
    pub(super) gamma: [f64; 2],
}

impl Area {
    /// Bounds the square of `side_px` with the upper left pixel (`x`, `y`).
    #[inline(always)]
    pub(super) fn new(scene: &Scene, x: u32, y: u32, side_px: u32) -> Self {
        let half_px = 0.5 * f64::from(side_px);
        let center = scene.film.tangent(f64::from(x) + half_px, f64::from(y) + half_px);
        let radius_px = scene.film.filter_radius_px() + (half_px - 0.5);
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
        Self { center, half_width, cos_i: [lo, hi], gamma }
    }
}
