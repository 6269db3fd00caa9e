//! Runs the intersection kernel alone: the step of [`super::bundle`] from a bundle's lines to its hits.
//!
//! A probe prepares camera samples and lines once. Each call then finds every bundle's span and walks the grid; the
//! caller measures the time.

use super::camera::CameraChunk;
use super::closed::closed_view;
use super::isa::{AVX2, AVX512, BASELINE, Isa};
use super::lanes::{CHUNK, LANES, Lane};
use super::lines::{
    LineMaker, Path, ViewLanes, path_of, pinhole_path, span_of_area, span_of_lines,
};
use super::patch::{Area, PATCH_PX, Patch};
use super::rough::RoughPane;
use super::sampler::{PixelSeed, SeedLanes, points};
use super::scene::{Pose, Sampling, Scene, Surface, View};
use super::slab::Order;
use super::walk::{GridLanes, Group, Lines, Span, Walkers, walk_bundle};

/// Bundles of one order, one for each probed patch, prepared for intersection.
pub struct BundleProbe<'a> {
    scene: &'a Scene,
    view: &'a View,
    path: Path<'a>,
    bundles: Vec<Bundle>,
}

/// Number of rays of a bundle: sixteen samples of sixteen pixels.
const RAYS: usize = CHUNK * LANES;

struct Bundle {
    corner: [u32; 2],
    grid: GridLanes,
    lines: [Lines; CHUNK],
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

/// Computes `[pixel x, pixel y, lens u, lens v]` of samples `first .. first + 16` of sixteen pixels with the tracer's code: a
/// row for each sample, and a column for each pixel. Benchmarks time this function; [`super::sample`] defines the Sobol
/// points.
pub fn sample_patch(
    sampling: Sampling,
    seeds: &[PixelSeed; LANES],
    first: u32,
    isa: Isa,
) -> [[[f32; LANES]; CHUNK]; 4] {
    match isa {
        #[cfg(target_arch = "x86_64")]
        #[allow(unsafe_code, reason = "calling a function compiled for AVX2")]
        Isa::Avx2 | Isa::Avx512 if Isa::Avx2.is_available() => {
            // SAFETY: the check above found AVX2 on this machine.
            unsafe { sample_patch_avx2(sampling, seeds, first) }
        }
        _ => sample_patch_here(sampling, seeds, first),
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn sample_patch_avx2(
    sampling: Sampling,
    seeds: &[PixelSeed; LANES],
    first: u32,
) -> [[[f32; LANES]; CHUNK]; 4] {
    sample_patch_here(sampling, seeds, first)
}

#[inline(always)]
fn sample_patch_here(
    sampling: Sampling,
    seeds: &[PixelSeed; LANES],
    first: u32,
) -> [[[f32; LANES]; CHUNK]; 4] {
    let seeds = SeedLanes::new(|l| seeds[l]);
    let mut samples = [[[0.0; LANES]; CHUNK]; 4];
    for (pair, [u, v]) in samples.as_chunks_mut().0.iter_mut().enumerate() {
        points(sampling, &seeds, pair, first, u, v);
    }
    samples
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
    /// Prepares bundles of `order` (`None`: the pinhole of R, without glass) for the patches at every `step_px`-th pixel
    /// across and down. A bundle has the first sixteen samples of the pixels of its patch.
    ///
    /// Returns `None` if the tracer walks no grid: for meshes, and for R in closed form.
    pub fn new(scene: &'a Scene, order: Option<Order>, step_px: u32) -> Option<Self> {
        let surface = match order {
            Some(Order::Transmitted(_)) => &scene.front,
            Some(Order::Reflected(_)) | None => &scene.back,
        };
        let Surface::Sheet(view) = surface else {
            return None;
        };
        let path = match order {
            None => pinhole_path(scene),
            Some(order) => {
                let followed = scene.orders.front.iter().chain(&scene.orders.back);
                let of_side = followed.filter(|f| {
                    matches!(f.order, Order::Transmitted(_))
                        == matches!(order, Order::Transmitted(_))
                });
                let index = of_side.map(|f| f.order).position(|of_side| of_side == order);
                path_of(scene, order, index.unwrap_or(0))
            }
        };
        let is_covered = scene.cover.may_cover_clean_reflection();
        if order.is_none() && closed_view(scene).is_some() && !is_covered {
            return None;
        }
        let step = step_px.div_ceil(PATCH_PX).max(1) * PATCH_PX;
        let (mut bundles, mut camera) = (Vec::new(), CameraChunk::new());
        let taken = vec![CHUNK; scene.rough.as_ref().map_or(0, RoughPane::ways)];
        for y in (0..scene.film.height).step_by(step as usize) {
            for x in (0..scene.film.width).step_by(step as usize) {
                let patch = Patch::new(scene, x, y);
                camera.fill(scene, &patch, 0, CHUNK);
                if let Some(pane) = &scene.rough {
                    camera.scatter(scene, pane, &patch, &taken, Isa::detect());
                }
                let lanes = ViewLanes::new(view, &patch);
                let maker = LineMaker::new(scene, view, &patch, &lanes);
                let lines = std::array::from_fn(|s| maker.lines(&camera, path, s));
                bundles.push(Bundle { corner: patch.corner, grid: lanes.grid, lines });
            }
        }
        Some(Self { scene, view, path, bundles })
    }

    /// Finds the span of a bundle's patch.
    #[inline(always)]
    fn span(&self, bundle: &Bundle) -> Span {
        match self.view.pose {
            Pose::Aligned { extra_m } if !self.path.is_free() => {
                let [x, y] = bundle.corner;
                let area = Area::new(self.scene, x, y, PATCH_PX);
                span_of_area(self.scene, self.view, &[self.path], &area, extra_m, true).0
            }
            _ => span_of_lines(self.view, &bundle.grid, &bundle.lines).0,
        }
    }

    /// Returns the number of rays of all bundles.
    pub fn len(&self) -> usize {
        self.bundles.len() * RAYS
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
        #[cfg(target_arch = "x86_64")]
        #[allow(unsafe_code, reason = "calling functions compiled for AVX2 and AVX-512")]
        if isa.is_available() {
            match isa {
                // SAFETY: this machine has AVX-512.
                Isa::Avx512 => return unsafe { self.intersect_avx512(hits) },
                // SAFETY: this machine has AVX2.
                Isa::Avx2 => return unsafe { self.intersect_avx2(hits) },
                Isa::Baseline => {}
            }
        }
        self.intersect_here::<BASELINE>(hits);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn intersect_avx2(&self, hits: &mut [f32]) {
        self.intersect_here::<AVX2>(hits);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,avx512f,avx512vl,avx512dq,avx512bw")]
    fn intersect_avx512(&self, hits: &mut [f32]) {
        self.intersect_here::<AVX512>(hits);
    }

    #[inline(always)]
    fn intersect_here<const ISA: u8>(&self, hits: &mut [f32]) {
        let mut walkers = Walkers::new();
        let (groups, _) = hits.as_chunks_mut::<LANES>();
        for (bundle, hits) in self.bundles.iter().zip(groups.chunks_exact_mut(CHUNK)) {
            let spans = self.span(bundle).into();
            let group = Group { lanes: &bundle.grid, spans: &spans };
            walk_bundle::<ISA>(&self.view.grid, |_| group, &bundle.lines, &mut walkers, hits);
        }
    }

    /// Returns all rays, in the order of [`Self::intersect`].
    pub fn rays(&self) -> Vec<ProbeRay> {
        let focal = self.view.focal_px.map(f64::abs);
        let principal = self.view.principal;
        let mut rays = Vec::with_capacity(self.len());
        for bundle in &self.bundles {
            for lines in &bundle.lines {
                for l in 0..LANES {
                    let base = [0, 1].map(|k| f64::from(bundle.grid.base[k][l]));
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
        let mut count = WalkCount::default();
        let (groups, _) = hits.as_chunks::<LANES>();
        for (bundle, hits) in self.bundles.iter().zip(groups.chunks_exact(CHUNK)) {
            let span = self.span(bundle);
            for (lines, hits) in bundle.lines.iter().zip(hits) {
                let cells = self.cells(&bundle.grid.base, lines, span.hi, hits);
                count.rays += LANES as u64;
                count.groups += 1;
                count.cells += cells.iter().sum::<u64>();
                count.rounds += cells.iter().fold(0, |m, &n| m.max(n));
            }
        }
        count
    }

    /// Counts the cells that each of sixteen rays touches. Cells beyond the outermost columns and rows count as one.
    fn cells(
        &self,
        base: &[[i32; LANES]; 2],
        lines: &Lines,
        from_w: f32,
        hits: &Lane,
    ) -> [u64; LANES] {
        let grid = &self.view.grid;
        let cell = |at: f32, base: i32, n: usize| {
            (at.floor() as i64 + i64::from(base)).clamp(-1, n as i64 - 1)
        };
        let mut cells = [0; LANES];
        for l in 0..LANES {
            let across = |w: f32| cell(lines.x[l] + lines.sx[l] * w, base[0][l], grid.nx());
            let down = |w: f32| cell(lines.y[l] + lines.sy[l] * w, base[1][l], grid.ny());
            cells[l] =
                1 + across(from_w).abs_diff(across(hits[l])) + down(from_w).abs_diff(down(hits[l]));
        }
        cells
    }
}
