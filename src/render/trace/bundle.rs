//! Traces a bundle: the rays of up to sixteen samples of the sixteen pixels of a patch, along one order.
//!
//! Lanes are pixels, so that no lane is idle if pixels take few samples.

use super::camera::CameraChunk;
use super::cover::{Card, Entries};
use super::fetch::{Factors, Hits};
use super::lanes::{CHUNK, LANES, Lane};
use super::lines::{LineMaker, Path, ViewLanes, points, span_of_lines};
use super::means::LaneSums;
use super::overlay::{Overlay, meets};
use super::patch::Patch;
use super::scene::{Pose, Scene, View};
use super::shade::{absorbed, weights, weights_to_the_end};
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
    /// True if the order has the light of those that are not followed, too.
    pub(super) carries_dropped: bool,
    pub(super) feeds: Feeds,
    /// Number of the chunk's samples in the first quarter of a pixel's samples, in the first half, and in total.
    pub(super) ends: [usize; 3],
}

impl Bundle<'_> {
    /// Returns the cards of the side that the bundle sees.
    #[inline(always)]
    pub(super) fn cards<'a>(&self, scene: &'a Scene) -> &'a [Card] {
        let is_back = !matches!(self.order, Some(Order::Transmitted(_)));
        &scene.cover.cards[usize::from(is_back)]
    }

    /// Returns the places at which the bundle's rays meet the pane's plane.
    #[inline(always)]
    pub(super) fn entries(&self) -> &Entries {
        match self.order {
            Some(_) => &self.camera.entries,
            None => &self.camera.pinhole_entries,
        }
    }

    /// True if outline, frame or cards may change the bundle's radiance.
    #[inline(always)]
    pub(super) fn is_covered(&self, scene: &Scene) -> bool {
        !self.entries().all_glass || meets(scene, self.cards(scene), self.patch, self.path)
    }

    /// Returns the points of the rays of sample `s` in the plane z = 0, and their directions (x, y, 1).
    #[inline(always)]
    pub(super) fn rays(&self, scene: &Scene, normal: [f32; 3], s: usize) -> [[Lane; 2]; 2] {
        let (path, patch, camera) = (self.path, self.patch, self.camera);
        let free = path.free_rays(&scene.slab, patch, camera, s);
        let (point, relative) = if let Some(rays) = free {
            (rays.point, rays.relative)
        } else {
            let relative =
                if matches!(path, Path::Pinhole) { &camera.film } else { &camera.direction };
            (points(path, &patch.center, normal, camera, s), [relative[0][s], relative[1][s]])
        };
        let mut direction = patch.center;
        for k in 0..2 {
            for l in 0..LANES {
                direction[k][l] += relative[k][l];
            }
        }
        [point, direction]
    }
}

/// Converts inverse depths in a view to z in the lens's coordinates, for rays with these points in the plane z = 0 and
/// directions (x, y, 1).
#[inline(always)]
fn view_z_m(view: &View, w: &Lane, point: &[Lane; 2], direction: &[Lane; 2]) -> Lane {
    let mut z_m = [0.0; LANES];
    match &view.pose {
        Pose::Aligned { extra_m } => {
            for l in 0..LANES {
                z_m[l] = 1.0 / w[l] + *extra_m as f32;
            }
        }
        Pose::General { rotation, translation_m } => {
            let (m, t) = (rotation.as_mat3(), translation_m.as_vec3());
            for l in 0..LANES {
                let start = m.x_axis.z * point[0][l] + m.y_axis.z * point[1][l] + t.z;
                let along =
                    m.x_axis.z * direction[0][l] + m.y_axis.z * direction[1][l] + m.z_axis.z;
                let z = (1.0 / w[l] - start) / along;
                z_m[l] = if w[l] > 0.0 { z } else { f32::INFINITY };
            }
        }
    }
    z_m
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
    overlay: Box<Overlay>,
}

impl BundleRays {
    pub(super) fn new() -> Box<Self> {
        Box::new(Self {
            lines: [Lines::ZERO; CHUNK],
            of_pixels: [Lines::ZERO; LANES],
            w: [[0.0; LANES]; CHUNK],
            walkers: Walkers::new(),
            hits: Hits::new(),
            overlay: Overlay::new(),
        })
    }

    /// Traces a bundle against a sheet. Adds its weighted radiance to the first sums, or the radiance of T to the second.
    /// Returns each pixel's number of misses.
    #[inline(always)]
    pub(super) fn follow<const ISA: u8>(
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
            Pose::Aligned { extra_m } if !bundle.path.is_free() => {
                spans.of(scene, view, lanes, bundle, extra_m)
            }
            _ => Found::Shared(span_of_lines(view, &lanes.grid, lines).into()),
        };
        let is_inside = match found {
            Found::Shared(spans) => {
                let group = Group { lanes: &lanes.grid, spans: &spans };
                walk_bundle::<ISA>(&view.grid, |_| group, lines, &mut self.walkers, w);
                spans.inside
            }
            Found::OfPixels(pixels) => {
                self.walk_pixels::<ISA>(view, pixels);
                pixels.iter().all(|pixel| pixel.group().spans.inside)
            }
        };
        let is_covered = bundle.is_covered(scene) && self.cover(scene, view, bundle);
        let is_bare = bundle.feeds == Feeds::Bare;
        // Not a closure: the compiler would not inline it, and would compile it for the baseline.
        let factors = match bundle.order {
            Some(order) if !is_bare => self.weigh(scene, bundle, order),
            _ => Factors::One,
        };
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
                let through = is_covered.then_some(&self.overlay.through[s]);
                lanes.count_outside(view, [&u, &v], through, &mut misses);
            }
            if factors == Factors::Grey && bundle.feeds == Feeds::Order {
                self.hits.locate::<true>(&lanes.texels, s, &u, &v);
            } else {
                self.hits.locate::<false>(&lanes.texels, s, &u, &v);
            }
            if is_covered {
                self.hits.dim(s, &self.overlay.through[s]);
            }
        }
        let (hits, texture, ends) = (&*self.hits, &view.texture, bundle.ends);
        if is_covered {
            match bundle.feeds {
                Feeds::Order => self.overlay.add(hits, factors, ends, sums, None),
                Feeds::Bare => self.overlay.add(hits, factors, ends, bare, None),
                Feeds::Both => self.overlay.add(hits, factors, ends, sums, Some(&mut *bare)),
            }
        }
        match bundle.feeds {
            Feeds::Order => hits.add::<ISA, false>(texture, ends, factors, sums, bare),
            Feeds::Bare => hits.add::<ISA, false>(texture, ends, factors, bare, sums),
            Feeds::Both => hits.add::<ISA, true>(texture, ends, factors, sums, bare),
        }
        misses
    }

    /// Returns the inverse depths, 1/m, at which the rays of a bundle's first sample hit a sheet.
    pub(super) fn reach<const ISA: u8>(
        &mut self,
        scene: &Scene,
        view: &View,
        lanes: &ViewLanes,
        bundle: &Bundle,
    ) -> Lane {
        let maker = LineMaker::new(scene, view, bundle.patch, lanes, bundle.path);
        let (lines, w) = (&mut self.lines[..1], &mut self.w[..1]);
        lines[0] = maker.lines(bundle.camera, 0);
        let spans = span_of_lines(view, &lanes.grid, lines).into();
        let group = Group { lanes: &lanes.grid, spans: &spans };
        walk_bundle::<ISA>(&view.grid, |_| group, lines, &mut self.walkers, w);
        w[0]
    }

    /// Finds the effects of outline, frame and cards, from the hits of the bundle's lines. Returns false if there are none.
    #[inline(always)]
    fn cover(&mut self, scene: &Scene, view: &View, bundle: &Bundle) -> bool {
        let count = bundle.ends[2];
        self.overlay.begin(&scene.cover, bundle.entries(), bundle.order, count);
        let mut is_covered = !bundle.entries().all_glass;
        let cards = bundle.cards(scene);
        let normal = scene.slab.normal.as_vec3().to_array();
        for s in 0..if cards.is_empty() { 0 } else { count } {
            let [point, direction] = bundle.rays(scene, normal, s);
            let z_m = view_z_m(view, &self.w[s], &point, &direction);
            is_covered |= self.overlay.lay(cards, s, &point, &direction, &z_m);
        }
        is_covered
    }

    /// Walks the lines of a full chunk with the samples of one pixel in the lanes of a group: rays of one pixel cross about the
    /// same cells.
    #[inline(always)]
    fn walk_pixels<const ISA: u8>(&mut self, view: &View, pixels: &[OfPixel; LANES]) {
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
        walk_bundle::<ISA>(&view.grid, of, &self.of_pixels, &mut self.walkers, &mut w);
        for s in 0..CHUNK {
            for l in 0..LANES {
                self.w[s][l] = w[l][s];
            }
        }
    }

    /// Computes the factors of a bundle's radiance.
    #[inline(always)]
    fn weigh(&mut self, scene: &Scene, bundle: &Bundle, order: Order) -> Factors {
        let factors = self.weigh_in_glass(scene, bundle, order);
        if order == Order::Transmitted(0) && !bundle.camera.entries.all_glass {
            self.hits.pass_beside(&bundle.camera.entries.glass[..bundle.ends[2]]);
        }
        factors
    }

    #[inline(always)]
    fn weigh_in_glass(&mut self, scene: &Scene, bundle: &Bundle, order: Order) -> Factors {
        let (slab, camera, hits) = (&scene.slab, bundle.camera, &mut *self.hits);
        if let Path::Rough(way) = bundle.path {
            return hits.take_weights(&camera.rough, way, bundle.ends[2]);
        }
        if let (Path::Stack(table), Some(stack)) = (bundle.path, &scene.stack) {
            return hits.weigh(table, camera, bundle.ends[2], stack.is_coloured());
        }
        let ([rs, rp], [ts, tp]) = (&camera.reflectance, &camera.transmittance);
        if bundle.carries_dropped {
            return self.weigh_to_the_end(scene, bundle, order);
        }
        let (absorbs, is_bent) = (slab.absorbs_in(order), scene.bow.is_some());
        for s in 0..bundle.ends[2] {
            let (weight, inverse_cos_t) = if is_bent {
                (camera.bent.weights(order, s), camera.bent.inverse_cos_t(s))
            } else {
                let weight = weights(order, [&rs[s], &rp[s]], [&ts[s], &tp[s]]);
                (weight, &camera.inverse_cos_t[s])
            };
            hits.grey[s] = weight;
            for c in 0..if absorbs { 3 } else { 0 } {
                let optical_depth = (slab.absorption_per_m[c] * slab.thickness_m) as f32;
                let colour = absorbed(&weight, order, optical_depth, inverse_cos_t);
                for l in 0..LANES {
                    hits.colour[s][l][c] = colour[l];
                }
            }
        }
        if absorbs { Factors::Colour } else { Factors::Grey }
    }

    /// Computes the factors of an order that has the light of all longer ones.
    #[inline(always)]
    fn weigh_to_the_end(&mut self, scene: &Scene, bundle: &Bundle, order: Order) -> Factors {
        let (absorbs, hits) = (scene.slab.absorbs(), &mut *self.hits);
        for s in 0..bundle.ends[2] {
            let [red, green, blue] = weights_with_dropped(scene, bundle.camera, order, s);
            if !absorbs {
                hits.grey[s] = red;
                continue;
            }
            for l in 0..LANES {
                hits.colour[s][l] = [red[l], green[l], blue[l], 0.0];
            }
        }
        if absorbs { Factors::Colour } else { Factors::Grey }
    }
}

/// Computes the weights of an order of a single layer for sample `s`, with those of all longer ones: red, green, blue.
#[inline(always)]
pub(super) fn weights_with_dropped(
    scene: &Scene,
    camera: &CameraChunk,
    order: Order,
    s: usize,
) -> [Lane; 3] {
    let (slab, is_bent) = (&scene.slab, scene.bow.is_some());
    let ([rs, rp], [ts, tp]) = (&camera.reflectance, &camera.transmittance);
    let weights = |tau: &Lane| {
        if is_bent {
            return camera.bent.weights_to_the_end(order, s, tau);
        }
        let (r, t) = ([&rs[s], &rp[s]], [&ts[s], &tp[s]]);
        weights_to_the_end(order, [r; 2], [t; 2], tau)
    };
    if !slab.absorbs() {
        return [weights(&[1.0; LANES]); 3];
    }
    let inverse_cos_t =
        if is_bent { camera.bent.inverse_cos_t(s) } else { &camera.inverse_cos_t[s] };
    slab.absorption_per_m.map(|a| {
        let optical_depth = (a * slab.thickness_m) as f32;
        let once = absorbed(&[1.0; LANES], Order::Transmitted(0), optical_depth, inverse_cos_t);
        weights(&once)
    })
}
