//! Traces a bundle: up to sixteen rows of rays. A row is one sample of each of the sixteen pixels of a patch, along one order.
//!
//! Lanes are pixels, so that no lane is idle if pixels take few samples; and weak orders, which take few samples, share bundles, so that the work
//! for a bundle serves many rays.

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
use super::walk::{Group, LaneSpans, Lines, Walkers, approach, walk_bundle};

/// One sample of a chunk along one order (or R's pinhole path).
#[derive(Clone, Copy)]
pub(super) struct Row<'a> {
    /// Number of the sample in the chunk.
    pub(super) sample: usize,
    pub(super) path: Path<'a>,
    /// `None` is R's pinhole path, with weight 1.
    pub(super) order: Option<Order>,
    /// True if the order has the light of those that are not followed, too.
    pub(super) carries_dropped: bool,
}

impl Row<'_> {
    /// True for t_0, which passes the pane where it is clean, or beside it. T sees what it sees.
    #[inline(always)]
    pub(super) fn is_t_0(&self) -> bool {
        self.order == Some(Order::Transmitted(0)) && !matches!(self.path, Path::Smeared(_))
    }
}

/// Rows of a chunk that see one side. t_0 and R share no bundle with other orders.
pub(super) struct Bundle<'a> {
    pub(super) patch: &'a Patch,
    pub(super) camera: &'a CameraChunk,
    pub(super) rows: &'a [Row<'a>],
    /// Number of the group of orders in the scene, and the paths of all its orders.
    pub(super) group: (usize, &'a [Path<'a>]),
    /// Number of samples that each pixel of the patch takes along all paths of the group, in all chunks.
    pub(super) samples: u32,
    pub(super) feeds: Feeds,
    /// Number of the rows in the first quarter of a pixel's samples, in the first half, and in total.
    pub(super) ends: [usize; 3],
}

impl Bundle<'_> {
    /// Returns the order of the first row: `None` for R.
    #[inline(always)]
    pub(super) fn order(&self) -> Option<Order> {
        self.rows[0].order
    }

    /// True for t_0, which is alone.
    #[inline(always)]
    pub(super) fn is_t_0(&self) -> bool {
        self.rows[0].is_t_0()
    }

    /// True if the pane has no closed form of the rays.
    #[inline(always)]
    pub(super) fn is_free(&self) -> bool {
        self.rows[0].path.is_free()
    }

    /// Returns the cards of the side that the bundle sees.
    #[inline(always)]
    pub(super) fn cards<'a>(&self, scene: &'a Scene) -> &'a [Card] {
        let is_back = !matches!(self.order(), Some(Order::Transmitted(_)));
        &scene.cover.cards[usize::from(is_back)]
    }

    /// Returns the places at which the bundle's rays meet the pane's plane.
    #[inline(always)]
    pub(super) fn entries(&self) -> &Entries {
        match self.order() {
            Some(_) => &self.camera.entries,
            None => &self.camera.pinhole_entries,
        }
    }

    /// True if outline, frame or cards may change the bundle's radiance.
    #[inline(always)]
    pub(super) fn is_covered(&self, scene: &Scene) -> bool {
        let cards = self.cards(scene);
        !self.entries().all_glass
            || (!cards.is_empty() && (self.is_free() || self.may_meet(scene, cards)))
    }

    /// True if rays along paths in closed form may meet one of the `cards`.
    fn may_meet(&self, scene: &Scene, cards: &[Card]) -> bool {
        let (_, paths) = self.group;
        paths.iter().any(|path| meets(scene, cards, self.patch, *path))
    }

    /// Returns the points of the rays of a row in the plane z = 0, and their directions (x, y, 1).
    #[inline(always)]
    pub(super) fn rays(&self, scene: &Scene, normal: [f32; 3], row: &Row<'_>) -> [[Lane; 2]; 2] {
        let (Row { path, sample: s, .. }, patch, camera) = (*row, self.patch, self.camera);
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

/// Travel of a bundle's lines in their span, px, above which each of them passes blocks that lie below it.
const TRAVEL_OF_BLOCKS_PX: f32 = 12.0;

/// Lines of a bundle and their hits. All bundles reuse this memory.
pub(super) struct BundleRays {
    lines: [Lines; CHUNK],
    /// Spans of the rays of each row.
    of_rows: [LaneSpans; CHUNK],
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
            of_rows: [LaneSpans::EMPTY; CHUNK],
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
        let count = bundle.rows.len();
        let (lines, w) = (&mut self.lines[..count], &mut self.w[..count]);
        let maker = LineMaker::new(scene, view, bundle.patch, lanes);
        for (row, lines) in bundle.rows.iter().zip(lines.iter_mut()) {
            *lines = maker.lines(bundle.camera, row.path, row.sample);
        }
        let found = match view.pose {
            Pose::Aligned { extra_m } if !bundle.is_free() => {
                spans.of(scene, view, lanes, bundle, extra_m)
            }
            _ => {
                let (span, travel_px) = span_of_lines(view, &lanes.grid, lines);
                if travel_px > TRAVEL_OF_BLOCKS_PX {
                    Found::Spread(span)
                } else {
                    Found::Shared(span.into())
                }
            }
        };
        let is_inside = match found {
            Found::Shared(spans) => {
                let group = Group { lanes: &lanes.grid, spans: &spans };
                walk_bundle::<ISA>(&view.grid, |_| group, lines, &mut self.walkers, w);
                spans.inside
            }
            Found::Spread(span) => {
                let spans = &mut self.of_rows[..count];
                spans.fill(span.into());
                for (spans, lines) in spans.iter_mut().zip(&*lines) {
                    approach(&view.grid, &lanes.grid, lines, spans);
                }
                let of = |g: usize| Group { lanes: &lanes.grid, spans: &spans[g] };
                walk_bundle::<ISA>(&view.grid, of, lines, &mut self.walkers, w);
                span.inside
            }
            Found::OfPixels(pixels) => {
                self.walk_pixels::<ISA>(view, pixels);
                pixels.iter().all(|pixel| pixel.group().spans.inside)
            }
        };
        let is_covered = bundle.is_covered(scene) && self.cover(scene, view, bundle);
        let is_bare = bundle.feeds == Feeds::Bare;
        // Not a closure: the compiler would not inline it, and would compile it for the baseline.
        let factors = match bundle.order() {
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

    /// Returns the inverse depths, 1/m, at which the rays of a bundle's first row hit a sheet.
    pub(super) fn reach<const ISA: u8>(
        &mut self,
        scene: &Scene,
        view: &View,
        lanes: &ViewLanes,
        bundle: &Bundle,
    ) -> Lane {
        let maker = LineMaker::new(scene, view, bundle.patch, lanes);
        let (lines, w) = (&mut self.lines[..1], &mut self.w[..1]);
        lines[0] = maker.lines(bundle.camera, bundle.rows[0].path, bundle.rows[0].sample);
        let spans = span_of_lines(view, &lanes.grid, lines).0.into();
        let group = Group { lanes: &lanes.grid, spans: &spans };
        walk_bundle::<ISA>(&view.grid, |_| group, lines, &mut self.walkers, w);
        w[0]
    }

    /// Finds the effects of outline, frame and cards, from the hits of the bundle's lines. Returns false if there are none.
    #[inline(always)]
    fn cover(&mut self, scene: &Scene, view: &View, bundle: &Bundle) -> bool {
        let is_t_0 = bundle.is_t_0();
        let samples = bundle.rows.iter().map(|row| row.sample);
        self.overlay.begin(&scene.cover, bundle.entries(), is_t_0, samples);
        let mut is_covered = !bundle.entries().all_glass;
        let cards = bundle.cards(scene);
        let normal = scene.slab.normal.as_vec3().to_array();
        for (r, row) in bundle.rows.iter().enumerate().filter(|_| !cards.is_empty()) {
            let [point, direction] = bundle.rays(scene, normal, row);
            let z_m = view_z_m(view, &self.w[r], &point, &direction);
            is_covered |= self.overlay.lay(cards, r, &point, &direction, &z_m);
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

    /// Computes the factors of a bundle's radiance. `order` is that of its first row.
    #[inline(always)]
    fn weigh(&mut self, scene: &Scene, bundle: &Bundle, order: Order) -> Factors {
        let (slab, camera, hits) = (&scene.slab, bundle.camera, &mut *self.hits);
        let is_coloured = match (bundle.rows[0].path, &scene.stack) {
            (Path::Rough(_), _) => camera.rough.is_coloured,
            (Path::Smeared(_), _) => camera.smeared.is_coloured,
            (Path::Stack(_), Some(stack)) => stack.is_coloured(),
            // r_0, which crosses no glass, shares no bundle with others.
            _ => slab.absorbs_in(order) || (bundle.rows[0].carries_dropped && slab.absorbs()),
        };
        for (r, row) in bundle.rows.iter().enumerate() {
            match row.path {
                Path::Rough(way) => hits.take_weights(r, &camera.rough, way, row.sample),
                Path::Smeared(way) => hits.take_weights(r, &camera.smeared, way, row.sample),
                Path::Stack(table) => hits.weigh(r, table, camera, row.sample, is_coloured),
                _ if row.carries_dropped => {
                    hits.set(r, weights_with_dropped(scene, camera, row), is_coloured);
                }
                _ => hits.set(r, weights_alone(scene, camera, row, is_coloured), is_coloured),
            }
        }
        for (r, row) in bundle.rows.iter().enumerate() {
            if let Some(factor) = smudge_factor(scene, camera, row) {
                hits.scale(r, &factor, is_coloured);
            }
        }
        if bundle.is_t_0() && !camera.entries.all_glass {
            for (r, row) in bundle.rows.iter().enumerate() {
                hits.pass_beside(r, &camera.entries.glass[row.sample]);
            }
        }
        if is_coloured { Factors::Colour } else { Factors::Grey }
    }
}

/// Returns the factor of smudges in the weights of a row; `None` if no ray of the chunk meets any.
#[inline(always)]
pub(super) fn smudge_factor(scene: &Scene, camera: &CameraChunk, row: &Row<'_>) -> Option<Lane> {
    let smeared = scene.smeared.as_ref().filter(|_| camera.meets_smudges)?;
    let is_smeared = matches!(row.path, Path::Smeared(_));
    let side = usize::from(matches!(row.order, Some(Order::Reflected(_))));
    Some(smeared.smudges.factor(is_smeared, side, &camera.shares[row.sample]))
}

/// Computes the weights of an order of a single layer for a row: red, green, blue. Without colours, all are that of red.
#[inline(always)]
pub(super) fn weights_alone(
    scene: &Scene,
    camera: &CameraChunk,
    row: &Row<'_>,
    is_coloured: bool,
) -> [Lane; 3] {
    let (slab, s) = (&scene.slab, row.sample);
    let Some(order) = row.order else { return [[1.0; LANES]; 3] };
    let ([rs, rp], [ts, tp]) = (&camera.reflectance, &camera.transmittance);
    let (weight, inverse_cos_t) = if scene.bow.is_some() {
        (camera.bent.weights(order, s), camera.bent.inverse_cos_t(s))
    } else {
        let weight = weights(order, [&rs[s], &rp[s]], [&ts[s], &tp[s]]);
        (weight, &camera.inverse_cos_t[s])
    };
    let mut colours = [weight; 3];
    for c in 0..if is_coloured { 3 } else { 0 } {
        let optical_depth = (slab.absorption_per_m[c] * slab.thickness_m) as f32;
        colours[c] = absorbed(&weight, order, optical_depth, inverse_cos_t);
    }
    colours
}

/// Computes the weights of an order of a single layer for a row, with those of all longer ones: red, green, blue.
#[inline(always)]
pub(super) fn weights_with_dropped(
    scene: &Scene,
    camera: &CameraChunk,
    row: &Row<'_>,
) -> [Lane; 3] {
    let (slab, is_bent, s) = (&scene.slab, scene.bow.is_some(), row.sample);
    let Some(order) = row.order else { return [[1.0; LANES]; 3] };
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
