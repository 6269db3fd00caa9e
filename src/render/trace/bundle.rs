//! The estimator: traces a pixel in bundles, and computes the four layers from the same camera samples.
//!
//! ```text
//! camera sample s = (film point, lens point)                       -> ray
//! T  = mean over s of F(t_0 line)                                  (virtual glass: bent, weight 1)
//! F_ = sum over orders k of mean over s of weight_k(s) F(t_k line)
//! R~ = sum over orders k of mean over s of weight_k(s) B(r_k line)
//! I  = F_ + R~             (with `first_reflection_alone`, I has all orders of R~, but the layer R~ only r_0)
//! R  = mean over film points of B(mirrored pinhole ray)            (no glass, no lens)
//! ```
//!
//! F and B are the radiances of the front and the back photograph at the line's first hit with the sheet (or mesh) of
//! each. A path ends at this hit, because a photograph has the radiance that leaves the surface (Eq. 1 of the paper).

use super::camera::{CameraBlock, GROUPS, Pixel};
use super::fetch::{Cells, TexelMap, Weights};
use super::lanes::{LANES, Lane};
use super::lines::{LineMaker, Path};
use super::means::{Components, Means, NOTHING, Sums, Wanted, add_means, ends_in_block, means_of};
use super::mesh;
use super::orders::FollowedOrder;
use super::sampler::BLOCK;
use super::scene::{Scene, Surface};
use super::shade::{absorbed, weights};
use super::slab::Order;
use super::tile::Isa;
use super::walk::{Lines, Walkers, walk_bundle};
use crate::layer::{Layer, PerLayer};
use std::ops::Range;

/// Tracer of a scene's pixels, with counts of their paths.
///
/// `AVX2` selects the kernels; only functions compiled for AVX2 set it.
pub(super) struct Tracer<'a, const AVX2: bool> {
    scene: &'a Scene,
    camera: Box<CameraBlock>,
    rays: Box<BundleRays>,
    front: Vec<Sums>,
    back: Vec<Sums>,
    paths: PerLayer<u64>,
    misses: PerLayer<u64>,
}

/// Lines of a bundle and their hits. All bundles reuse this memory.
struct BundleRays {
    lines: [Lines; GROUPS],
    hits: [Lane; GROUPS],
    walkers: Walkers,
}

impl BundleRays {
    fn new() -> Box<Self> {
        Box::new(Self {
            lines: [Lines::ZERO; GROUPS],
            hits: [[0.0; LANES]; GROUPS],
            walkers: Walkers::new(),
        })
    }
}

/// One block of a pixel's samples along one order (or R's pinhole path).
struct Bundle<'a> {
    surface: &'a Surface,
    path: Path,
    order: Option<Order>,
    feeds: Feeds,
    /// Number of the block's samples in the first quarter of the pixel's samples, in the first half, and in total.
    ends: [u32; 3],
}

/// Sums that receive a bundle's radiance.
#[derive(Clone, Copy, PartialEq)]
enum Feeds {
    /// The order's weighted sum, or the sum of R.
    Order,
    /// For t_0: the unweighted sum of T.
    Bare,
    /// For t_0: both sums.
    Both,
}

impl<'a, const AVX2: bool> Tracer<'a, AVX2> {
    pub(super) fn new(scene: &'a Scene) -> Self {
        Self {
            scene,
            camera: CameraBlock::new(),
            rays: BundleRays::new(),
            front: vec![NOTHING; scene.orders.front.len()],
            back: vec![NOTHING; scene.orders.back.len()],
            paths: PerLayer::default(),
            misses: PerLayer::default(),
        }
    }

    /// Returns the numbers of paths and misses of the layers so far.
    pub(super) fn counts(&self) -> (PerLayer<u64>, PerLayer<u64>) {
        (self.paths, self.misses)
    }

    /// Traces the `wanted` components of pixel (`x`, `y`) with `samples`, an aligned power-of-two block. R takes only
    /// the first `clean` samples of the block.
    #[inline(always)]
    pub(super) fn pixel(
        &mut self,
        (x, y): (u32, u32),
        samples: &Range<u32>,
        clean: u32,
        wanted: Wanted,
    ) -> Components {
        let scene = self.scene;
        let pixel = Pixel::new(scene, x, y);
        let count = samples.end - samples.start;
        let block = count.min(BLOCK as u32);
        let blocks = count / block;
        let (mut bare, mut pinhole) = (NOTHING, NOTHING);
        self.front.fill(NOTHING);
        self.back.fill(NOTHING);
        // T needs only the first order of the front, t_0.
        let of_front = match (wanted.front, wanted.bare) {
            (true, _) => scene.orders.front.len(),
            (false, bare) => usize::from(bare),
        };
        let of_back = scene.orders.back.len() * usize::from(wanted.back);
        for b in 0..blocks {
            self.camera.fill(scene, &pixel, samples.start + b * block, block);
            for k in 0..of_front + of_back {
                let (list, surface, k) = match k.checked_sub(of_front) {
                    None => (&scene.orders.front, &scene.front, k),
                    Some(k) => (&scene.orders.back, &scene.back, k),
                };
                let followed = &list[k];
                let bundle = Bundle {
                    surface,
                    path: self.path(followed),
                    order: Some(followed.order),
                    feeds: match followed.order {
                        // T receives t_0 even if the scene does not request T: the request must not affect I's bits.
                        Order::Transmitted(0) if wanted.front => Feeds::Both,
                        Order::Transmitted(0) if wanted.bare => Feeds::Bare,
                        _ => Feeds::Order,
                    },
                    ends: ends_in_block(followed.samples_of_block(block), b, blocks),
                };
                let (sums, misses) = self.follow(&pixel, &bundle, &mut bare);
                self.count_paths(&bundle, misses);
                let total = match followed.order {
                    Order::Transmitted(_) => &mut self.front[k],
                    Order::Reflected(_) => &mut self.back[k],
                };
                for (total, part) in total.iter_mut().flatten().zip(sums.iter().flatten()) {
                    *total += part;
                }
            }
            let left = clean.saturating_sub(b * block).min(block);
            if wanted.clean && left > 0 {
                let end = |end: u32| end.saturating_sub(b * block).min(left);
                let bundle = Bundle {
                    surface: &scene.back,
                    path: Path::Pinhole,
                    order: None,
                    feeds: Feeds::Order,
                    ends: [end(clean / 4), end(clean / 2), left],
                };
                let (sums, misses) = self.follow(&pixel, &bundle, &mut bare);
                self.count_paths(&bundle, misses);
                for (total, part) in pinhole.iter_mut().flatten().zip(sums.iter().flatten()) {
                    *total += part;
                }
            }
        }
        let sum_of = |list: &[FollowedOrder], sums: &[Sums]| {
            let mut total: Means = NOTHING;
            for (followed, sums) in list.iter().zip(sums) {
                let samples = followed.samples_of_block(block) * blocks;
                add_means(&mut total, &means_of(sums, samples));
            }
            total
        };
        let reflected = sum_of(&scene.orders.back, &self.back);
        let back = match scene.orders.back.first() {
            Some(first) if scene.first_reflection_alone && first.order == Order::Reflected(0) => {
                sum_of(&scene.orders.back[..1], &self.back[..1])
            }
            _ if scene.first_reflection_alone => NOTHING,
            _ => reflected,
        };
        Components {
            front: sum_of(&scene.orders.front, &self.front),
            bare: means_of(&bare, count),
            reflected,
            back,
            clean: means_of(&pinhole, clean.max(1)),
        }
    }

    /// Returns the path of an order; its shift is a linear function of gamma.
    fn path(&self, followed: &FollowedOrder) -> Path {
        let constant = self.scene.slab.kappa_m(followed.order, 0.0);
        Path::Lens { constant, slope: self.scene.slab.kappa_m(followed.order, 1.0) - constant }
    }

    /// Traces a bundle. Returns the sums of its weighted radiance and its misses; adds the sums of T to `bare`.
    #[inline(always)]
    fn follow(&mut self, pixel: &Pixel, bundle: &Bundle, bare: &mut Sums) -> (Sums, u64) {
        let (scene, camera, rays) = (self.scene, &*self.camera, &mut *self.rays);
        let view = match bundle.surface {
            Surface::Sheet(view) => view,
            Surface::Mesh(mesh) => {
                let bundle = mesh::Bundle {
                    pixel,
                    camera,
                    path: bundle.path,
                    order: bundle.order,
                    ends: bundle.ends,
                };
                let isa = if AVX2 { Isa::Avx2 } else { Isa::Baseline };
                return mesh::follow(scene, mesh, &bundle, isa, bare);
            }
        };
        let count = bundle.ends[2] as usize;
        let groups = count.div_ceil(LANES);
        let maker = LineMaker::new(scene, view, pixel, bundle.path);
        let mut span = None;
        if !maker.is_fixed() {
            span = Some(maker.span(scene, pixel, camera, groups));
        }
        let inside = span.is_some_and(|s| s.inside);
        let map = TexelMap::new(view, maker.base);
        let (mut sums, mut unused) = (NOTHING, NOTHING);
        let mut misses = 0;
        for g in 0..groups {
            rays.lines[g] = maker.lines(camera, g);
        }
        if let Some(span) = span {
            let (lines, hits) = (&rays.lines[..groups], &mut rays.hits[..groups]);
            walk_bundle::<AVX2>(&view.grid, maker.base, lines, span, &mut rays.walkers, hits);
        }
        for g in 0..groups {
            let lines = &rays.lines[g];
            let (mut u, mut v) = (lines.x, lines.y);
            if span.is_some() {
                let w = &rays.hits[g];
                for l in 0..LANES {
                    u[l] = lines.x[l] + lines.sx[l] * w[l];
                    v[l] = lines.y[l] + lines.sy[l] * w[l];
                }
            }
            let mut ends = [0; 3];
            for part in 0..3 {
                ends[part] = (bundle.ends[part] as usize).saturating_sub(g * LANES).min(LANES);
            }
            if !inside {
                misses += view.count_outside(maker.base, &u[..ends[2]], &v[..ends[2]]);
            }
            let cells = Cells::new(&map, &u, &v);
            let texture = &view.texture;
            let Some(order) = bundle.order.filter(|_| bundle.feeds != Feeds::Bare) else {
                let sums = if bundle.feeds == Feeds::Bare { &mut *bare } else { &mut sums };
                cells.add_parts::<AVX2, false>(texture, ends, &Weights::One, sums, &mut unused);
                continue;
            };
            let slab = &scene.slab;
            let [rs, rp] = &camera.reflectance;
            let [ts, tp] = &camera.transmittance;
            let weight = weights(order, [&rs[g], &rp[g]], [&ts[g], &tp[g]]);
            let colour;
            let weights = if slab.absorbs_in(order) {
                let optical_depth = |a: f64| (a * slab.thickness_m) as f32;
                colour = slab
                    .absorption_per_m
                    .map(|a| absorbed(&weight, order, optical_depth(a), &camera.inverse_cos_t[g]));
                Weights::Colour(&colour)
            } else {
                Weights::Grey(&weight)
            };
            if bundle.feeds == Feeds::Both {
                cells.add_parts::<AVX2, true>(texture, ends, &weights, &mut sums, bare);
            } else {
                cells.add_parts::<AVX2, false>(texture, ends, &weights, &mut sums, &mut unused);
            }
        }
        (sums, misses)
    }

    fn count_paths(&mut self, bundle: &Bundle, misses: u64) {
        let layers: &[Layer] = match (bundle.order, bundle.feeds) {
            (Some(Order::Transmitted(_)), Feeds::Both) => &[Layer::Input, Layer::Transmission],
            (Some(Order::Transmitted(_)), Feeds::Bare) => &[Layer::Transmission],
            (Some(Order::Transmitted(_)), Feeds::Order) => &[Layer::Input],
            (Some(Order::Reflected(1..)), _) if self.scene.first_reflection_alone => {
                &[Layer::Input]
            }
            (Some(Order::Reflected(_)), _) => &[Layer::Input, Layer::GlassReflection],
            (None, _) => &[Layer::CleanReflection],
        };
        for &layer in layers {
            self.paths[layer] += u64::from(bundle.ends[2]);
            self.misses[layer] += misses;
        }
    }
}
