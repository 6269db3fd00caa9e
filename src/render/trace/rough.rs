//! Rough faces: light that meets one leaves in a lobe of directions.
//!
//! A face with roughness alpha consists of facets, tiny mirrors and prisms, whose normals m have Beckmann's distribution
//!
//! ```text
//! D(m) = exp(-tan^2 / alpha^2) / (pi alpha^2 cos^4)      tan, cos of the angle between m and the face's normal n
//! ```
//!
//! so that each of the two slopes of a facet is normal with standard deviation alpha / sqrt 2. Facets hide each other by Smith's
//! separable factor G1(i) G1(o) (Walter et al., "Microfacet Models for Refraction through Rough Surfaces", EGSR 2007, with the exact
//! G1 of [`visible`]). At each face that it meets, light draws a facet from those that are visible from its direction, and is
//! reflected or refracted there; its weight is the product over the faces of
//!
//! ```text
//! F G1(o)      F: Fresnel's reflectance or transmittance at the facet, o: direction in which the light leaves
//! ```
//!
//! Both branches of a meeting have one facet, so the weights of all paths of a camera sample add up to at most 1: what is missing is
//! what facets hide, and light that leaves on the wrong side of a face. s and p are kept apart to the end, in the plane of incidence of
//! the smooth face: facets turn it, which changes means over 16 x 16 px by less than 1e-5.
//!
//! T and R are those of the smooth pane, so only I and R~ are blurred. Every path is an order of its own: paths that
//! cross equal lengths leave a smooth stack on one line, but rough faces in different lobes. Light of paths that are not followed joins
//! the last order of its side ([`tree`]).

mod arrive;
mod coat;
mod escape;
mod faces;
mod facet;
mod form;
mod joined;
mod meet;
mod paths;
mod program;
mod rays;
mod scatter;
mod shares;
mod tree;
mod visible;

pub use form::Forms;
pub use paths::Meeting;
pub(super) use rays::{CameraRays, RoughRays};
pub use visible::{visible_share, visible_shift};

use super::bow::Bow;
use super::orders::OrderPlan;
use super::slab::{Order, Slab};
use super::stack::{Coating, Exit, Stack};
use super::wave::{Wave, WaveLanes};
use coat::Coat;
use faces::{Crests, Faces};
use glam::{DMat3, DVec3, Vec3};
use paths::{select, straight};
use program::{Meet, Program, Target};
use scatter::LEAST_COS;
use shares::MeanShares;
use tree::{Branch, Light, Node, Tree, measure};

/// A pane with rough faces, and the paths that the tracer follows.
#[derive(Clone, Debug, PartialEq)]
pub struct RoughPane {
    /// The paths of all orders.
    program: Program,
    /// The straight path through smooth faces, which T follows if the faces are no parallel planes or spheres.
    straight: Option<Program>,
    /// Paths of the front, then of the back, and the way of each.
    paths: Vec<Vec<Meeting>>,
    joined: Joined,
    light: Light,
    coats: Vec<Coat>,
    search_was_bounded: bool,
    /// Two directions that span the pane's plane at the pivot, and its normal, which points away from the lens.
    axes: [Vec3; 3],
    /// Distance of the pivot from the lens along the optical axis, m.
    distance_m: f32,
    curvature_per_m: f32,
    /// Waves of the faces; of height 0 without waves.
    wave: WaveLanes,
    has_waves: bool,
    has_wedges: bool,
    /// True if T follows the rays of t_0.
    shares_t_0: bool,
    /// True if the weights of the three colours differ.
    is_coloured: bool,
}

/// The ways of paths: orders of the front, then of the back. The last of a side has the light of cuts.
#[derive(Clone, Debug, PartialEq)]
struct Joined {
    /// Way of each path.
    ways: Vec<usize>,
    /// Number of ways of the front, and of both sides.
    of_front: usize,
    count: usize,
    /// The ways of the light of cuts to the front and to the back.
    rests: [Option<Rest>; 2],
    /// Bounds of the light that paths move to another line of the front and of the back, linear radiance.
    moved: [f64; 2],
}

/// The way of the light of cuts. It has the line of another way, but its own number of samples. With the other's number, nearly all meetings of
/// the tree would be followed for as many, because most of them have a cut behind them.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Rest {
    way: usize,
    /// The way with the line.
    line: usize,
}

impl Joined {
    /// Numbers the ways of paths with these orders, which are counted on each side.
    fn new(orders: [&[usize]; 2], has_cuts: bool, moved: [f64; 2]) -> Self {
        let mut joined = Self { ways: vec![], of_front: 0, count: 0, rests: [None; 2], moved };
        for (side, orders) in orders.into_iter().enumerate() {
            let first = joined.count;
            joined.ways.extend(orders.iter().map(|order| first + order));
            joined.count += orders.iter().max().map_or(0, |last| last + 1);
            if has_cuts && joined.count > first {
                joined.rests[side] = Some(Rest { way: joined.count, line: joined.count - 1 });
                joined.count += 1;
            }
            if side == 0 {
                joined.of_front = joined.count;
            }
        }
        joined
    }
}

/// A branch of a meeting whose light joins the last orders, in the shares `division` of the front and of the back for each colour.
#[derive(Clone, Debug, PartialEq)]
pub struct Cut {
    pub meetings: Vec<Meeting>,
    pub division: [[f64; 3]; 2],
}

/// Pose and shape of a pane with rough faces.
#[derive(Clone, Copy, Debug)]
pub struct RoughShape<'a> {
    pub slab: &'a Slab,
    /// Distance of the pivot from the lens along the optical axis, m.
    pub distance_m: f64,
    /// Curvature of a bent pane, which has neither waves nor wedges.
    pub bow: Option<&'a Bow>,
    pub wave: Option<&'a Wave>,
    /// Rotation of each face against the first, about the point of the face on the normal through the pivot; without it, all
    /// are parallel.
    pub turned: Option<&'a [DMat3]>,
}

impl RoughShape<'_> {
    /// True if the faces are no parallel planes or spheres.
    pub fn is_free(&self) -> bool {
        self.wave.is_some() || self.turned.is_some()
    }

    /// Returns the axes of each of the faces in coordinates with the pane's `axes`.
    fn faces(&self, axes: [DVec3; 3], count: usize) -> Vec<DMat3> {
        let pane = DMat3::from_cols(axes[0], axes[1], axes[2]);
        let of = |face: usize| {
            let turned = self.turned.map_or(DMat3::IDENTITY, |turned| turned[face]);
            pane.transpose() * turned * pane
        };
        (0..count).map(of).collect()
    }
}

/// The way to a face, and the meeting with it.
#[derive(Clone, Debug, PartialEq)]
struct Step {
    face: usize,
    alpha: f32,
    is_rough: bool,
    /// Indices of refraction before and behind the face, as the light travels.
    ior: [f32; 2],
    /// Number of the coating of the face, for light in this direction.
    coat: Option<usize>,
    /// 1 for light that travels away from the camera before the face, else -1.
    inward_sign: f32,
    /// Distance along the normal from the face before it, m; positive away from the lens. Unused at the first step.
    travel_m: f32,
    /// Origin and axes of the face, in those of the pane; the last axis is its normal. Waves add to it.
    origin: Vec3,
    axes: [Vec3; 3],
    /// Constant of the quadratic equation of the way between two spheres, m: half of it is -`travel_m` without curvature.
    constant_m: f32,
    /// Absorption coefficients of the layer crossed on the way, per metre.
    absorption_per_m: [f32; 3],
    absorbs: bool,
}

impl RoughPane {
    /// Selects the paths of a pane whose faces have the roughness `alphas`, for cosines of incidence between these two, the largest radiances of the front and the back scene, and the film's tolerance.
    ///
    /// Panics if the numbers of faces and alphas differ.
    pub fn new(
        stack: &Stack,
        alphas: &[f64],
        shape: RoughShape<'_>,
        between: [f64; 2],
        max_radiance: [f64; 2],
        tolerance: f64,
    ) -> (Self, OrderPlan) {
        assert!(alphas.len() == stack.coatings().len(), "every face has a roughness");
        let normal = shape.slab.normal;
        let across = (DVec3::X - normal * normal.x).normalize();
        let axes = [across, normal.cross(across), normal];
        let curvature_per_m = shape.bow.map_or(0.0, |bow| bow.curvature_per_m);
        // A flat ray in a bent pane misses the inner sphere.
        let miss_cos = (2.0 * stack.thickness_m() * curvature_per_m.abs()).sqrt();
        let least_cos = miss_cos.max(f64::from(LEAST_COS));
        let between = [between[0].max(least_cos), between[1].min(1.0)];
        let turned = shape.faces(axes, alphas.len());
        let crests = shape.wave.map(|wave| Crests {
            across: axes.map(|axis| axis.dot(wave.across_crests)).into(),
            largest_slope: wave.largest_slope(),
            length_m: wave.length_m,
        });
        let azimuth = DVec3::new(across.z, axes[1].z, 0.0).try_normalize().unwrap_or(DVec3::X);
        let of_shape = if shape.turned.is_some() { &turned[..] } else { &[] };
        let faces = Faces { stack, alphas, least_cos, turned: of_shape, crests, azimuth };
        let mut shares = MeanShares::default();
        let selection = select(&faces, &mut shares, between, max_radiance, tolerance);
        let orders = selection.sides.each_ref().map(|paths| (0..paths.len()).collect::<Vec<_>>());
        let count = orders[0].len() + orders[1].len();
        let tree = Tree::new(&selection.sides);
        let light = measure(&faces, &mut shares, &tree, count, between);
        let joined = Joined::new(orders.each_ref().map(Vec::as_slice), tree.cuts > 0, [0.0; 2]);
        let maker = StepMaker { stack, curvature_per_m, turned: &turned };
        let is_smooth = alphas.iter().all(|alpha| *alpha == 0.0);
        let straight = shape.is_free().then(|| {
            let meetings = straight(alphas.len());
            let smooth = vec![0.0; alphas.len()];
            maker.chain(&smooth, &meetings)
        });
        let program = maker.program(alphas, &tree, &light, orders[0].len());
        let mut pane = Self {
            program,
            shares_t_0: straight.is_some() && is_smooth,
            straight,
            paths: selection.sides.into_iter().flatten().map(|path| path.meetings).collect(),
            joined,
            light,
            coats: coats(stack),
            search_was_bounded: selection.was_bounded,
            axes: axes.map(DVec3::as_vec3),
            wave: shape.wave.map_or_else(WaveLanes::default, |wave| wave.lanes(axes)),
            has_waves: shape.wave.is_some(),
            has_wedges: shape.turned.is_some(),
            distance_m: shape.distance_m as f32,
            curvature_per_m: curvature_per_m as f32,
            is_coloured: stack.is_coloured(),
        };
        pane.number_ways();
        let plan = pane.plan(max_radiance, tolerance);
        (pane, plan)
    }

    /// Plans the orders of the ways.
    fn plan(&self, max_radiance: [f64; 2], tolerance: f64) -> OrderPlan {
        let Light { max_weights, peaks, cut_peaks, dropped, shadowed, .. } = &self.light;
        let has_facets = self.has_facets();
        let mut ways = vec![(0.0, 0.0); self.joined.count];
        for ((weight, peak), way) in max_weights.iter().zip(peaks).zip(&self.joined.ways) {
            ways[*way].0 += weight;
            // Without facets, no ray is rare: weights differ as the places on the film do.
            ways[*way].1 += if has_facets { *peak } else { *weight };
        }
        for (side, rest) in self.joined.rests.iter().enumerate() {
            if let Some(Rest { way, .. }) = rest {
                let peak = if has_facets { cut_peaks[side] } else { dropped[side] };
                ways[*way] = (dropped[side], peak);
            }
        }
        let (front, back) = ways.split_at(self.joined.of_front);
        let sides = [front.to_vec(), back.to_vec()];
        let mut plan = OrderPlan::of_weights(&sides, *dropped, max_radiance, tolerance);
        (0..2).for_each(|side| plan.dropped[side] += self.joined.moved[side]);
        plan.shadowed = shadowed * max_radiance[0].max(max_radiance[1]);
        plan.search_was_bounded = self.search_was_bounded;
        plan
    }

    /// Gives paths of the front and of the back these orders in place of one for each.
    fn join(&mut self, orders: [&[usize]; 2], moved: [f64; 2]) {
        let has_cuts = self.joined.rests != [None; 2];
        self.joined = Joined::new(orders, has_cuts, moved);
        self.number_ways();
    }

    /// Gives the ways in the programs their numbers.
    fn number_ways(&mut self) {
        self.program.number(&self.joined);
        if let Some(straight) = &mut self.straight {
            let way = if self.shares_t_0 { 0 } else { self.joined.count };
            straight.number_all(way);
        }
    }

    /// Returns the faces that each path of an order meets, or of the order whose line it has; `index` is that of the order among the followed
    /// ones of its side.
    pub fn paths(&self, order: Order, index: usize) -> Vec<&[Meeting]> {
        let way = self.way(order, index);
        let rest = self.joined.rests.iter().flatten().find(|rest| rest.way == way);
        let way = rest.map_or(way, |rest| rest.line);
        let of = self.paths.iter().zip(&self.joined.ways).filter(|(_, of)| **of == way);
        of.map(|(path, _)| path.as_slice()).collect()
    }

    /// Returns the branches of the paths whose light joins the last orders.
    pub fn cuts(&self) -> Vec<Cut> {
        let mut cuts = vec![];
        let mut before: Vec<Vec<Meeting>> = vec![vec![]; self.program.meets.len()];
        for (index, meet) in self.program.meets.iter().enumerate() {
            for (reflects, target) in [false, true].into_iter().zip(&meet.branches) {
                let inward = meet.step.inward_sign > 0.0;
                let mut meetings = before[index].clone();
                meetings.push(Meeting { face: meet.step.face, inward, reflects });
                match target {
                    Target::To(next) => before[*next] = meetings,
                    Target::Cut(division) => {
                        let division = division.map(|of| of.map(f64::from));
                        cuts.push(Cut { meetings, division });
                    }
                    Target::Leaf { .. } | Target::Nothing => {}
                }
            }
        }
        cuts
    }

    /// True if a face is rough.
    pub fn has_facets(&self) -> bool {
        self.program.meets.iter().any(|meet| meet.step.is_rough)
    }

    /// Returns two directions that span the pane's plane at the pivot.
    pub(super) fn plane(&self) -> [DVec3; 2] {
        [self.axes[0].as_dvec3(), self.axes[1].as_dvec3()]
    }

    /// Returns the way of T, if it has one of its own.
    pub(super) fn straight(&self) -> Option<usize> {
        let way = if self.shares_t_0 { 0 } else { self.joined.count };
        self.straight.is_some().then_some(way)
    }

    /// True if T follows the rays of t_0.
    pub(super) fn shares_t_0(&self) -> bool {
        self.shares_t_0
    }

    /// Returns the way of an order that the tracer follows.
    pub(super) fn way(&self, order: Order, index: usize) -> usize {
        let is_back = matches!(order, Order::Reflected(_));
        index + if is_back { self.joined.of_front } else { 0 }
    }

    /// Raises the number of samples of the ways that lend others their lines.
    pub(super) fn serve_rests(&self, taken: &mut [usize]) {
        for rest in self.joined.rests.iter().flatten() {
            taken[rest.line] = taken[rest.line].max(taken[rest.way]);
        }
    }

    /// Returns the number of ways: those of the orders, and that of T.
    pub(super) fn ways(&self) -> usize {
        self.joined.count + 1
    }

    /// Returns the programs of the orders and of T.
    fn programs(&self) -> impl Iterator<Item = &Program> {
        let straight = self.straight.as_ref().filter(|_| !self.shares_t_0);
        std::iter::once(&self.program).chain(straight)
    }
}

/// Makes the steps of a pane's programs.
struct StepMaker<'a> {
    stack: &'a Stack,
    curvature_per_m: f64,
    turned: &'a [DMat3],
}

/// Returns the coatings of all faces, each for light towards the camera and away from it.
fn coats(stack: &Stack) -> Vec<Coat> {
    let coatings = stack.coatings().iter().flatten();
    let of = |inward| {
        move |coating: &Coating| {
            Coat::new([false, true].map(|reflects| coating.share(inward, reflects)))
        }
    };
    coatings.flat_map(|coating| [of(false)(coating), of(true)(coating)]).collect()
}

impl StepMaker<'_> {
    /// Prepares a tree. Its first paths, `of_front`, lead to the front.
    fn program(&self, alphas: &[f64], tree: &Tree, light: &Light, of_front: usize) -> Program {
        let target = |branch: &Branch| match *branch {
            Branch::To(next) => Target::To(next),
            Branch::Leaf(path) => {
                Target::Leaf { path, way: path, is_front: path < of_front, joins: false }
            }
            Branch::Cut(cut) => {
                Target::Cut(light.divisions[cut].map(|division| division.map(|of| of as f32)))
            }
        };
        let meet = |node: &Node| Meet {
            step: self.step(alphas[node.face], node.face, node.inward, node.before),
            depth: node.depth,
            branches: node.branches.each_ref().map(target),
        };
        Program { meets: tree.nodes.iter().map(meet).collect(), rests: [None; 2] }
    }

    /// Prepares a single path.
    fn chain(&self, alphas: &[f64], meetings: &[Meeting]) -> Program {
        let mut before = None;
        let meets = meetings.iter().enumerate().map(|(depth, meeting)| {
            let step = self.step(alphas[meeting.face], meeting.face, meeting.inward, before);
            before = Some(meeting.face);
            let on = if depth + 1 == meetings.len() {
                let is_front = meeting.exit() == Exit::Transmitted;
                Target::Leaf { path: 0, way: 0, is_front, joins: false }
            } else {
                Target::To(depth + 1)
            };
            let mut branches = [Target::Nothing, Target::Nothing];
            branches[usize::from(meeting.reflects)] = on;
            Meet { step, depth, branches }
        });
        Program { meets: meets.collect(), rests: [None; 2] }
    }

    fn step(&self, alpha: f64, face: usize, inward: bool, before: Option<usize>) -> Step {
        let stack = self.stack;
        let [near, far] = stack.iors(face);
        let ior = if inward { [near, far] } else { [far, near] };
        let number = |face: usize| stack.coatings()[..face].iter().flatten().count();
        let coat = stack.coatings()[face].as_ref().map(|_| 2 * number(face) + usize::from(inward));
        let [from_m, to_m] = [before.unwrap_or(0), face].map(|face| stack.depth_m(face));
        let crossed = before.map(|before| &stack.layers()[before.min(face)]);
        let of_sphere = |m: f64| 2.0 * m + self.curvature_per_m * m * m;
        let absorption_per_m = crossed.map_or([0.0; 3], |layer| layer.absorption_per_m);
        Step {
            face,
            alpha: alpha as f32,
            is_rough: alpha != 0.0,
            ior: ior.map(|ior| ior as f32),
            coat,
            inward_sign: if inward { 1.0 } else { -1.0 },
            travel_m: (to_m - from_m) as f32,
            origin: Vec3::Z * to_m as f32,
            axes: [0, 1, 2].map(|k| self.turned[face].col(k).as_vec3()),
            constant_m: (of_sphere(from_m) - of_sphere(to_m)) as f32,
            absorption_per_m: absorption_per_m.map(|a| a as f32),
            absorbs: absorption_per_m != [0.0; 3],
        }
    }
}
