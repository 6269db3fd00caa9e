//! R in closed form: seen from the point at which it was taken, a photograph is the film's picture whatever its depth.
//!
//! R has neither glass nor lens. With apex `mirror` its rays leave the back camera's own centre, so the first surface that a
//! ray meets is the one that the photograph shows in this direction. The film then maps to texels by a scale and a shift in
//! each axis, and a pixel is an integral over bilinear texels that separates:
//!
//! ```text
//! pixel = sum over i, j of a_i b_j texel(i, j),   a_i = integral of filter(x) max(0, 1 - |t(x) - i|) dx
//! ```
//!
//! The tent is the second difference of a ramp, so a_i = P(i + 1) - 2 P(i) + P(i - 1) with P the filter's density in texels,
//! integrated twice. No ray is traced, and the only error is that of rounding.

use super::means::PixelMeans;
use super::overlay::shows_all_of_back;
use super::patch::Patch;
use super::scene::{FilmPlane, FilterTable, Pose, Scene, Surface, View};
use super::texture::Texture;
use glasshouse_line::layer::Layer;
use std::ops::Range;

/// Number of regular points across and down a pixel that count as R's paths.
const POINTS: u64 = 16;

/// R of the pixels of a tile.
pub(super) struct ClosedForm<'a> {
    texture: &'a Texture,
    columns: Axis,
    rows: Axis,
    /// True if the pane's edges or cards cover a part of R, which is then sampled.
    is_covered: bool,
}

/// Texels of each column (or row) of a tile, and their shares.
struct Axis {
    /// Index of the first texel.
    first: Vec<usize>,
    /// Ends of the shares in `shares`.
    ends: Vec<usize>,
    shares: Vec<f64>,
    /// Number of [`POINTS`] between the outermost pixel centres of the depth image, beyond which its border continues.
    inside: Vec<u64>,
}

/// Returns the view of the back photograph if R has a closed form where nothing covers it: from its own centre, in a flat mirror.
pub(super) fn closed_view(scene: &Scene) -> Option<&View> {
    match &scene.back {
        Surface::Sheet(view)
            if view.pose == Pose::Aligned { extra_m: 0.0 }
                && scene.bow.is_none()
                && scene.wave.is_none() =>
        {
            Some(view)
        }
        _ => None,
    }
}

impl<'a> ClosedForm<'a> {
    /// Prepares R of a tile with these columns and rows; `None` if the scene does not request R, or if it has no closed form.
    /// The range of samples that begins at 0 contains all of R.
    pub(super) fn new(scene: &'a Scene, columns: Range<u32>, rows: Range<u32>) -> Option<Self> {
        let view = closed_view(scene).filter(|_| scene.layers[Layer::CleanReflection])?;
        let axis = |k, pixels| Axis::new(&scene.film, view, k, pixels);
        Some(Self {
            texture: &view.texture,
            columns: axis(0, columns),
            rows: axis(1, rows),
            is_covered: scene.cover.may_cover_clean_reflection(),
        })
    }

    /// True if R of all pixels of the patch at (`x`, `y`) has a closed form.
    #[inline(always)]
    pub(super) fn has(&self, scene: &Scene, (x, y): (u32, u32)) -> bool {
        !self.is_covered || shows_all_of_back(scene, &Patch::new(scene, x, y))
    }

    /// True if the tile takes no samples of R.
    pub(super) fn is_all(&self) -> bool {
        !self.is_covered
    }

    /// Writes R of a pixel of the tile. The three means are equal, so that R states no error.
    #[inline(always)]
    pub(super) fn write(&self, index: usize, pixel: &mut PixelMeans) {
        let width = self.columns.first.len();
        let value = self.pixel(index % width, index / width);
        for means in [&mut pixel.mean, &mut pixel.half, &mut pixel.quarter] {
            means[Layer::CleanReflection as usize] = value;
        }
    }

    /// Returns the paths of a pixel, [`POINTS`] by [`POINTS`], and those that miss the photograph.
    #[inline(always)]
    pub(super) fn paths(&self, index: usize) -> [u64; 2] {
        let width = self.columns.first.len();
        let inside = self.columns.inside[index % width] * self.rows.inside[index / width];
        [POINTS * POINTS, POINTS * POINTS - inside]
    }

    /// Returns R of the pixel in a column and a row of the tile.
    #[inline(always)]
    fn pixel(&self, column: usize, row: usize) -> [f32; 3] {
        let (column, across) = self.columns.of(column);
        let (row, down) = self.rows.of(row);
        let mut sum = [0f64; 4];
        for (j, down) in (row..).zip(down) {
            let mut line = [0f64; 4];
            for (texel, share) in self.texture.row(j, column, across.len()).iter().zip(across) {
                (0..4).for_each(|c| line[c] += f64::from(texel[c]) * share);
            }
            (0..4).for_each(|c| sum[c] += line[c] * down);
        }
        [0, 1, 2].map(|c| sum[c] as f32)
    }
}

impl Axis {
    /// Computes the shares for the `pixels` of axis `k`.
    fn new(film: &FilmPlane, view: &View, k: usize, pixels: Range<u32>) -> Self {
        let texels = [view.texture.width(), view.texture.height()][k];
        let vertices = [view.photograph_size.0, view.photograph_size.1][k] as f64;
        let scale = texels as f64 / vertices;
        let per_px = (view.focal_px[k] * film.pixel_tangent()[k] * scale).abs();
        let vertex = |at: f64| view.focal_px[k] * film.tangent(at, at)[k] + view.principal[k];
        let mut axis = Self { first: vec![], ends: vec![], shares: vec![], inside: vec![] };
        for p in pixels {
            let at = f64::from(p) + 0.5;
            // The colour and the depth image have the same field of view.
            let center = (vertex(at) + 0.5) * scale - 0.5;
            let reach = film.filter_radius_px() * per_px;
            let last = (texels - 1) as f64;
            let lo = (center - reach).floor().clamp(0.0, last);
            let hi = (center + reach).ceil().clamp(0.0, last);
            axis.first.push(lo as usize);
            let is_inside = |at: f64| (0.0..=vertices - 1.0).contains(&vertex(f64::from(p) + at));
            let point = |point: u64| (point as f64 + 0.5) / POINTS as f64;
            let inside = if is_inside(0.0) && is_inside(1.0) {
                POINTS
            } else {
                (0..POINTS).filter(|index| is_inside(point(*index))).count() as u64
            };
            axis.inside.push(inside);
            // The sum of the shares up to a texel is the difference of P to the next one. The first and the last texel have
            // all shares beyond, too: the border continues.
            let ramp = |t: f64| per_px * twice_integrated(film, (t - center) / per_px);
            let (mut texel, mut before, mut sum) = (lo, ramp(lo), 0.0);
            while texel < hi {
                let next = ramp(texel + 1.0);
                axis.shares.push((next - before - sum).max(0.0));
                (sum, before, texel) = (next - before, next, texel + 1.0);
            }
            axis.shares.push((1.0 - sum).max(0.0));
            axis.ends.push(axis.shares.len());
        }
        axis
    }

    /// Returns the first texel of a column (or row) and the shares.
    #[inline(always)]
    fn of(&self, index: usize) -> (usize, &[f64]) {
        let start = index.checked_sub(1).map_or(0, |before| self.ends[before]);
        (self.first[index], &self.shares[start..self.ends[index]])
    }
}

/// Returns the density of the film's filter, integrated twice from the left to `x`, the distance from the pixel's centre, px.
fn twice_integrated(film: &FilmPlane, x: f64) -> f64 {
    let radius = film.filter_radius_px();
    if x <= -radius {
        return 0.0;
    }
    if x >= radius {
        // The density is symmetric, and its integral is 1.
        return x;
    }
    if film.filter.is_none() {
        return 0.5 * (x + 0.5) * (x + 0.5);
    }
    // The integral of erf(k u) is u erf(k u) + exp(-k^2 u^2) / (k sqrt(pi)).
    let k = 1.0 / (FilterTable::GAUSSIAN_SIGMA_PX * std::f64::consts::SQRT_2);
    let bell = |u: f64| libm::exp(-k * k * u * u) / (k * std::f64::consts::PI.sqrt());
    let edge = libm::erf(k * radius);
    (x * libm::erf(k * x) + bell(x) - bell(radius) + edge * x) / (2.0 * edge)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::Grid;

    const FILM: [u32; 2] = [24, 10];

    /// Makes a film, and a mirrored photograph with `per_px` texels for a pixel of the film, off the axis.
    fn place(gaussian: bool, texels: [usize; 2], per_px: f64) -> (FilmPlane, View) {
        let film = FilmPlane {
            width: FILM[0],
            height: FILM[1],
            tan_half_fov: FilmPlane::tan_half_fov(FILM[0], FILM[1], 50.0),
            filter: gaussian.then(FilterTable::gaussian),
        };
        let [nx, ny] = texels;
        let value = |q: usize| [0, 1, 2].map(|k| ((q * 7919 + k * 104_729) % 613) as f32 / 613.0);
        let texel = |q| [value(q)[0], value(q)[1], value(q)[2], 0.0];
        let rows: Vec<[f32; 4]> = (0..nx * ny).map(texel).collect();
        // The depth image has half of the columns and rows.
        let vertices = (nx.div_ceil(2), ny.div_ceil(2));
        let focal = [-0.5, 0.5].map(|half| half * per_px / film.pixel_tangent()[0]);
        let view = View {
            grid: Grid::new(vertices.0, vertices.1, vec![0.5; vertices.0 * vertices.1]).into(),
            texture: Texture::new(nx, ny, &rows).into(),
            focal_px: focal,
            principal: [vertices.0 as f64 / 2.0 - 0.9, vertices.1 as f64 / 2.0 - 0.3],
            pose: Pose::Aligned { extra_m: 0.0 },
            photograph_size: vertices,
        };
        (film, view)
    }

    fn closed<'a>(film: &FilmPlane, view: &'a View) -> ClosedForm<'a> {
        ClosedForm {
            texture: &view.texture,
            columns: Axis::new(film, view, 0, 0..film.width),
            rows: Axis::new(film, view, 1, 0..film.height),
            is_covered: false,
        }
    }

    /// Integrates a pixel's filter over the bilinear photograph by the midpoint rule in f64.
    fn quadrature(film: &FilmPlane, view: &View, pixel: [u32; 2]) -> [f64; 3] {
        const POINTS: u32 = 400;
        let radius = film.filter_radius_px();
        let texture = &view.texture;
        let size = [texture.width(), texture.height()];
        // For each axis: pairs of texels, their shares and the density.
        let axes = [0, 1].map(|k| {
            let vertices = [view.photograph_size.0, view.photograph_size.1][k] as f64;
            let of = |point: u32| {
                let x = ((f64::from(point) + 0.5) / f64::from(POINTS) * 2.0 - 1.0) * radius;
                let at = f64::from(pixel[k]) + 0.5 + x;
                let vertex = view.focal_px[k] * film.tangent(at, at)[k] + view.principal[k];
                let t = (vertex + 0.5) * size[k] as f64 / vertices - 0.5;
                let t = t.clamp(0.0, (size[k] - 1) as f64);
                let density = if film.filter.is_some() { (-2.0 * x * x).exp() } else { 1.0 };
                (t.floor() as usize, t.fract(), density)
            };
            (0..POINTS).map(of).collect::<Vec<_>>()
        });
        let (mut sum, mut all) = ([0.0; 3], 0.0);
        for &(j, below, of_row) in &axes[1] {
            for &(i, right, of_column) in &axes[0] {
                let density = of_row * of_column;
                all += density;
                for (dj, down) in [(0, 1.0 - below), (1, below)] {
                    for (di, across) in [(0, 1.0 - right), (1, right)] {
                        let (i, j) = ((i + di).min(size[0] - 1), (j + dj).min(size[1] - 1));
                        let texel = texture.row(j, i, 1)[0];
                        (0..3)
                            .for_each(|c| sum[c] += density * down * across * f64::from(texel[c]));
                    }
                }
            }
        }
        sum.map(|v| v / all)
    }

    #[test]
    fn pixels_are_integrals_over_the_photograph() {
        for gaussian in [false, true] {
            // Photographs finer and coarser than the film, one smaller than the film, and one of a single row.
            for (texels, per_px) in
                [([90, 40], 3.1), ([30, 14], 0.43), ([12, 6], 1.0), ([50, 1], 1.7), ([1, 9], 0.9)]
            {
                let (film, view) = place(gaussian, texels, per_px);
                let closed = closed(&film, &view);
                for (x, y) in [(0, 0), (5, 3), (11, 9), (23, 4)] {
                    let (found, truth) =
                        (closed.pixel(x, y), quadrature(&film, &view, [x as u32, y as u32]));
                    for c in 0..3 {
                        let error = (f64::from(found[c]) - truth[c]).abs();
                        assert!(error < 3e-5, "{gaussian} {texels:?} ({x}, {y}): {error:e}");
                    }
                }
            }
        }
    }

    #[test]
    fn shares_add_up_to_one_and_keep_the_centre_of_mass() {
        for gaussian in [false, true] {
            for per_px in [0.01, 0.4, 1.0, 7.3, 300.0] {
                let (film, view) = place(gaussian, [9000, 3000], per_px);
                let axis = Axis::new(&film, &view, 0, 0..film.width);
                for p in 0..film.width {
                    let (first, shares) = axis.of(p as usize);
                    assert!(shares.iter().all(|share| *share >= 0.0));
                    let sum: f64 = shares.iter().sum();
                    let moment = |(i, share): (usize, &f64)| i as f64 * share;
                    let mean: f64 = (first..).zip(shares).map(moment).sum();
                    let at = f64::from(p) + 0.5;
                    let vertex = view.focal_px[0] * film.tangent(at, at)[0] + view.principal[0];
                    assert!((sum - 1.0).abs() < 1e-12, "{per_px}: {sum}");
                    assert!((mean - (2.0 * vertex + 0.5)).abs() < 1e-8, "{per_px}: {mean}");
                }
            }
        }
    }

    #[test]
    fn pixels_beyond_the_photograph_are_counted() {
        let (film, view) = place(false, [12, 6], 1.0);
        let closed = closed(&film, &view);
        let (mut paths, mut misses, mut pixel) = (0, 0, PixelMeans::default());
        for index in 0..240 {
            let [all, beyond] = closed.paths(index);
            (paths, misses) = (paths + all, misses + beyond);
        }
        closed.write(7, &mut pixel);
        // The outermost pixel centres of the depth image are 10 and 4 px of the film apart.
        assert_eq!((paths, misses), (240 * 256, (240 - 10 * 4) * 256));
        assert!(pixel.mean == pixel.half && pixel.mean == pixel.quarter);
        assert_eq!(pixel.mean[3], closed.pixel(7, 0));
    }
}
