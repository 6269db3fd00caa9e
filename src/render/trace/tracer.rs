//! The estimator: traces the pixels of a patch in bundles, and computes the four layers from the same camera samples.
//!
//! ```text
//! camera sample s = (film point, lens point)                       -> ray
//! T  = mean over s of F(t_0 line)                                  (virtual glass: bent, weight 1)
//! F_ = sum over orders k of mean over s of weight_k(s) F(t_k line)
//! R~ = sum over orders k of mean over s of weight_k(s) B(r_k line)
//! I  = F_ + R~             (with `first_reflection_alone`, I has all orders of R~, but the layer R~ only r_0)
//! R  = mean over film points of B(mirrored pinhole ray)            (no glass, no lens; see also `closed`)
//! ```
//!
//! F and B are the radiances of the front and the back photograph at the line's first hit with the sheet (or mesh) of
//! each. A path ends at this hit, because a photograph has the radiance that leaves the surface (Eq. 1 of the paper).
//!
//! A bundle is up to sixteen rays of each of the sixteen pixels of a patch, along the orders of a group ([`super::groups`]).

use super::balance::{Balance, Blocks};
use super::bundle::{Bundle, BundleRays, Feeds, Row};
use super::camera::CameraChunk;
use super::groups::{Group, Groups};
use super::isa::Isa;
use super::lanes::{CHUNK, LANES};
use super::lines::{Path, ViewLanes};
use super::means::{
    Components, LaneSums, Means, NO_SUMS, NOTHING, Wanted, add_means_of, ends_in_block,
};
use super::mesh;
use super::patch::Patch;
use super::rough::RoughPane;
use super::sampler::BLOCK;
use super::scene::{Scene, Surface};
use super::slab::Order;
use super::spans::Spans;

use glasshouse_line::label::Label;
use glasshouse_line::layer::{Layer, PerLayer};
use std::ops::Range;

/// Tracer of a scene's patches, with counts of their paths.
///
/// `ISA` selects the kernels; only functions compiled for an instruction set name it.
pub(super) struct Tracer<'a, const ISA: u8> {
    scene: &'a Scene,
    /// What the patches of the current zone are traced along, and that of zones before.
    plan: Plan<'a>,
    others: Vec<Plan<'a>>,
    camera: Box<CameraChunk>,
    rays: Box<BundleRays>,
    spans: Spans,
    /// Rows of the current chunk and group.
    rows: Vec<Row<'a>>,
    /// Sums of the current block of samples: of the groups of the front and of the back, of T and of R.
    sums: Vec<LaneSums>,
    /// Sums of all blocks, in the same order.
    totals: Vec<LaneSums>,
    /// Number of samples of the current chunk along each way through rough faces, of the clean pane and of that under smudges.
    taken: [Vec<usize>; 2],
    /// Components of the newest patch's pixels.
    components: Box<[Components; LANES]>,
    paths: PerLayer<u64>,
    misses: PerLayer<u64>,
}

/// What zones of one kind are traced along.
struct Plan<'a> {
    kind: usize,
    groups: Groups<'a>,
    /// Balances of the clean pane and of that under smudges, if they have facets.
    balances: [Option<Balance>; 2],
}

impl<'a> Plan<'a> {
    fn new(scene: &'a Scene, kind: usize) -> Self {
        let groups = Groups::new(scene, kind);
        let panes = [scene.rough.as_ref(), scene.smeared.as_ref().map(|smeared| &smeared.pane)];
        let balances = [0, 1].map(|k: usize| {
            let _ = panes[k].filter(|pane| pane.has_facets())?;
            Balance::new(groups.ways(k == 1))
        });
        Self { kind, groups, balances }
    }
}

/// A patch, the coordinates of the views of the front and of the back for it (`None` for a mesh), and the pixels that count.
struct Place {
    patch: Patch,
    views: [Option<ViewLanes>; 2],
    live: [bool; LANES],
}

/// What a chunk is traced along.
#[derive(Clone, Copy)]
enum Followed {
    /// A group of a side, by its number.
    Orders(usize, usize),
    /// The path of T.
    Bare,
    /// The path of R.
    Clean,
}

/// Sizes of a range of samples: their number, the number of a block and of R's.
#[derive(Clone, Copy)]
struct Counts {
    all: u32,
    block: u32,
    clean: u32,
}

impl Counts {
    /// Returns the blocks of the range.
    fn blocks(self) -> Blocks {
        Blocks { count: self.all / self.block, samples: self.block }
    }

    /// Returns the number of samples of an order in a chunk that are in the first quarter, in the first half and in all of its samples.
    /// `before` is the first sample of the chunk's block, and `first` its own.
    #[inline(always)]
    fn ends(self, group: &Group<'_>, [before, first]: [u32; 2]) -> [usize; 3] {
        let of_block = group.samples_of_block(self.block);
        let within = |end: u32| end.saturating_sub(first - before).min(CHUNK as u32) as usize;
        ends_in_block(of_block, before / self.block, self.all / self.block).map(within)
    }
}

impl<'a, const ISA: u8> Tracer<'a, ISA> {
    pub(super) fn new(scene: &'a Scene) -> Self {
        let panes = [scene.rough.as_ref(), scene.smeared.as_ref().map(|smeared| &smeared.pane)];
        Self {
            scene,
            plan: Plan::new(scene, 0),
            others: vec![],
            camera: CameraChunk::new(),
            rays: BundleRays::new(),
            spans: Spans::new(scene),
            rows: vec![],
            sums: vec![],
            totals: vec![],
            taken: panes.map(|pane| vec![0; pane.map_or(0, RoughPane::ways)]),
            components: Box::new([Components::default(); LANES]),
            paths: PerLayer::default(),
            misses: PerLayer::default(),
        }
    }

    /// Returns the numbers of paths and misses of the layers so far.
    pub(super) fn counts(&self) -> (PerLayer<u64>, PerLayer<u64>) {
        (self.paths, self.misses)
    }

    /// Traces the `wanted` components of the patch at (`x`, `y`) with `samples`, an aligned power-of-two block. R takes only
    /// the first `clean` samples of the block. Paths of lanes without a pixel are not counted.
    #[inline(always)]
    pub(super) fn patch(
        &mut self,
        (x, y): (u32, u32),
        pixels: &[Option<usize>; LANES],
        samples: &Range<u32>,
        clean: u32,
        wanted: Wanted,
    ) -> &[Components; LANES] {
        let scene = self.scene;
        self.enter(scene.zones.kind(x, y));
        let live = pixels.map(|pixel| pixel.is_some());
        let patch = Patch::new(scene, x, y);
        let views = [&scene.front, &scene.back].map(|surface| match surface {
            Surface::Sheet(view) => Some(ViewLanes::new(view, &patch)),
            Surface::Mesh(_) => None,
        });
        let place = Place { patch, views, live };
        let all = samples.end - samples.start;
        let counts = Counts { all, block: all.min(BLOCK as u32), clean };
        if counts.block < all {
            self.totals.fill(NO_SUMS);
        }
        for before in (0..all).step_by(counts.block as usize) {
            self.sums.fill(NO_SUMS);
            self.plan.balances.iter_mut().flatten().for_each(Balance::begin);
            for first in (before..before + counts.block).step_by(CHUNK) {
                let taken = counts.block.min(CHUNK as u32);
                self.camera.fill(scene, &place.patch, samples.start + first, taken as usize);
                self.follow_orders(&place, wanted, counts, [before, first]);
                if wanted.clean {
                    let within = |end: u32| end.saturating_sub(first).min(taken) as usize;
                    let ends = [clean / 4, clean / 2, clean].map(within);
                    self.follow(&place, Followed::Clean, Feeds::Order, clean, ends);
                }
            }
            self.balance(counts, before / counts.block);
            if counts.block == all {
                std::mem::swap(&mut self.totals, &mut self.sums);
                break;
            }
            for (total, sums) in self.totals.iter_mut().zip(&self.sums) {
                let total = total.as_flattened_mut().as_flattened_mut();
                for (total, sum) in total.iter_mut().zip(sums.as_flattened().as_flattened()) {
                    *total += sum;
                }
            }
        }
        for l in 0..LANES {
            self.components[l] = self.components_of(l, counts);
        }
        &self.components
    }

    /// Enters a zone of this kind.
    fn enter(&mut self, kind: usize) {
        if self.plan.kind != kind {
            let known = self.others.iter().position(|plan| plan.kind == kind);
            let plan = match known {
                Some(index) => self.others.swap_remove(index),
                None => Plan::new(self.scene, kind),
            };
            self.others.push(std::mem::replace(&mut self.plan, plan));
        }
        let sums = self.plan.groups.count();
        self.sums.resize(sums, NO_SUMS);
        self.totals.resize(sums, NO_SUMS);
    }

    /// Balances the sums of a block of samples.
    #[inline(always)]
    fn balance(&mut self, counts: Counts, block: u32) {
        self.plan.balances.iter_mut().flatten().for_each(|of| of.end((counts.blocks(), block)));
        let groups = self.plan.groups.sides.iter().flatten();
        for (group, sums) in groups.zip(&mut self.sums) {
            let balance = match group.paths[0] {
                Path::Rough(_) => &self.plan.balances[0],
                Path::Smeared(_) => &self.plan.balances[1],
                _ => continue,
            };
            if let Some(balance) = balance {
                balance.scale(group.thinning, sums);
            }
        }
    }

    /// Traces the current chunk along the orders of the glass. `before` is the first sample of its block, and `first` its own,
    /// both counted from the start of the range.
    #[inline(always)]
    fn follow_orders(
        &mut self,
        place: &Place,
        wanted: Wanted,
        counts: Counts,
        [before, first]: [u32; 2],
    ) {
        let scene = self.scene;
        let blocks = counts.all / counts.block;
        // T needs only the first group of the front, t_0.
        let of_front = match (wanted.front, wanted.bare) {
            (true, _) => self.plan.groups.sides[0].len(),
            (false, bare) => usize::from(bare),
        };
        let of_back = self.plan.groups.sides[1].len() * usize::from(wanted.back);
        let ends_of = |group: &Group<'_>| counts.ends(group, [before, first]);
        let mut taken = std::mem::take(&mut self.taken);
        for taken in &mut taken {
            taken.fill(0);
        }
        // A balance of orders that are wanted needs the weights of all.
        let balanced =
            [0, 1].map(|k: usize| self.plan.balances[k].is_some() && (wanted.front || wanted.back));
        let [front, back] = &self.plan.groups.sides;
        for (side, groups) in [front, back].into_iter().enumerate() {
            for (index, group) in groups.iter().enumerate() {
                let is_wanted = index < [of_front, of_back][side];
                for path in &group.paths {
                    match path {
                        Path::Rough(way) if is_wanted || balanced[0] => {
                            taken[0][*way] = ends_of(group)[2];
                        }
                        Path::Smeared(way) if is_wanted || balanced[1] => {
                            taken[1][*way] = ends_of(group)[2];
                        }
                        _ => {}
                    }
                }
            }
        }
        let isa = Isa::numbered(ISA);
        if let Some(pane) = &scene.rough {
            if let (Some(way), true) = (pane.straight(), wanted.bare) {
                taken[0][way] = ends_of(&self.plan.groups.bare)[2];
            }
            pane.serve_rests(&mut taken[0]);
            self.camera.scatter(scene, pane, &place.patch, &taken[0], isa);
        }
        if let Some(smeared) = &scene.smeared {
            smeared.pane.serve_rests(&mut taken[1]);
            self.camera.smear(scene, smeared, &place.patch, &taken[1], isa);
        }
        self.taken = taken;
        let camera = &self.camera;
        let shares = camera.meets_smudges.then_some(&camera.shares);
        let chunk = ((first - before) as usize, counts.block.min(CHUNK as u32) as usize);
        let [clean, smeared] = &mut self.plan.balances;
        if let Some(balance) = clean.as_mut().filter(|_| balanced[0]) {
            balance.add(&camera.rough, None, (counts.blocks(), before / counts.block), chunk);
        }
        if let Some(balance) = smeared.as_mut().filter(|_| balanced[1] && shares.is_some()) {
            balance.add(&camera.smeared, shares, (counts.blocks(), before / counts.block), chunk);
        }
        for (side, count) in [of_front, of_back].into_iter().enumerate() {
            for index in 0..count {
                let group = &self.plan.groups.sides[side][index];
                let ends = ends_of(group);
                let samples = group.samples_of_block(counts.block) * blocks;
                let is_t_0 = group.is_t_0();
                let shares_t_0 = scene.rough.as_ref().is_none_or(RoughPane::shares_t_0);
                let feeds = match (is_t_0, wanted.front, wanted.bare) {
                    // T sees through the smooth pane.
                    (true, is_wanted, bare) if !shares_t_0 => {
                        if bare {
                            self.follow(place, Followed::Bare, Feeds::Bare, samples, ends);
                        }
                        if !is_wanted {
                            continue;
                        }
                        Feeds::Order
                    }
                    // T receives t_0 even if the scene does not request T: the request must not affect I's bits.
                    (true, true, _) => Feeds::Both,
                    (true, false, true) => Feeds::Bare,
                    _ => Feeds::Order,
                };
                self.follow(place, Followed::Orders(side, index), feeds, samples, ends);
            }
        }
    }

    /// Traces the current chunk along the paths of a group, and adds its radiance to the sums of it. A pixel takes `samples` along each of its
    /// paths in all chunks, and those up to `ends` in this one.
    #[inline(always)]
    fn follow(
        &mut self,
        place: &Place,
        followed: Followed,
        feeds: Feeds,
        samples: u32,
        ends: [usize; 3],
    ) {
        if ends[2] == 0 {
            return;
        }
        let scene = self.scene;
        let [front, back] = &self.plan.groups.sides;
        let (number, group) = match followed {
            Followed::Orders(0, index) => (index, &front[index]),
            Followed::Orders(_, index) => (front.len() + index, &back[index]),
            Followed::Bare => (self.sums.len() - 2, &self.plan.groups.bare),
            Followed::Clean => (self.sums.len() - 1, &self.plan.groups.clean),
        };
        let (order, orders) = (group.rows[0].order, group.rows.len());
        let is_hidden = match order {
            _ if group.is_t_0() => false,
            Some(_) => {
                !self.camera.entries.any_glass || (group.is_smeared && !self.camera.meets_smudges)
            }
            None => !self.camera.pinhole_entries.any_glass,
        };
        if is_hidden {
            self.count_paths(place, order, feeds, orders * ends[2], &[0; LANES]);
            return;
        }
        let side = usize::from(!matches!(order, Some(Order::Transmitted(_))));
        group.list(ends, &mut self.rows);
        let bare = self.sums.len() - 2;
        let sums = if feeds == Feeds::Bare { 0 } else { number };
        let [sums, bare] = self.sums.get_disjoint_mut([sums, bare]).expect("T has its own sums");
        let mut misses = [0; LANES];
        for (k, rows) in self.rows.chunks(CHUNK).enumerate() {
            let start = k * CHUNK;
            let within = |end: usize| (orders * end).saturating_sub(start).min(rows.len());
            let bundle = Bundle {
                patch: &place.patch,
                camera: &self.camera,
                rows,
                group: (number, &group.paths),
                samples: samples * orders as u32,
                feeds,
                ends: [within(ends[0]), within(ends[1]), within(ends[2])],
            };
            let missed = match ([&scene.front, &scene.back][side], &place.views[side]) {
                (Surface::Sheet(view), Some(lanes)) => {
                    let (spans, rays) = (&mut self.spans, &mut self.rays);
                    rays.follow::<ISA>(scene, view, lanes, &bundle, spans, [&mut *sums, &mut *bare])
                }
                (Surface::Mesh(mesh), _) => {
                    mesh::follow(scene, mesh, &bundle, Isa::numbered(ISA), sums, bare)
                }
                (Surface::Sheet(_), None) => unreachable!("each sheet has coordinates"),
            };
            for l in 0..LANES {
                misses[l] += missed[l];
            }
        }
        self.count_paths(place, order, feeds, orders * ends[2], &misses);
    }

    /// Returns the components of pixel `l`, from the sums of all blocks.
    #[inline(always)]
    fn components_of(&self, l: usize, counts: Counts) -> Components {
        let (groups, first_alone) = (&self.plan.groups.sides, self.scene.first_reflection_alone);
        let (of_front, others) = self.totals.split_at(groups[0].len());
        let (of_back, others) = others.split_at(groups[1].len());
        let all = |_: &Group<'_>| true;
        let reflected = mean_of((&groups[1], all), of_back, l, counts);
        let back = if first_alone {
            mean_of((&groups[1], Group::is_r_0), of_back, l, counts)
        } else {
            reflected
        };
        let [mut bare, mut clean] = [NOTHING; 2];
        add_means_of(&mut bare, &others[0], l, counts.all);
        add_means_of(&mut clean, &others[1], l, counts.clean.max(1));
        let front = mean_of((&groups[0], all), of_front, l, counts);
        let mut ghosts = NOTHING;
        if self.scene.labels.contains(Label::Ghosts) {
            let is_ghost = |group: &Group<'_>| !group.is_r_0();
            ghosts = mean_of((&groups[1], is_ghost), of_back, l, counts);
        }
        Components { front, bare, reflected, back, clean, ghosts }
    }

    /// Counts `samples` paths of each live pixel, and their misses, for the layers that an order (or R's path) feeds.
    #[inline(always)]
    fn count_paths(
        &mut self,
        place: &Place,
        order: Option<Order>,
        feeds: Feeds,
        samples: usize,
        misses: &[u32; LANES],
    ) {
        let layers: &[Layer] = match (order, feeds) {
            (Some(Order::Transmitted(_)), Feeds::Both) => &[Layer::Input, Layer::Transmission],
            (Some(Order::Transmitted(_)), Feeds::Bare) => &[Layer::Transmission],
            (Some(Order::Transmitted(_)), Feeds::Order) => &[Layer::Input],
            (Some(Order::Reflected(1..)), _) if self.scene.first_reflection_alone => {
                &[Layer::Input]
            }
            (Some(Order::Reflected(_)), _) => &[Layer::Input, Layer::GlassReflection],
            (None, _) => &[Layer::CleanReflection],
        };
        let (mut paths, mut missed) = (0, 0);
        for l in 0..LANES {
            let counts = u64::from(place.live[l]);
            paths += counts * samples as u64;
            missed += counts * u64::from(misses[l]);
        }
        for &layer in layers {
            self.paths[layer] += paths;
            self.misses[layer] += missed;
        }
    }
}

/// Returns the sum of the means of the groups that count, at pixel `l`.
#[inline(always)]
fn mean_of<'a>(
    (groups, counting): (&[Group<'a>], impl Fn(&Group<'a>) -> bool),
    sums: &[LaneSums],
    l: usize,
    counts: Counts,
) -> Means {
    let blocks = counts.all / counts.block;
    let mut total = NOTHING;
    for (group, sums) in groups.iter().zip(sums).filter(|(group, _)| counting(group)) {
        add_means_of(&mut total, sums, l, group.samples_of_block(counts.block) * blocks);
    }
    total
}
