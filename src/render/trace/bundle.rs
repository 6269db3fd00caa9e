//! Traces a bundle: the rays of up to sixteen samples of the sixteen pixels of a patch, along one order.
//!
//! Lanes are pixels, so that no lane is idle if pixels take few samples.

use super::camera::{CHUNK, CameraChunk};
use super::fetch::{Factors, Hits};
use super::lanes::{LANES, Lane};
use super::lines::{LineMaker, Path, ViewLanes, span_of_lines};
use super::means::LaneSums;
use super::patch::Patch;
use super::scene::{Pose, Scene, View};
use super::shade::{absorbed, weights};
use super::slab::Order;
use super::spans::{Found, OfPixel, Spans};
use super::walk::{Group, Lines, Walkers, walk_bundle};

/// Samples of a chunk along one order (or R's pinhole path).
pub(super) struct Bundle<'a> {
    pub(super) patch: &'a Patch,
    pub(super) camera: &'a CameraChunk,
    pub(super) path: Path<'a>,
    /// Number of the path in the scene.
    pub(super) number: usize,
    /// Number of samples that each pixel of the patch takes along this path, in all chunks.
    pub(super) samples: u32,
    /// `None` is R's pinhole path, with weight 1.
    pub(super) order: Option<Order>,
    pub(super) feeds: Feeds,
    /// Number of the chunk's samples in the first quarter of a pixel's samples, in the first half, and in total.
    pub(super) ends: [usize; 3],
}

/// Sums that receive a bundle's radiance.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Feeds {
    /// The order's weighted sum, or the sum of R.
    Order,
    /// For t_0: the unweighted sum of T.
    Bare,
    /// For t_0: both sums.
    Both,
}

/// Lines of a bundle and their hits. All bundles reuse this memory.
pub(super) struct BundleRays {
    lines: [Lines; CHUNK],
    /// The same lines with the samples of one pixel in a group.
    of_pixels: [Lines; LANES],
    /// Inverse depths of the hits, 1/m.
    w: [Lane; CHUNK],
    walkers: Walkers,
    hits: Box<Hits>,
}

impl BundleRays {
    pub(super) fn new() -> Box<Self> {
        Box::new(Self {
            lines: [Lines::ZERO; CHUNK],
            of_pixels: [Lines::ZERO; LANES],
            w: [[0.0; LANES]; CHUNK],
            walkers: Walkers::new(),
            hits: Hits::new(),
        })
    }

    /// Traces a bundle against a sheet. Adds its weighted radiance to the first sums, or the radiance of T to the second.
    /// Returns each pixel's number of misses.
    #[inline(always)]
    pub(super) fn follow<const AVX2: bool>(
        &mut self,
        scene: &Scene,
        view: &View,
        lanes: &ViewLanes,
        bundle: &Bundle,
        spans: &mut Spans,
        [sums, bare]: [&mut LaneSums; 2],
    ) -> [u32; LANES] {
        let count = bundle.ends[2];
        let (lines, w) = (&mut self.lines[..count], &mut self.w[..count]);
        let maker = LineMaker::new(scene, view, bundle.patch, lanes, bundle.path);
        for (s, lines) in lines.iter_mut().enumerate() {
            *lines = maker.lines(bundle.camera, s);
        }
        let found = match view.pose {
            Pose::Aligned { extra_m } => spans.of(scene, view, lanes, bundle, extra_m),
            Pose::General { .. } => Found::Shared(span_of_lines(view, &lanes.grid, lines).into()),
        };
        let is_inside = match found {
            Found::Shared(spans) => {
                let group = Group { lanes: &lanes.grid, spans: &spans };
                walk_bundle::<AVX2>(&view.grid, |_| group, lines, &mut self.walkers, w);
                spans.inside
            }
            Found::OfPixels(pixels) => {
                self.walk_pixels::<AVX2>(view, pixels);
                pixels.iter().all(|pixel| pixel.group().spans.inside)
            }
        };
        let is_bare = bundle.feeds == Feeds::Bare;
        let order = bundle.order.filter(|_| !is_bare);
        let factors = order.map_or(Factors::One, |order| self.weigh(scene, bundle, order));
        let mut misses = [0; LANES];
        for s in 0..count {
            let lines = &self.lines[s];
            let w = &self.w[s];
            let (mut u, mut v) = (lines.x, lines.y);
            for l in 0..LANES {
                u[l] += lines.sx[l] * w[l];
                v[l] += lines.sy[l] * w[l];
            }
            if !is_inside {
                lanes.count_outside(view, &u, &v, &mut misses);
            }
            if factors == Factors::Grey && bundle.feeds == Feeds::Order {
                self.hits.locate::<true>(&lanes.texels, s, &u, &v);
            } else {
                self.hits.locate::<false>(&lanes.texels, s, &u, &v);
            }
        }
        let (hits, texture, ends) = (&*self.hits, &view.texture, bundle.ends);
        match bundle.feeds {
            Feeds::Order => hits.add::<AVX2, false>(texture, ends, factors, sums, bare),
            Feeds::Bare => hits.add::<AVX2, false>(texture, ends, factors, bare, sums),
            Feeds::Both => hits.add::<AVX2, true>(texture, ends, factors, sums, bare),
        }
        misses
    }

    /// Walks the lines of a full chunk with the samples of one pixel in the lanes of a group: rays of one pixel cross about the
    /// same cells.
    #[inline(always)]
    fn walk_pixels<const AVX2: bool>(&mut self, view: &View, pixels: &[OfPixel; LANES]) {
        for s in 0..CHUNK {
            for l in 0..LANES {
                let (from, to) = (&self.lines[s], &mut self.of_pixels[l]);
                to.x[s] = from.x[l];
                to.y[s] = from.y[l];
                to.sx[s] = from.sx[l];
                to.sy[s] = from.sy[l];
            }
        }
        let mut w = [[0.0; LANES]; CHUNK];
        let of = |l: usize| pixels[l].group();
        walk_bundle::<AVX2>(&view.grid, of, &self.of_pixels, &mut self.walkers, &mut w);
        for s in 0..CHUNK {
            for l in 0..LANES {
                self.w[s][l] = w[l][s];
            }
        }
    }

    /// Computes the factors of a bundle's radiance.
    #[inline(always)]
    fn weigh(&mut self, scene: &Scene, bundle: &Bundle, order: Order) -> Factors {
        let (slab, camera, hits) = (&scene.slab, bundle.camera, &mut *self.hits);
        if let (Path::Stack(table), Some(stack)) = (bundle.path, &scene.stack) {
            return hits.weigh(table, camera, bundle.ends[2], stack.is_coloured());
        }
        let ([rs, rp], [ts, tp]) = (&camera.reflectance, &camera.transmittance);
        let absorbs = slab.absorbs_in(order);
        for s in 0..bundle.ends[2] {
            let weight = weights(order, [&rs[s], &rp[s]], [&ts[s], &tp[s]]);
            hits.grey[s] = weight;
            for c in 0..if absorbs { 3 } else { 0 } {
                let optical_depth = (slab.absorption_per_m[c] * slab.thickness_m) as f32;
                let colour = absorbed(&weight, order, optical_depth, &camera.inverse_cos_t[s]);
                (0..LANES).for_each(|l| hits.colour[s][l][c] = colour[l]);
            }
        }
        if absorbs { Factors::Colour } else { Factors::Grey }
    }
}
