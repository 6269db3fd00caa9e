//! Single paths through a stack, from the strongest on, for panes whose faces scatter light: paths of equal length, which are
//! one order of a smooth stack, leave rough faces in different lobes.

use super::super::orders::MAX_ORDERS;
use super::table::largest;
use super::{Exit, Power, Stack, product};
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// Largest number of steps of the search. The light of paths that it does not reach is a part of the tail.
const MOST_STEPS: usize = 50_000;

/// A face that a path meets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Meeting {
    pub face: usize,
    /// True if the light travels away from the camera before the face.
    pub inward: bool,
    pub reflects: bool,
}

/// A path from the camera to one side of a stack.
#[derive(Clone, Debug, PartialEq)]
pub struct StackPath {
    pub exit: Exit,
    pub meetings: Vec<Meeting>,
    /// Weights for unpolarised light, for each colour, at each cosine of the search.
    pub weights: Vec<[f64; 3]>,
}

impl StackPath {
    /// Returns the largest weight at all cosines and of all colours.
    pub fn max_weight(&self) -> f64 {
        largest(&self.weights)
    }
}

/// The paths of one side, those with few meetings first, and the light of all others, as a share of the incident light.
#[derive(Clone, Debug, PartialEq)]
pub struct SidePaths {
    pub paths: Vec<StackPath>,
    pub tail: f64,
}

/// A path of the search: to its next face, or to the end.
struct Partial {
    /// Largest weight at all cosines, for both polarisations and all colours.
    strength: f64,
    /// The next face; `None` after the last one.
    next: Option<usize>,
    /// True if the light travels away from the camera.
    inward: bool,
    meetings: Vec<Meeting>,
    powers: Vec<Power>,
}

impl Partial {
    /// Compares by strength; of two equal ones, the path with fewer meetings is the larger.
    fn order(&self, other: &Self) -> Ordering {
        let lengths = other.meetings.len().cmp(&self.meetings.len());
        let by_strength = self.strength.total_cmp(&other.strength);
        by_strength.then(lengths).then_with(|| other.meetings.cmp(&self.meetings))
    }
}

impl PartialEq for Partial {
    fn eq(&self, other: &Self) -> bool {
        self.order(other) == Ordering::Equal
    }
}

impl Eq for Partial {}

impl PartialOrd for Partial {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Partial {
    fn cmp(&self, other: &Self) -> Ordering {
        self.order(other)
    }
}

impl Stack {
    /// Returns the paths to the front (0) and to the back (1) at `cosines` of incidence, in (0, 1]: the straight path and the
    /// reflection in face 0, and the strongest others until the light of the rest, times the side's largest radiance, is below
    /// `tolerance`.
    pub fn paths(&self, cosines: &[f64], max_radiance: [f64; 2], tolerance: f64) -> [SidePaths; 2] {
        let optics: Vec<_> = cosines.iter().map(|&c| (self.faces(c), self.tau(c))).collect();
        let totals: Vec<_> = cosines.iter().map(|&c| self.totals(c)).collect();
        let mut rest =
            [1, 0].map(|of| totals.iter().map(|total| total[of]).collect::<Vec<[f64; 3]>>());
        let mut found = [vec![], vec![]];
        let mut heap = BinaryHeap::from([Partial {
            strength: f64::INFINITY,
            next: Some(0),
            inward: true,
            meetings: vec![],
            powers: vec![[[1.0; 3]; 2]; cosines.len()],
        }]);
        let tolerance = tolerance.max(f64::MIN_POSITIVE);
        for _ in 0..MOST_STEPS {
            let is_done = |side: usize| {
                found[side].len() == MAX_ORDERS as usize
                    || (side == 1 || !found[0].is_empty())
                        && largest(&rest[side]) * max_radiance[side] < tolerance
            };
            if is_done(0) && is_done(1) {
                break;
            }
            let Some(path) = heap.pop() else { break };
            let Some(face) = path.next else {
                let inward = path.inward;
                let (side, exit) =
                    if inward { (0, Exit::Transmitted) } else { (1, Exit::Reflected) };
                if is_done(side) {
                    continue;
                }
                let weights: Vec<[f64; 3]> = path.powers.iter().map(unpolarised).collect();
                for (rest, weight) in rest[side].iter_mut().zip(&weights) {
                    (0..3).for_each(|c| rest[c] -= weight[c]);
                }
                found[side].push(StackPath { exit, meetings: path.meetings, weights });
                continue;
            };
            for reflects in [false, true] {
                let mut meetings = path.meetings.clone();
                meetings.push(Meeting { face, inward: path.inward, reflects });
                let inward = path.inward != reflects;
                let next = if inward { face.checked_add(1) } else { face.checked_sub(1) };
                let next = next.filter(|face| *face <= self.layers.len());
                let mut powers = path.powers.clone();
                for (power, (faces, tau)) in powers.iter_mut().zip(&optics) {
                    let (reflectance, transmittance) = &faces[face];
                    *power = product(power, if reflects { reflectance } else { transmittance });
                    if next.is_some() {
                        let layer = if inward { face } else { face - 1 };
                        *power = product(power, &[tau[layer]; 2]);
                    }
                }
                // The straight path and the first reflection come before all others.
                let is_first = meetings.iter().all(|meeting| !meeting.reflects)
                    || meetings.len() == 1 && reflects;
                let strength = if is_first { f64::INFINITY } else { strongest(&powers) };
                heap.push(Partial { strength, next, inward, meetings, powers });
            }
        }
        let mut side = 0;
        found.map(|mut paths| {
            paths.sort_by_key(|path| path.meetings.len());
            let tail = largest(&rest[side]).max(0.0);
            side += 1;
            SidePaths { paths, tail }
        })
    }
}

fn unpolarised(power: &Power) -> [f64; 3] {
    [0, 1, 2].map(|c| 0.5 * (power[0][c] + power[1][c]))
}

fn strongest(powers: &[Power]) -> f64 {
    powers.as_flattened().as_flattened().iter().copied().fold(0.0, f64::max)
}
