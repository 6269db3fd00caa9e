//! The selected paths of a pane as a tree of meetings, and the light of all others.
//!
//! A camera sample meets each face of the tree once for all paths through it, with one facet, which splits its light without
//! loss or gain but for what facets hide. A branch of no selected path is *cut*: its light, which is known exactly, joins the last
//! path of the side on which it leaves. How a cut's light divides between the sides is a mean over rays that go on at random in f64.

use super::super::sampler::{PixelSeed, sample};
use super::super::stack::Exit;
use super::facet::facet_at;
use super::paths::{Faces, Meeting, Ray, Selected};

/// Number of angles of incidence.
const ANGLES: usize = 3;
/// Rays are followed in batches of this size,
const BATCH: u32 = 64;
/// at least and at most this number of them, until the light of cuts and the lost light are known to `PRECISION` of themselves or
/// to `ABSOLUTE` of all light.
const BATCHES: [u32; 2] = [2, 16];
const PRECISION: f64 = 0.1;
const ABSOLUTE: f64 = 2.0e-5;
/// Number of standard errors that the bounds add to the means.
const CERTAINTY: f64 = 3.0;
/// Every ray with this divisor goes on at random behind a cut.
const WALKERS: usize = 8;
/// Largest number of faces that such a ray meets; the light that it still has then counts as hidden.
const MOST_WALKS: u32 = 400;
/// Share of its light below which a ray behind a cut ends.
const LEAST_POWER: f64 = 1.0e-6;

/// Where a branch of a meeting leads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Branch {
    /// To the next meeting of the tree.
    To(usize),
    /// Out of the pane, along the path with this number: those of the front come before those of the back.
    Leaf(usize),
    /// To no selected path, with the number of the cut.
    Cut(usize),
}

/// A meeting of a path's light with a face.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Node {
    pub(super) face: usize,
    pub(super) inward: bool,
    /// Face before it; `None` at the first meeting.
    pub(super) before: Option<usize>,
    /// Number of meetings before it.
    pub(super) depth: usize,
    /// Where light goes that passes the face, and where light goes that it reflects.
    pub(super) branches: [Branch; 2],
}

/// Meetings of a pane's paths. Each comes before the meetings behind it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Tree {
    pub(super) nodes: Vec<Node>,
    pub(super) cuts: usize,
}

impl Tree {
    /// Makes the tree of these paths of the front and of the back.
    pub(super) fn new(sides: &[Vec<Selected>; 2]) -> Self {
        let paths: Vec<(usize, &[Meeting])> =
            sides.iter().flatten().map(|path| path.meetings.as_slice()).enumerate().collect();
        let mut tree = Self { nodes: vec![], cuts: 0 };
        if !paths.is_empty() {
            tree.grow(&paths, None);
        }
        tree
    }

    /// Adds the next meeting of these paths and all behind it. Returns its number.
    fn grow(&mut self, paths: &[(usize, &[Meeting])], before: Option<(usize, usize)>) -> usize {
        let Meeting { face, inward, .. } = paths[0].1[0];
        let (before, depth) = before.map_or((None, 0), |(face, depth)| (Some(face), depth));
        let index = self.nodes.len();
        let branches = [Branch::Cut(0); 2];
        self.nodes.push(Node { face, inward, before, depth, branches });
        for reflects in [false, true] {
            let of: Vec<(usize, &[Meeting])> = paths
                .iter()
                .filter(|(_, rest)| rest[0].reflects == reflects)
                .map(|(path, rest)| (*path, &rest[1..]))
                .collect();
            let branch = match of.as_slice() {
                [] => {
                    self.cuts += 1;
                    Branch::Cut(self.cuts - 1)
                }
                [(path, [])] => Branch::Leaf(*path),
                _ => Branch::To(self.grow(&of, Some((face, depth + 1)))),
            };
            self.nodes[index].branches[usize::from(reflects)] = branch;
        }
        index
    }
}

/// The light of a pane's paths and cuts.
#[derive(Clone, Debug)]
pub(super) struct Light {
    /// Largest mean weight of each path over all angles and colours.
    pub(super) max_weights: Vec<f64>,
    /// Largest weight of each path of a ray: rare rays with much light make the noise of an image. That of the last path of a side
    /// includes the light of cuts.
    pub(super) peaks: Vec<f64>,
    /// For each cut, the shares of its light that leave to the front and to the back, for each colour.
    pub(super) divisions: Vec<[[f64; 3]; 2]>,
    /// Bounds of the shares of the light, over angles and colours, that cuts send to the front and to the back.
    pub(super) dropped: [f64; 2],
    /// Bound of the share of the light that facets hide or that leaves a face on the wrong side.
    pub(super) shadowed: f64,
}

impl Light {
    /// Returns the light of a pane some of whose rays have that of `self`, and the others `other`.
    pub(super) fn or(self, other: Self) -> Self {
        let larger = |one: Vec<f64>, other: Vec<f64>| -> Vec<f64> {
            one.into_iter().zip(other).map(|(a, b)| a.max(b)).collect()
        };
        let mean = |(one, other): ([[f64; 3]; 2], [[f64; 3]; 2])| {
            [0, 1].map(|side| [0, 1, 2].map(|c| 0.5 * (one[side][c] + other[side][c])))
        };
        Self {
            max_weights: larger(self.max_weights, other.max_weights),
            peaks: larger(self.peaks, other.peaks),
            divisions: self.divisions.into_iter().zip(other.divisions).map(mean).collect(),
            dropped: [0, 1].map(|side| self.dropped[side].max(other.dropped[side])),
            shadowed: self.shadowed.max(other.shadowed),
        }
    }
}

/// Sums over the rays at one angle, and their number.
struct AtAngle {
    rays: f64,
    weights: Vec<[f64; 3]>,
    /// Largest weight of each path, of the brightest colour.
    peaks: Vec<f64>,
    cuts: Vec<[f64; 3]>,
    /// Light that is lost before cuts.
    lost: [f64; 3],
    /// Largest light of all cuts of a ray.
    cut_peak: f64,
    /// Standard errors of the mean light of all cuts, and of all that is lost.
    errors: [f64; 2],
}

/// Rays behind a cut that go on at random, and their sums over all angles: what came, and what left on each side.
#[derive(Clone, Default)]
struct Behind {
    came: [f64; 3],
    left: [[f64; 3]; 2],
}

/// A batch of rays on its way through a tree.
struct Batch<'a> {
    faces: &'a Faces<'a>,
    tree: &'a Tree,
    cos_i: f64,
    /// Index of the first ray.
    first: u32,
    sums: &'a mut AtAngle,
    behind: &'a mut [Behind],
    /// Facets of each meeting, by the number of meetings before it.
    facets: Vec<Vec<[f64; 2]>>,
    /// Light of all cuts of each ray, of its brightest colour.
    of_rays: Vec<f64>,
    /// Light that is lost, and that is lost behind cuts, of the brightest colour.
    lost: f64,
}

/// Measures the light of a tree with rays at several angles between these cosines of incidence. `last` are the last paths of the sides.
pub(super) fn measure(
    faces: &Faces<'_>,
    tree: &Tree,
    (paths, last): (usize, [Option<usize>; 2]),
    [least_cos, most_cos]: [f64; 2],
) -> Light {
    let mut behind = vec![Behind::default(); tree.cuts];
    let count = if most_cos - least_cos < 1e-9 { 1 } else { ANGLES };
    let angles: Vec<AtAngle> = (0..count)
        .map(|i| {
            let share = i as f64 / (ANGLES - 1) as f64;
            let cos_i = least_cos + (most_cos - least_cos) * share;
            at_angle(faces, tree, (paths, cos_i), &mut behind)
        })
        .collect();
    let divisions: Vec<[[f64; 3]; 2]> = behind
        .iter()
        .map(|Behind { came, left }| {
            // The colours of a ray share one random choice, so that more of one can leave than came.
            let all = |c: usize| came[c].max(left[0][c] + left[1][c]);
            left.map(|left| [0, 1, 2].map(|c| if came[c] > 0.0 { left[c] / all(c) } else { 0.0 }))
        })
        .collect();
    let largest = |of: &dyn Fn(&AtAngle, usize) -> f64| {
        let of_angle = |sums: &AtAngle| (0..3).map(|c| of(sums, c)).fold(0.0, f64::max);
        angles.iter().map(of_angle).fold(0.0, f64::max)
    };
    let cut = |sums: &AtAngle, c: usize, part: &dyn Fn(&[[f64; 3]; 2]) -> f64| -> f64 {
        let of = |(light, division): (&[f64; 3], &[[f64; 3]; 2])| light[c] * part(division);
        sums.cuts.iter().zip(&divisions).map(of).sum::<f64>() / sums.rays
    };
    let all_cuts = |sums: &AtAngle, c: usize| cut(sums, c, &|_| 1.0).max(f64::MIN_POSITIVE);
    let to_side = |sums: &AtAngle, c: usize, side: usize| cut(sums, c, &|of| of[side][c]);
    let dropped = [0, 1].map(|side: usize| {
        largest(&|sums, c| {
            let light = to_side(sums, c, side);
            light + CERTAINTY * sums.errors[0] * light / all_cuts(sums, c)
        })
    });
    let shadowed = largest(&|sums, c| {
        let behind_cuts = cut(sums, c, &|of| (1.0 - of[0][c] - of[1][c]).max(0.0));
        sums.lost[c] / sums.rays + behind_cuts + CERTAINTY * sums.errors[1]
    });
    let max_weights =
        (0..paths).map(|path| largest(&|sums, c| sums.weights[path][c] / sums.rays)).collect();
    let peaks = (0..paths).map(|path| {
        largest(&|sums, c| {
            let side = last.iter().position(|last| *last == Some(path));
            let share = |side| to_side(sums, c, side) / all_cuts(sums, c);
            sums.peaks[path] + side.map_or(0.0, |side| sums.cut_peak * share(side))
        })
    });
    Light { max_weights, peaks: peaks.collect(), divisions, dropped, shadowed }
}

/// Follows batches of rays at one angle until their sums are known well enough.
fn at_angle(
    faces: &Faces<'_>,
    tree: &Tree,
    (paths, cos_i): (usize, f64),
    behind: &mut [Behind],
) -> AtAngle {
    let mut sums = AtAngle {
        rays: 0.0,
        weights: vec![[0.0; 3]; paths],
        peaks: vec![0.0; paths],
        cuts: vec![[0.0; 3]; tree.cuts],
        lost: [0.0; 3],
        cut_peak: 0.0,
        errors: [0.0; 2],
    };
    let mut of_batches: Vec<[f64; 2]> = vec![];
    for number in 0..BATCHES[1] {
        let mut batch = Batch {
            faces,
            tree,
            cos_i,
            first: number * BATCH,
            sums: &mut sums,
            behind,
            facets: vec![],
            of_rays: vec![0.0; BATCH as usize],
            lost: 0.0,
        };
        batch.descend(0, &vec![Ray::at(cos_i); BATCH as usize]);
        let (of_rays, lost) = (batch.of_rays, batch.lost);
        let of_cuts: f64 = of_rays.iter().sum();
        of_batches.push([of_cuts, lost].map(|sum| sum / f64::from(BATCH)));
        sums.rays += f64::from(BATCH);
        sums.cut_peak = of_rays.into_iter().fold(sums.cut_peak, f64::max);
        if number + 1 < BATCHES[0] {
            continue;
        }
        let n = of_batches.len() as f64;
        let mean = [0, 1].map(|k| of_batches.iter().map(|of| of[k]).sum::<f64>() / n);
        sums.errors = [0, 1].map(|k| {
            let square = |of: &[f64; 2]| (of[k] - mean[k]) * (of[k] - mean[k]);
            (of_batches.iter().map(square).sum::<f64>() / (n * (n - 1.0))).sqrt()
        });
        let is_known = |k: usize| sums.errors[k] <= (PRECISION * mean[k]).max(ABSOLUTE);
        if is_known(0) && is_known(1) {
            break;
        }
    }
    sums
}

impl Batch<'_> {
    /// Splits rays at a node and follows its branches.
    fn descend(&mut self, index: usize, rays: &[Ray]) {
        let node = &self.tree.nodes[index];
        while self.facets.len() <= node.depth {
            let seed = PixelSeed::new(0, 0, 0).of_meeting(self.facets.len() as u32);
            let of = |index: u32| {
                let [u, v, ..] = sample(&seed, index);
                facet_at([u, v])
            };
            self.facets.push((self.first..self.first + BATCH).map(of).collect());
        }
        let mut split: [Vec<Ray>; 2] = [vec![], vec![]];
        for (k, ray) in rays.iter().enumerate() {
            let facet = self.facets[node.depth][k];
            let both = self.faces.split(ray, (node.face, node.inward), facet, self.cos_i);
            for (split, (ray, lost)) in split.iter_mut().zip(both) {
                (0..3).for_each(|c| self.sums.lost[c] += lost[c]);
                self.lost += lost.into_iter().fold(0.0, f64::max);
                split.push(ray);
            }
        }
        for (reflects, rays) in [false, true].into_iter().zip(split) {
            let meeting = Meeting { face: node.face, inward: node.inward, reflects };
            match node.branches[usize::from(reflects)] {
                Branch::To(next) => self.descend(next, &rays),
                Branch::Leaf(path) => {
                    for weights in rays.iter().map(Ray::weights) {
                        (0..3).for_each(|c| self.sums.weights[path][c] += weights[c]);
                        let peak = &mut self.sums.peaks[path];
                        *peak = weights.into_iter().fold(*peak, f64::max);
                    }
                }
                Branch::Cut(cut) => self.cut((meeting, node.depth, cut), &rays),
            }
        }
    }

    /// Adds the light of a cut, and lets some of its rays go on.
    fn cut(&mut self, (meeting, depth, cut): (Meeting, usize, usize), rays: &[Ray]) {
        for (k, ray) in rays.iter().enumerate() {
            let light = ray.weights();
            (0..3).for_each(|c| self.sums.cuts[cut][c] += light[c]);
            self.of_rays[k] += light.into_iter().fold(0.0, f64::max);
            if k % WALKERS == 0 && light != [0.0; 3] {
                let at = (meeting, depth, self.first + k as u32, self.cos_i);
                let [front, back] = go_on_at_random(self.faces, at, ray);
                let behind = &mut self.behind[cut];
                let mut lost = 0.0f64;
                for c in 0..3 {
                    behind.came[c] += light[c];
                    behind.left[0][c] += front[c];
                    behind.left[1][c] += back[c];
                    lost = lost.max(light[c] - front[c] - back[c]);
                }
                self.lost += WALKERS as f64 * lost;
            }
        }
    }
}

/// Follows a ray behind a cut, which passes a face or is reflected at random, with the probability of its light. Returns the light
/// that leaves to the front and to the back.
fn go_on_at_random(
    faces: &Faces<'_>,
    (mut meeting, depth, index, cos_i): (Meeting, usize, u32, f64),
    ray: &Ray,
) -> [[f64; 3]; 2] {
    let mut ray = *ray;
    let brightest = |ray: &Ray| ray.weights().into_iter().fold(0.0, f64::max);
    let least = LEAST_POWER * brightest(&ray);
    for k in (depth as u32 + 1..).take(MOST_WALKS as usize) {
        let Some(face) = meeting.next_face(faces.stack.layers().len()) else {
            let mut left = [[0.0; 3]; 2];
            left[usize::from(meeting.exit() == Exit::Reflected)] = ray.weights();
            return left;
        };
        let inward = meeting.goes_inward();
        let [u, v, choice, _] = sample(&PixelSeed::new(1, 0, 0).of_meeting(k), index);
        let both = faces.split(&ray, (face, inward), facet_at([u, v]), cos_i);
        let [passed, reflected] = both.map(|(ray, _)| (ray, brightest(&ray)));
        let all = passed.1 + reflected.1;
        let reflects = f64::from(choice) * all >= passed.1;
        let (next, light) = if reflects { reflected } else { passed };
        if light <= least {
            break;
        }
        ray = next;
        let scale = all / light;
        ray.power.as_flattened_mut().iter_mut().for_each(|power| *power *= scale);
        meeting = Meeting { face, inward, reflects };
    }
    [[0.0; 3]; 2]
}
