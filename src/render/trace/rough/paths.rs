//! Selects the paths of light through a pane with rough faces, from the strongest on.
//!
//! Facets change the weights of paths: light that they turn to total reflection stays in the pane for many passages. So a
//! best-first search carries a bundle of rays along every path, in f64, at several angles of incidence, and compares the means of
//! their weights. The light that no selected path has is the sum of what the search has left.

use super::super::orders::MAX_ORDERS;
use super::super::sampler::{PixelSeed, sample};
use super::super::stack::{Exit, Stack};
use glam::DVec3;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// Number of angles of incidence.
const ANGLES: usize = 3;
/// Number of rays at each angle, for faces up to `ALMOST_SMOOTH` and for rougher ones, which turn some light to total reflection.
const RAYS: [u32; 2] = [64, 512];
const ALMOST_SMOOTH: f64 = 0.03;

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

/// A selected path.
pub(super) struct Selected {
    pub(super) exit: Exit,
    pub(super) meetings: Vec<Meeting>,
    /// Largest mean weight at all angles and of all colours.
    pub(super) max_weight: f64,
}

impl Selected {
    /// Returns the path that crosses each of the faces once.
    pub(super) fn straight(faces: usize) -> Self {
        let meeting = |face| Meeting { face, inward: true, reflects: false };
        let meetings = (0..faces).map(meeting).collect();
        Self { exit: Exit::Transmitted, meetings, max_weight: 1.0 }
    }
}

/// A ray of the search, in coordinates with the pane's normal as z, with its weights for s and p, and for each colour.
#[derive(Clone, Copy)]
struct Ray {
    direction: DVec3,
    power: [[f64; 3]; 2],
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
    /// Equal numbers of rays at each of [`ANGLES`] angles.
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

/// Returns the paths to the front (0) and to the back (1), those with few meetings first: the straight path and the reflection in
/// face 0, and the strongest others until the light that is left, times the side's largest radiance, is below `tolerance`. Also
/// returns this light, as a share of the incident light.
pub(super) fn select(
    stack: &Stack,
    alphas: &[f64],
    [least_cos, most_cos]: [f64; 2],
    max_radiance: [f64; 2],
    tolerance: f64,
) -> [(Vec<Selected>, f64); 2] {
    let last = (ANGLES - 1) as f64;
    let cosines: [f64; ANGLES] =
        std::array::from_fn(|i| least_cos + (most_cos - least_cos) * i as f64 / last);
    let start = |cos: f64| Ray {
        direction: DVec3::new((1.0 - cos * cos).max(0.0).sqrt(), 0.0, cos),
        power: [[1.0; 3]; 2],
    };
    let is_rough = alphas.iter().any(|alpha| *alpha > ALMOST_SMOOTH);
    let of_angle = RAYS[usize::from(is_rough)] as usize;
    let rays = cosines.iter().flat_map(|cos| vec![start(*cos); of_angle]).collect();
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
    let mut found: [Vec<Selected>; 2] = [vec![], vec![]];
    let tolerance = tolerance.max(f64::MIN_POSITIVE);
    for _ in 0..MOST_STEPS {
        let is_done = |side: usize| {
            found[side].len() == MAX_ORDERS as usize
                || (side == 1 || !found[0].is_empty())
                    && (inside + outside[side]) * max_radiance[side] < tolerance
        };
        if is_done(0) && is_done(1) {
            break;
        }
        let Some(path) = heap.pop() else { break };
        let Some(face) = path.next else {
            let side = usize::from(!path.inward);
            if !is_done(side) {
                outside[side] -= path.strength;
                let exit = [Exit::Transmitted, Exit::Reflected][side];
                let (meetings, max_weight) = (path.meetings, path.strength);
                found[side].push(Selected { exit, meetings, max_weight });
            }
            continue;
        };
        inside -= path.strength;
        for reflects in [false, true] {
            let next = go_on(stack, alphas, &cosines, &path, (face, reflects));
            match next.next {
                Some(_) => inside += next.strength,
                None => outside[usize::from(!next.inward)] += next.strength,
            }
            heap.push(next);
        }
    }
    let mut side = 0;
    found.map(|mut paths| {
        paths.sort_by_key(|path| path.meetings.len());
        // Differences of the sums may leave a rounding error.
        let left = (inside + outside[side]).max(0.0);
        side += 1;
        (paths, left)
    })
}

/// Continues a path by one face.
fn go_on(
    stack: &Stack,
    alphas: &[f64],
    cosines: &[f64; ANGLES],
    path: &Partial,
    (face, reflects): (usize, bool),
) -> Partial {
    let [near, far] = stack.iors(face);
    let iors = if path.inward { [near, far] } else { [far, near] };
    let mut meetings = path.meetings.clone();
    meetings.push(Meeting { face, inward: path.inward, reflects });
    let inward = path.inward != reflects;
    let next = if inward { face.checked_add(1) } else { face.checked_sub(1) };
    let next = next.filter(|face| *face <= stack.layers().len());
    let layer = next.map(|next| &stack.layers()[next.min(face)]);
    let coating = stack.coatings()[face].as_ref();
    let seed = PixelSeed::new(0, 0, 0).of_meeting(path.meetings.len() as u32);
    let of_angle = path.rays.len() / ANGLES;
    let facets: Vec<[f64; 2]> = (0..of_angle as u32)
        .map(|index| {
            let [u, v, ..] = sample(&seed, index);
            let angle = std::f64::consts::TAU * f64::from(v);
            let slope = alphas[face] * (-libm::log(1.0 - f64::from(u))).sqrt();
            [slope * libm::cos(angle), slope * libm::sin(angle)]
        })
        .collect();
    let mut rays = path.rays.clone();
    let mut strength = 0.0f64;
    for (rays, cos_i) in rays.chunks_mut(of_angle).zip(cosines) {
        let coated = coating.map(|coating| coating.share(path.inward, reflects).at(*cos_i));
        let mut sum = [0.0; 3];
        for (ray, facet) in rays.iter_mut().zip(&facets) {
            let (direction, shares) = scatter(ray.direction, *facet, iors, reflects);
            let passed = layer.map_or([1.0; 3], |layer| {
                let way_m = layer.thickness_m / direction.z.abs();
                layer.absorption_per_m.map(|a| libm::exp(-a * way_m))
            });
            ray.direction = direction;
            for (power, (fresnel, shape)) in ray.power.iter_mut().zip(shares) {
                for c in 0..3 {
                    power[c] *= coated.map_or(fresnel, |share| share[c]) * shape * passed[c];
                    sum[c] += 0.5 * power[c] / of_angle as f64;
                }
            }
        }
        strength = sum.into_iter().fold(strength, f64::max);
    }
    let is_straight = meetings.iter().all(|meeting| !meeting.reflects);
    let is_first = is_straight || meetings.len() == 1;
    Partial { strength, is_first, next, inward, meetings, rays }
}

/// Reflects or refracts a ray at a facet with these slopes. Returns its direction and, for s and p, Fresnel's share and the shape
/// factor |i.m| / (|i.n| |m.n|).
fn scatter(
    d: DVec3,
    [x, y]: [f64; 2],
    [before, behind]: [f64; 2],
    reflects: bool,
) -> (DVec3, [(f64, f64); 2]) {
    let m = DVec3::new(x, y, 1.0).normalize() * d.z.signum();
    let cos = d.dot(m);
    let eta = before / behind;
    let cos_t = (1.0 - eta * eta * (1.0 - cos * cos)).max(0.0).sqrt();
    let straight = if reflects { DVec3::new(d.x, d.y, -d.z) } else { d };
    let out = if reflects { d - 2.0 * cos * m } else { eta * d + (cos_t - eta * cos) * m };
    if cos <= 0.0 || out.z * straight.z <= 0.0 {
        return (straight, [(0.0, 0.0); 2]);
    }
    let shape = cos / (d.z.abs() * m.z.abs());
    let share = |a: f64, b: f64| {
        let part = if reflects { (a - b) * (a - b) } else { 4.0 * a * b };
        part / ((a + b) * (a + b))
    };
    let shares = [share(before * cos, behind * cos_t), share(behind * cos, before * cos_t)];
    (out, shares.map(|share| (share, shape)))
}
