//! Rough faces: light that meets one leaves in a lobe of directions.
//!
//! A face with roughness alpha consists of facets, tiny mirrors and prisms, whose normals m have Beckmann's distribution
//!
//! ```text
//! D(m) = exp(-tan^2 / alpha^2) / (pi alpha^2 cos^4)      tan, cos of the angle between m and the face's normal n
//! ```
//!
//! so that each of the two slopes of a facet is normal with standard deviation alpha / sqrt 2. At each face that it meets, a path draws
//! a facet with density D cos, and is reflected or refracted there; its weight is the product over the faces of
//!
//! ```text
//! F |i.m| / (|i.n| |m.n|)      F: Fresnel's reflectance or transmittance at the facet, i: direction of the incident light
//! ```
//!
//! (Walter et al., "Microfacet Models for Refraction through Rough Surfaces", EGSR 2007, eq. 41, without shadowing, which is
//! absent where 1.6 alpha tan < 1; `scene::check_geometry` refuses other panes.) s and p are kept apart to the end, in the plane of incidence of
//! the smooth face: facets turn it, which changes means over 16 x 16 px by less than 1e-5. A facet that light meets from behind, and light
//! that leaves on the wrong side of the face, have weight 0.
//!
//! T and R are those of the smooth pane, so only I and R~ are blurred. Every path is an order of its own: paths that
//! cross equal lengths leave a smooth stack on one line, but rough faces in different lobes.

mod paths;
mod rays;
mod scatter;

pub use paths::Meeting;
pub(super) use rays::{CameraRays, RoughRays};

use super::bow::Bow;
use super::lanes::{floor, max, min};
use super::orders::OrderPlan;
use super::slab::{Order, Slab};
use super::smudges::{SmudgeLanes, Smudges};
use super::stack::{Exit, Stack};
use super::wave::{Wave, WaveLanes};
use crate::curve::Curve;
use glam::{DMat3, DVec3, Vec3};
use paths::Selected;

/// A pane with rough faces, and the paths that the tracer follows.
#[derive(Clone, Debug, PartialEq)]
pub struct RoughPane {
    paths: [Vec<RoughPath>; 2],
    /// The different roughnesses of its faces: where they are clean, and under smudges.
    alphas: Vec<[f32; 2]>,
    smudges: Option<SmudgeLanes>,
    /// Two directions that span the pane's plane at the pivot, and its normal, which points away from the lens.
    axes: [Vec3; 3],
    /// Distance of the pivot from the lens along the optical axis, m.
    distance_m: f32,
    curvature_per_m: f32,
    /// Waves of the faces; of height 0 without waves.
    wave: WaveLanes,
    has_waves: bool,
    has_wedges: bool,
    /// The straight path through smooth faces, which T follows if the faces are no parallel planes or spheres.
    straight: Option<RoughPath>,
    /// True if T follows the rays of t_0.
    shares_t_0: bool,
    /// True if the weights of the three colours differ.
    is_coloured: bool,
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
    /// Smudges on the first face.
    pub smudges: Option<&'a Smudges>,
}

impl RoughShape<'_> {
    /// True if the faces are no parallel planes or spheres.
    pub fn is_free(&self) -> bool {
        self.wave.is_some() || self.turned.is_some()
    }

    /// Returns the axes of each of the faces in coordinates with the pane's `axes`.
    fn faces(&self, axes: [DVec3; 3], count: usize) -> Vec<[Vec3; 3]> {
        let pane = DMat3::from_cols(axes[0], axes[1], axes[2]);
        let of = |face: usize| {
            let turned = self.turned.map_or(DMat3::IDENTITY, |turned| turned[face]);
            let turned = pane.transpose() * turned * pane;
            [turned.x_axis, turned.y_axis, turned.z_axis].map(DVec3::as_vec3)
        };
        (0..count).map(of).collect()
    }
}

/// A path, ready for tracing.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct RoughPath {
    steps: Vec<Step>,
    meetings: Vec<Meeting>,
    is_front: bool,
    /// Product of the shares of coated faces, for each colour.
    coated: Coated,
    absorbs: bool,
}

/// The way to a face, and the meeting with it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Step {
    /// Number of the face's roughness in [`RoughPane::alphas`].
    roughness: usize,
    /// Indices of refraction before and behind the face, as the light travels.
    ior: [f32; 2],
    reflects: bool,
    is_coated: bool,
    /// Distance along the normal from the face before it, m; positive away from the lens. Unused at the first step.
    travel_m: f32,
    /// Origin and axes of the face, in those of the pane; the last axis is its normal. Waves add to it.
    origin: Vec3,
    axes: [Vec3; 3],
    /// Constant of the quadratic equation of the way between two spheres, m: half of it is -`travel_m` without curvature.
    constant_m: f32,
    /// Absorption coefficients of the layer crossed on the way, per metre.
    absorption_per_m: [f32; 3],
}

/// The product of the shares of a path's coated faces, as a function of the cosine of the camera ray's incidence: facets change
/// Fresnel's shares, but not those of coatings.
#[derive(Clone, Debug, PartialEq)]
struct Coated {
    /// Shares at equal steps of the cosine from 0 to 1, or at all angles.
    rows: Vec<[f32; 3]>,
}

impl Coated {
    /// Steps of the cosine. Linear interpolation between them is exact to some 1e-5 for a coating with rows every ten degrees.
    const STEPS: u32 = 256;

    fn new(shares: &[&Curve]) -> Self {
        let at = |cos: f64| {
            let mut product = [1.0; 3];
            for share in shares {
                let share = share.at(cos);
                (0..3).for_each(|c| product[c] *= share[c]);
            }
            product.map(|share| share as f32)
        };
        let is_constant = shares.iter().all(|share| share.is_constant());
        let steps = if is_constant { 0 } else { Self::STEPS };
        let rows = (0..=steps).map(|i| at(f64::from(i) / f64::from(Self::STEPS))).collect();
        Self { rows }
    }

    /// Returns the shares, if they are equal at all angles.
    fn constant(&self) -> Option<[f32; 3]> {
        (self.rows.len() == 1).then(|| self.rows[0])
    }

    /// Returns the share of a colour.
    #[inline(always)]
    fn at(&self, colour: usize, cos: f32) -> f32 {
        let (whole, index) = floor(min(max(cos, 0.0), 1.0) * Self::STEPS as f32);
        let index = (index as usize).min(self.rows.len() - 2);
        let [from, to] = [self.rows[index][colour], self.rows[index + 1][colour]];
        let within = cos * Self::STEPS as f32 - whole;
        from + (to - from) * within
    }
}

impl RoughPane {
    /// Selects the paths of a pane whose clean faces have the roughness `alphas`, for cosines of incidence between these two, the largest radiances of the front and the back scene, and the film's tolerance.
    ///
    /// Panics if the numbers of faces and alphas differ.
    pub fn new(
        stack: &Stack,
        alphas: &[f64],
        shape: RoughShape<'_>,
        cosines: [f64; 2],
        max_radiance: [f64; 2],
        tolerance: f64,
    ) -> (Self, OrderPlan) {
        assert!(alphas.len() == stack.coatings().len(), "every face has a roughness");
        let mut of_faces: Vec<[f64; 2]> = alphas.iter().map(|alpha| [*alpha; 2]).collect();
        if let Some(smudges) = shape.smudges {
            of_faces[0][1] = smudges.smear().roughness;
        }
        let largest: Vec<f64> =
            of_faces.iter().map(|[clean, smeared]| clean.max(*smeared)).collect();
        let sides = paths::select(stack, &largest, cosines, max_radiance, tolerance);
        let weights = sides
            .each_ref()
            .map(|(paths, _)| paths.iter().map(|path| path.max_weight).collect::<Vec<f64>>());
        let tails = sides.each_ref().map(|(_, left)| *left);
        let plan = OrderPlan::of_weights(
            weights.each_ref().map(Vec::as_slice),
            tails,
            max_radiance,
            tolerance,
        );
        let curvature_per_m = shape.bow.map_or(0.0, |bow| bow.curvature_per_m);
        let mut distinct: Vec<[f64; 2]> = vec![];
        let mut number = |of_face: &[f64; 2]| {
            let found = distinct.iter().position(|other| other == of_face);
            found.unwrap_or_else(|| {
                distinct.push(*of_face);
                distinct.len() - 1
            })
        };
        let numbers: Vec<usize> = of_faces.iter().map(&mut number).collect();
        let normal = shape.slab.normal;
        let across = (DVec3::X - normal * normal.x).normalize();
        let axes = [across, normal.cross(across), normal];
        let faces = shape.faces(axes, alphas.len());
        let is_smooth = alphas.iter().all(|alpha| *alpha == 0.0) && shape.smudges.is_none();
        let straight = shape.is_free().then(|| {
            let smooth = vec![number(&[0.0; 2]); alphas.len()];
            let path = Selected::straight(alphas.len());
            RoughPath::new(stack, &smooth, (curvature_per_m, &faces), &path)
        });
        let prepare =
            |path: &Selected| RoughPath::new(stack, &numbers, (curvature_per_m, &faces), path);
        let pane = Self {
            paths: [0, 1].map(|side: usize| sides[side].0.iter().map(prepare).collect()),
            alphas: distinct.iter().map(|alphas| alphas.map(|alpha| alpha as f32)).collect(),
            smudges: shape.smudges.map(|smudges| smudges.lanes([axes[0], axes[1]])),
            axes: axes.map(DVec3::as_vec3),
            wave: shape.wave.map_or_else(WaveLanes::default, |wave| wave.lanes(axes)),
            has_waves: shape.wave.is_some(),
            has_wedges: shape.turned.is_some(),
            shares_t_0: straight.is_some() && is_smooth,
            straight,
            distance_m: shape.distance_m as f32,
            curvature_per_m: curvature_per_m as f32,
            is_coloured: stack.is_coloured(),
        };
        (pane, plan)
    }

    /// Returns the faces that the path of an order meets; `index` is that of the order among the followed ones of its side.
    pub fn meetings(&self, order: Order, index: usize) -> &[Meeting] {
        &self.path(order, index).meetings
    }

    /// Returns the path of T, if it has one of its own.
    pub(super) fn straight(&self) -> Option<&RoughPath> {
        self.straight.as_ref()
    }

    /// True if T follows the rays of t_0.
    pub(super) fn shares_t_0(&self) -> bool {
        self.shares_t_0
    }

    /// Returns the path of an order that the tracer follows.
    pub(super) fn path(&self, order: Order, index: usize) -> &RoughPath {
        &self.paths[usize::from(matches!(order, Order::Reflected(_)))][index]
    }
}

impl RoughPath {
    /// Prepares a path. `numbers` are those of the faces' roughnesses.
    fn new(
        stack: &Stack,
        numbers: &[usize],
        (curvature_per_m, faces): (f64, &[[Vec3; 3]]),
        path: &Selected,
    ) -> Self {
        let (mut coated, mut before) = (vec![], 0);
        let mut steps = vec![];
        for (number, &Meeting { face, inward, reflects }) in path.meetings.iter().enumerate() {
            let [near, far] = stack.iors(face);
            let ior = if inward { [near, far] } else { [far, near] };
            if let Some(coating) = &stack.coatings()[face] {
                coated.push(coating.share(inward, reflects));
            }
            let [from_m, to_m] = [stack.depth_m(before), stack.depth_m(face)];
            let crossed = (number > 0).then(|| &stack.layers()[before.min(face)]);
            let of_sphere = |m: f64| 2.0 * m + curvature_per_m * m * m;
            steps.push(Step {
                roughness: numbers[face],
                ior: ior.map(|ior| ior as f32),
                reflects,
                is_coated: stack.coatings()[face].is_some(),
                travel_m: (to_m - from_m) as f32,
                origin: Vec3::Z * to_m as f32,
                axes: faces[face],
                constant_m: (of_sphere(from_m) - of_sphere(to_m)) as f32,
                absorption_per_m: crossed
                    .map_or([0.0; 3], |layer| layer.absorption_per_m)
                    .map(|a| a as f32),
            });
            before = face;
        }
        let absorbs = steps.iter().any(|step| step.absorption_per_m != [0.0; 3]);
        let is_front = path.exit == Exit::Transmitted;
        let meetings = path.meetings.clone();
        Self { steps, meetings, is_front, coated: Coated::new(&coated), absorbs }
    }
}
