//! Selects the paths of light through a pane with rough faces, from the strongest on.
//!
//! Facets change the weights of paths: light that they turn to total reflection stays in the pane for many passages. So a
//! best-first search carries a few rays along every path, in f64, at several angles of incidence, and compares the means of
//! their weights. The light that no selected path has is the sum of what the search has left.

use super::super::orders::MOST_PATHS;
use super::super::sampler::{PixelSeed, sample};
use super::super::stack::{Exit, Stack};
use super::facet::{Face, facet_at};
use glam::DVec3;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// Number of angles of incidence.
const ANGLES: usize = 3;
/// Number of rays at each angle.
const RAYS: usize = 32;

/// Largest number of steps of the search. The light of paths that it does not reach is left.
const MOST_STEPS: usize = 4000;

/// A face that a path meets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Meeting {
    /// Number of the face, from the camera outwards.
    pub face: usize,
    /// True if the light travels away from the camera before the face.
    pub inward: bool,
    pub reflects: bool,
}

impl Meeting {
    /// Returns the direction of the light behind the face: true away from the camera.
    pub(super) fn goes_inward(self) -> bool {
        self.inward != self.reflects
    }

    /// Returns the next face of a pane of `layers`; `None` outside of the pane.
    pub(super) fn next_face(self, layers: usize) -> Option<usize> {
        let next =
            if self.goes_inward() { self.face.checked_add(1) } else { self.face.checked_sub(1) };
        next.filter(|face| *face <= layers)
    }

    /// Returns the side on which light that goes on leaves the pane.
    pub(super) fn exit(self) -> Exit {
        if self.goes_inward() { Exit::Transmitted } else { Exit::Reflected }
    }
}

/// Returns the meetings of the path that crosses each of the faces once.
pub(super) fn straight(faces: usize) -> Vec<Meeting> {
    (0..faces).map(|face| Meeting { face, inward: true, reflects: false }).collect()
}

/// A ray in coordinates with the pane's normal as z, with its weights for s and p, and for each colour.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ray {
    pub(super) direction: DVec3,
    pub(super) power: [[f64; 3]; 2],
}

impl Ray {
    /// Makes a camera ray at this cosine of incidence.
    pub(super) fn at(cos: f64) -> Self {
        let sin = (1.0 - cos * cos).max(0.0).sqrt();
        Self { direction: DVec3::new(sin, 0.0, cos), power: [[1.0; 3]; 2] }
    }

    /// Returns the weights of the colours for unpolarised light.
    pub(super) fn weights(&self) -> [f64; 3] {
        let [s, p] = &self.power;
        [0, 1, 2].map(|c| 0.5 * (s[c] + p[c]))
    }
}

/// A pane with the roughness of its faces, followed in f64.
#[derive(Clone, Copy, Debug)]
pub(super) struct Faces<'a> {
    pub(super) stack: &'a Stack,
    pub(super) alphas: &'a [f64],
    /// Least cosine of a direction to a face's normal with which light goes on.
    pub(super) least_cos: f64,
}

impl Faces<'_> {
    /// Splits a ray at a face: into the light that passes it and the light that it reflects. Also returns for each the part that facets
    /// hide or that leaves on the wrong side, for each colour. `cos_i` is that of the camera ray; coatings depend on it.
    pub(super) fn split(
        &self,
        ray: &Ray,
        (face, inward): (usize, bool),
        facet: [f64; 2],
        cos_i: f64,
    ) -> [(Ray, [f64; 3]); 2] {
        let [near, far] = self.stack.iors(face);
        let iors = if inward { [near, far] } else { [far, near] };
        let face_of = Face { alpha: self.alphas[face], iors, least_cos: self.least_cos };
        let leaving = face_of.split(ray.direction, facet);
        let coating = self.stack.coatings()[face].as_ref();
        [false, true].map(|reflects| {
            let of = &leaving[usize::from(reflects)];
            // A facet that reflects totally keeps what the coating would let pass.
            let coated = coating.map(|coating| {
                let [passed, reflected] =
                    [false, true].map(|reflects| coating.share(inward, reflects).at(cos_i));
                match (reflects, of.is_total) {
                    (false, true) => [0.0; 3],
                    (false, false) => passed,
                    (true, false) => reflected,
                    (true, true) => [0, 1, 2].map(|c| reflected[c] + passed[c]),
                }
            });
            let meeting = Meeting { face, inward, reflects };
            let layer = meeting.next_face(self.stack.layers().len()).map(|next| {
                let layer = &self.stack.layers()[next.min(face)];
                let way_m = layer.thickness_m / of.direction.z.abs();
                layer.absorption_per_m.map(|a| libm::exp(-a * way_m))
            });
            let (mut power, mut lost) = (ray.power, [0.0; 3]);
            for (q, power) in power.iter_mut().enumerate() {
                for c in 0..3 {
                    let share = coated.map_or(of.fresnel[q], |coated| coated[c]);
                    let met = power[c] * share;
                    lost[c] += 0.5 * met * (1.0 - of.passes);
                    power[c] = met * of.passes * layer.map_or(1.0, |passed| passed[c]);
                }
            }
            (Ray { direction: of.direction, power }, lost)
        })
    }
}

/// A selected path.
pub(super) struct Selected {
    pub(super) meetings: Vec<Meeting>,
}

/// A path of the search, to its next face or to its end.
struct Partial {
    /// Largest mean weight at all angles and of all colours.
    strength: f64,
    /// True for the parts of the straight path and of the reflection in face 0, which come before all others.
    is_first: bool,
    /// The next face; `None` after the last one.
    next: Option<usize>,
    /// True if the light travels away from the camera.
    inward: bool,
    meetings: Vec<Meeting>,
    /// [`RAYS`] at each of [`ANGLES`] angles.
    rays: Vec<Ray>,
}

impl Ord for Partial {
    /// The first parts are the largest, then the strong ones; of equals, those with fewer meetings.
    fn cmp(&self, other: &Self) -> Ordering {
        let by_strength = self.strength.total_cmp(&other.strength);
        let by_length = other.meetings.len().cmp(&self.meetings.len());
        self.is_first
            .cmp(&other.is_first)
            .then(by_strength)
            .then(by_length)
            .then_with(|| other.meetings.cmp(&self.meetings))
    }
}

impl PartialOrd for Partial {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Partial {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Partial {}

/// Paths of each side, and whether the search ended before the light that is left was below its bound.
pub(super) struct Selection {
    /// The paths to the front (0) and to the back (1), those with few meetings first.
    pub(super) sides: [Vec<Selected>; 2],
    pub(super) was_bounded: bool,
}

/// Selects the straight path and the reflection in face 0, and the strongest others until the light that is left is no longer
/// worth a path (see [`MOST_PATHS`]), on each side with its largest radiance.
pub(super) fn select(
    faces: &Faces<'_>,
    [least_cos, most_cos]: [f64; 2],
    max_radiance: [f64; 2],
    tolerance: f64,
) -> Selection {
    let last = (ANGLES - 1) as f64;
    let cosines: [f64; ANGLES] =
        std::array::from_fn(|i| least_cos + (most_cos - least_cos) * i as f64 / last);
    let rays = cosines.iter().flat_map(|cos| [Ray::at(*cos); RAYS]).collect();
    let all = Partial {
        strength: 1.0,
        is_first: true,
        next: Some(0),
        inward: true,
        meetings: vec![],
        rays,
    };
    let mut heap = BinaryHeap::from([all]);
    // Sums of the strengths of the paths that still go on, and of those that have left on each side.
    let (mut inside, mut outside) = (1.0, [0.0; 2]);
    let mut sides: [Vec<Selected>; 2] = [vec![], vec![]];
    let mut was_bounded = true;
    for _ in 0..MOST_STEPS {
        let is_done = |side: usize| {
            let count = sides[side].len();
            let has_first = count > 0 || (side == 1 && max_radiance[1] == 0.0);
            has_first
                && !MOST_PATHS.needs_more(
                    count,
                    inside + outside[side],
                    max_radiance[side],
                    tolerance,
                )
        };
        if is_done(0) && is_done(1) {
            was_bounded = false;
            break;
        }
        let Some(path) = heap.pop() else {
            was_bounded = false;
            break;
        };
        let Some(face) = path.next else {
            let side = usize::from(!path.inward);
            if !is_done(side) {
                outside[side] -= path.strength;
                sides[side].push(Selected { meetings: path.meetings });
            }
            continue;
        };
        inside -= path.strength;
        for next in go_on(faces, &cosines, &path, face) {
            match next.next {
                Some(_) => inside += next.strength,
                None => outside[usize::from(!next.inward)] += next.strength,
            }
            // A path without light has no parts, except for the line that T needs.
            if next.strength > 0.0 || next.is_first {
                heap.push(next);
            }
        }
    }
    for paths in &mut sides {
        paths.sort_by_key(|path| path.meetings.len());
    }
    Selection { sides, was_bounded }
}

/// Continues a path by one face.
fn go_on(faces: &Faces<'_>, cosines: &[f64; ANGLES], path: &Partial, face: usize) -> [Partial; 2] {
    let seed = PixelSeed::new(0, 0, 0).of_meeting(path.meetings.len() as u32);
    let facets: Vec<[f64; 2]> = (0..RAYS as u32)
        .map(|index| {
            let [u, v, ..] = sample(&seed, index);
            facet_at([u, v])
        })
        .collect();
    let mut rays = [path.rays.clone(), path.rays.clone()];
    let mut strength = [0.0f64; 2];
    for (angle, cos_i) in cosines.iter().enumerate() {
        let mut sums = [[0.0; 3]; 2];
        for (k, facet) in facets.iter().enumerate() {
            let index = angle * RAYS + k;
            let split = faces.split(&path.rays[index], (face, path.inward), *facet, *cos_i);
            for (branch, (ray, _)) in split.into_iter().enumerate() {
                let weights = ray.weights();
                (0..3).for_each(|c| sums[branch][c] += weights[c] / RAYS as f64);
                rays[branch][index] = ray;
            }
        }
        for (strength, sum) in strength.iter_mut().zip(sums) {
            *strength = sum.into_iter().fold(*strength, f64::max);
        }
    }
    let mut branch = 0;
    rays.map(|rays| {
        let reflects = branch == 1;
        let strength = strength[branch];
        branch += 1;
        let meeting = Meeting { face, inward: path.inward, reflects };
        let mut meetings = path.meetings.clone();
        meetings.push(meeting);
        let is_straight = meetings.iter().all(|meeting| !meeting.reflects);
        Partial {
            strength,
            is_first: is_straight || meetings.len() == 1,
            next: meeting.next_face(faces.stack.layers().len()),
            inward: meeting.goes_inward(),
            meetings,
            rays,
        }
    })
}
