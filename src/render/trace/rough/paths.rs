//! Selects the paths of light through a pane with rough faces, from the strongest on.
//!
//! Facets change the weights of paths: light that they turn to total reflection stays in the pane for many passages. So a
//! best-first search carries a few rays along every path, in f64, at several angles of incidence, and compares the means of
//! their weights over the facets of the last face ([`super::shares`]). The light that no selected path has is the sum of what the search has left.

use super::super::orders::MOST_PATHS;
use super::super::sampler::{PixelSeed, sample};
use super::super::stack::Exit;
use super::faces::{At, Faces, Ray};
use super::facet::facet_at;
use super::shares::MeanShares;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// Number of angles of incidence.
const ANGLES: usize = 3;
/// Number of rays at each angle.
const RAYS: usize = 32;

/// Largest number of steps of the search, and of meetings of a path. The light of paths that it does not reach is left: after so many
/// meetings, it is light that facets have turned to total reflection, and leaves in all directions.
const MOST_STEPS: usize = 4000;
const MOST_MEETINGS: usize = 64;

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
    shares: &mut MeanShares,
    [least_cos, most_cos]: [f64; 2],
    max_radiance: [f64; 2],
    tolerance: f64,
) -> Selection {
    let last = (ANGLES - 1) as f64;
    let cosines: [f64; ANGLES] =
        std::array::from_fn(|i| least_cos + (most_cos - least_cos) * i as f64 / last);
    let rays = cosines.iter().flat_map(|cos| faces.camera_rays(*cos, 0, RAYS)).collect();
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
        let strongest = heap.peek().map_or(0.0, |path| path.strength);
        let is_done = |side: usize| {
            let count = sides[side].len();
            let has_first = count > 0 || (side == 1 && max_radiance[1] == 0.0);
            let rest = [inside + outside[side], strongest];
            has_first && !MOST_PATHS.needs_path(count, rest, max_radiance[side], tolerance)
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
        if path.meetings.len() == MOST_MEETINGS {
            continue;
        }
        inside -= path.strength;
        for next in go_on(faces, shares, &cosines, &path, face) {
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
fn go_on(
    faces: &Faces<'_>,
    shares: &mut MeanShares,
    cosines: &[f64; ANGLES],
    path: &Partial,
    face: usize,
) -> [Partial; 2] {
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
            let at = At { face, inward: path.inward, cos_i: *cos_i };
            let (split, _) = shares.split(faces, &path.rays[index], at, *facet);
            for (branch, (ray, mean)) in split.into_iter().enumerate() {
                (0..3).for_each(|c| sums[branch][c] += mean[c] / RAYS as f64);
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
