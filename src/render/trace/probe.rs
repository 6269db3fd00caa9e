//! Runs the intersection kernel alone: the step of [`super::bundle`] from a bundle's lines to its hits.
//!
//! A probe prepares camera samples and lines once. Each call then finds every bundle's span and walks the grid; the
//! caller measures the time.

use super::camera::{CameraBlock, GROUPS, Pixel};
use super::lanes::{LANES, Lane};
use super::lines::{LineMaker, Path};
use super::sampler::{BLOCK, PixelSeed, points};
use super::scene::{Pose, Sampling, Scene, Surface, View};
use super::slab::Order;
use super::tile::Isa;
use super::walk::{Lines, Walkers, walk_bundle};

/// Bundles of 256 rays of one order, one bundle per pixel, prepared for intersection.
pub struct BundleProbe<'a> {
    scene: &'a Scene,
    view: &'a View,
    bundles: Vec<Bundle<'a>>,
}

struct Bundle<'a> {
    pixel: Pixel,
    maker: LineMaker<'a>,
    lines: [Lines; GROUPS],
    /// Camera samples, for views without a closed form of the footprint; `None` for other views, which ignore them.
    camera: Option<Box<CameraBlock>>,
}

/// A ray in the frame of the capture camera: the point `origin + direction / w` has inverse depth w. In this frame,
/// vertex (i, j) of the sheet is `((i + 0.5 - cx) / fx, (j + 0.5 - cy) / fy, 1) / w`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProbeRay {
    /// Origin in the plane z = 0, m.
    pub origin: [f32; 3],
    /// Direction with z = 1.
    pub direction: [f32; 3],
}

/// Computes `[pixel x, pixel y, lens u, lens v]` of a pixel's samples `first .. first + 256` with the tracer's code;
/// `first` is a multiple of 256. Benchmarks time this function; [`super::sample`] defines the Sobol points.
pub fn sample_block(
    sampling: Sampling,
    seed: &PixelSeed,
    first: u32,
    isa: Isa,
) -> [[f32; BLOCK]; 4] {
    match isa {
        #[cfg(target_arch = "x86_64")]
        #[allow(unsafe_code, reason = "calling a function compiled for AVX2")]
        Isa::Avx2 if std::arch::is_x86_feature_detected!("avx2") => {
            // SAFETY: the check above found AVX2 on this machine.
            unsafe { sample_block_avx2(sampling, seed, first) }
        }
        _ => sample_block_here(sampling, seed, first),
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn sample_block_avx2(sampling: Sampling, seed: &PixelSeed, first: u32) -> [[f32; BLOCK]; 4] {
    sample_block_here(sampling, seed, first)
}

#[inline(always)]
fn sample_block_here(sampling: Sampling, seed: &PixelSeed, first: u32) -> [[f32; BLOCK]; 4] {
    let mut block = [[0.0; BLOCK]; 4];
    for (pair, [u, v]) in block.as_chunks_mut().0.iter_mut().enumerate() {
        let (u, v) = (u.as_chunks_mut().0, v.as_chunks_mut().0);
        points(sampling, seed, pair, first, u, v);
    }
    block
}

/// Lengths of the rays' walks over the grid, computed from their start and end points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WalkCount {
    pub rays: u64,
    /// Number of cells that the rays touch, from the start of their bundle's span to their hit.
    pub cells: u64,
    /// Number of groups of sixteen rays.
    pub groups: u64,
    /// Sum of the cells of each group's longest ray: the rounds of a kernel that walks a group until its last ray ends.
    pub rounds: u64,
}

impl<'a> BundleProbe<'a> {
    /// Prepares bundles of `order` (`None`: the pinhole of R, without glass) for every `step_px`-th pixel across and
    /// down. A bundle has the first 256 samples of its pixel; the scene must have at least as many.
    ///
    /// Returns `None` if the tracer walks no grid: for meshes, and for R with apex `mirror`, because its hits do not
    /// depend on the sheet.
    pub fn new(scene: &'a Scene, order: Option<Order>, step_px: u32) -> Option<Self> {
        assert!(scene.spp as usize >= BLOCK, "a bundle has {BLOCK} samples");
        let surface = match order {
            Some(Order::Transmitted(_)) => &scene.front,
            Some(Order::Reflected(_)) | None => &scene.back,
        };
        let Surface::Sheet(view) = surface else {
            return None;
        };
        let path = order.map_or(Path::Pinhole, |order| {
            let constant = scene.slab.kappa_m(order, 0.0);
            Path::Lens { constant, slope: scene.slab.kappa_m(order, 1.0) - constant }
        });
        let step = step_px.max(1) as usize;
        let mut bundles = Vec::new();
        for y in (0..scene.film.height).step_by(step) {
            for x in (0..scene.film.width).step_by(step) {
                let pixel = Pixel::new(scene, x, y);
                let mut camera = CameraBlock::new();
                camera.fill(scene, &pixel, 0, BLOCK as u32);
                let maker = LineMaker::new(scene, view, &pixel, path);
                if maker.is_fixed() {
                    return None;
                }
                let mut lines = [Lines::ZERO; GROUPS];
                for (g, lines) in lines.iter_mut().enumerate() {
                    *lines = maker.lines(&camera, g);
                }
                let is_general = matches!(view.pose, Pose::General { .. });
                bundles.push(Bundle { pixel, maker, lines, camera: is_general.then_some(camera) });
            }
        }
        Some(Self { scene, view, bundles })
    }

    /// Returns the number of rays of all bundles.
    pub fn len(&self) -> usize {
        self.bundles.len() * BLOCK
    }

    /// True if the probe has no bundle.
    pub fn is_empty(&self) -> bool {
        self.bundles.is_empty()
    }

    /// Returns the view with the sheet that the rays hit.
    pub fn view(&self) -> &View {
        self.view
    }

    /// Computes the span and walk of every bundle, and writes the inverse depths (1/m) of all hits to `hits`, in the
    /// order of the rays. Benchmarks time this call. The result does not depend on `isa`. Panics if the length
    /// of `hits` is not [`Self::len`].
    pub fn intersect(&self, isa: Isa, hits: &mut [f32]) {
        assert_eq!(hits.len(), self.len(), "a hit for each ray");
        match isa {
            #[cfg(target_arch = "x86_64")]
            #[allow(unsafe_code, reason = "calling a function compiled for AVX2")]
            Isa::Avx2 if std::arch::is_x86_feature_detected!("avx2") => {
                // SAFETY: the check above found AVX2 on this machine.
                unsafe { self.intersect_avx2(hits) }
            }
            _ => self.intersect_here::<false>(hits),
        }
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn intersect_avx2(&self, hits: &mut [f32]) {
        self.intersect_here::<true>(hits);
    }

    #[inline(always)]
    fn intersect_here<const AVX2: bool>(&self, hits: &mut [f32]) {
        let (shared, mut walkers) = (CameraBlock::new(), Walkers::new());
        let (groups, _) = hits.as_chunks_mut::<LANES>();
        for (bundle, hits) in self.bundles.iter().zip(groups.chunks_exact_mut(GROUPS)) {
            let camera = bundle.camera.as_deref().unwrap_or(&shared);
            let span = bundle.maker.span(self.scene, &bundle.pixel, camera, GROUPS);
            let (grid, base) = (&self.view.grid, bundle.maker.base);
            walk_bundle::<AVX2>(grid, base, &bundle.lines, span, &mut walkers, hits);
        }
    }

    /// Returns all rays, in the order of [`Self::intersect`].
    pub fn rays(&self) -> Vec<ProbeRay> {
        let focal = self.view.focal_px.map(f64::abs);
        let principal = self.view.principal;
        let mut rays = Vec::with_capacity(self.len());
        for bundle in &self.bundles {
            let base = bundle.maker.base.map(f64::from);
            for lines in &bundle.lines {
                for l in 0..LANES {
                    let at = [lines.x[l], lines.y[l]].map(f64::from);
                    let slope = [lines.sx[l], lines.sy[l]].map(f64::from);
                    let direction =
                        [0, 1].map(|k| ((at[k] + base[k] - principal[k]) / focal[k]) as f32);
                    let origin = [0, 1].map(|k| (slope[k] / focal[k]) as f32);
                    rays.push(ProbeRay {
                        origin: [origin[0], origin[1], 0.0],
                        direction: [direction[0], direction[1], 1.0],
                    });
                }
            }
        }
        rays
    }

    /// Counts the cells between the start of each ray's walk and its hit in `hits`, the result of [`Self::intersect`].
    pub fn count(&self, hits: &[f32]) -> WalkCount {
        let shared = CameraBlock::new();
        let mut count = WalkCount::default();
        let (groups, _) = hits.as_chunks::<LANES>();
        for (bundle, hits) in self.bundles.iter().zip(groups.chunks_exact(GROUPS)) {
            let camera = bundle.camera.as_deref().unwrap_or(&shared);
            let span = bundle.maker.span(self.scene, &bundle.pixel, camera, GROUPS);
            for (lines, hits) in bundle.lines.iter().zip(hits) {
                let cells = self.cells(bundle.maker.base, lines, span.hi, hits);
                count.rays += LANES as u64;
                count.groups += 1;
                count.cells += cells.iter().sum::<u64>();
                count.rounds += cells.iter().fold(0, |m, &n| m.max(n));
            }
        }
        count
    }

    /// Counts the cells that each of sixteen rays touches. Cells beyond the outermost columns and rows count as one.
    fn cells(&self, base: [i32; 2], lines: &Lines, from_w: f32, hits: &Lane) -> [u64; LANES] {
        let grid = &self.view.grid;
        let cell = |at: f32, base: i32, n: usize| {
            (at.floor() as i64 + i64::from(base)).clamp(-1, n as i64 - 1)
        };
        let mut cells = [0; LANES];
        for l in 0..LANES {
            let across = |w: f32| cell(lines.x[l] + lines.sx[l] * w, base[0], grid.nx());
            let down = |w: f32| cell(lines.y[l] + lines.sy[l] * w, base[1], grid.ny());
            cells[l] =
                1 + across(from_w).abs_diff(across(hits[l])) + down(from_w).abs_diff(down(hits[l]));
        }
        cells
    }
}
