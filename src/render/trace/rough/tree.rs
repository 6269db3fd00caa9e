//! The selected paths of a pane as a tree of meetings, and the light of all others.
//!
//! A camera sample meets each face of the tree once for all paths through it, with one facet, which splits its light without
//! loss or gain but for what facets hide. A branch of no selected path is *cut*: its light, which is known exactly, joins the last
//! path of the side on which it leaves ([`super::escape`]).

use super::super::sampler::{PixelSeed, sample};
use super::escape::Escaped;
use super::faces::{At, Faces, Ray};
use super::facet::facet_at;
use super::paths::{Meeting, Selected};
use super::shares::MeanShares;

/// Number of angles of incidence.
const ANGLES: usize = 3;
/// Rays are followed in batches of this size,
const BATCH: u32 = 64;
/// at least and at most this number of them, until the light of cuts and the lost light are known to `PRECISION` of themselves or
/// to `ABSOLUTE` of all light.
const BATCHES: [u32; 2] = [2, 16];
const PRECISION: f64 = 0.1;
const ABSOLUTE: f64 = 2.0e-5;
/// A pixel may have more of the rare rays that lose light than its share: the bound adds this share of all light, unless the mean is
/// below the other, so that no ray of an image loses any that shows.
const RARELY_LOST: f64 = 5.0e-5;
const LEAST_LOST: f64 = 1.0e-9;
/// Number of standard errors that the bounds add to the means, beside `PRECISION` of these for what lies between the angles.
const CERTAINTY: f64 = 3.0;
/// Slope of steep facets, in units of alpha: no sample meets one that is steeper than 4.08, and several that are less steep
/// together turn light hardly further.
const STEEPEST: f64 = 5.0;
/// Of the rays at a cut, those with this divisor tell how its light divides between the sides.
const DIVIDING: usize = 4;

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
        // Paths of many meetings would overflow the stack of a recursive function.
        let mut open = vec![(paths, None)];
        while let Some((paths, from)) = open.pop() {
            if let [(path, [])] = paths.as_slice() {
                tree.link(from, Branch::Leaf(*path));
            } else if paths.is_empty() {
                tree.link(from, Branch::Cut(tree.cuts));
                tree.cuts += usize::from(from.is_some());
            } else {
                let index = tree.add(paths[0].1[0], from);
                for reflects in [true, false] {
                    let of = paths.iter().filter(|(_, rest)| rest[0].reflects == reflects);
                    let of = of.map(|(path, rest)| (*path, &rest[1..])).collect();
                    open.push((of, Some((index, reflects))));
                }
            }
        }
        tree
    }

    /// Adds a meeting behind a branch. Returns its number.
    fn add(&mut self, meeting: Meeting, from: Option<(usize, bool)>) -> usize {
        let Meeting { face, inward, .. } = meeting;
        let index = self.nodes.len();
        self.link(from, Branch::To(index));
        let (before, depth) = from.map_or((None, 0), |(node, _)| {
            let node = &self.nodes[node];
            (Some(node.face), node.depth + 1)
        });
        self.nodes.push(Node { face, inward, before, depth, branches: [Branch::Cut(0); 2] });
        index
    }

    /// Returns the largest number of meetings of a path.
    fn depth(&self) -> usize {
        self.nodes.iter().map(|node| node.depth + 1).max().unwrap_or(0)
    }

    fn link(&mut self, from: Option<(usize, bool)>, to: Branch) {
        if let Some((node, reflects)) = from {
            self.nodes[node].branches[usize::from(reflects)] = to;
        }
    }
}

/// The light of a pane's paths and cuts.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Light {
    /// Largest mean weight of each path over all angles and colours.
    pub(super) max_weights: Vec<f64>,
    /// Largest weight of each path of a ray: rare rays with much light make the noise of an image.
    pub(super) peaks: Vec<f64>,
    /// The same of the light of cuts that leaves to the front and to the back.
    pub(super) cut_peaks: [f64; 2],
    /// For each cut, the shares of its light that leave to the front and to the back, for each colour.
    pub(super) divisions: Vec<[[f64; 3]; 2]>,
    /// Bounds of the shares of the light, over angles and colours, that cuts send to the front and to the back.
    pub(super) dropped: [f64; 2],
    /// Bound of the share of the light that facets hide or that leaves a face on the wrong side.
    pub(super) shadowed: f64,
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

impl AtAngle {
    fn new(paths: usize) -> Self {
        Self {
            rays: 0.0,
            weights: vec![[0.0; 3]; paths],
            peaks: vec![0.0; paths],
            cuts: vec![],
            lost: [0.0; 3],
            cut_peak: 0.0,
            errors: [0.0; 2],
        }
    }
}

/// Sums over rays of a cut at all angles: their light, what of it leaves on each side, and what smooth faces would not let out.
#[derive(Clone, Default)]
struct Behind {
    came: [f64; 3],
    left: [[f64; 3]; 2],
    trapped: [f64; 3],
}

/// A batch of rays on its way through a tree.
struct Batch<'a, 'b> {
    faces: &'b Faces<'a>,
    shares: &'b mut MeanShares,
    tree: &'b Tree,
    cos_i: f64,
    sums: &'b mut AtAngle,
    behind: &'b mut [Behind],
    /// Facets of each meeting, by the number of meetings before it.
    facets: &'b [Vec<[f64; 2]>],
    /// Light of all cuts of each ray, of its brightest colour: in the mean over the last facets, and with those that it met.
    of_rays: Vec<f64>,
    peaks: Vec<f64>,
    /// Light that is lost, of the brightest colour.
    lost: f64,
}

/// Measures the light of a tree of this number of paths, with rays at several angles between these cosines of incidence.
pub(super) fn measure(
    faces: &Faces<'_>,
    shares: &mut MeanShares,
    tree: &Tree,
    paths: usize,
    [least_cos, most_cos]: [f64; 2],
) -> Light {
    let mut behind = vec![Behind::default(); tree.cuts];
    let count = if most_cos - least_cos < 1e-9 { 1 } else { ANGLES };
    let angles: Vec<AtAngle> = (0..count)
        .map(|i| {
            let share = i as f64 / (ANGLES - 1) as f64;
            let cos_i = least_cos + (most_cos - least_cos) * share;
            at_angle(faces, shares, tree, (paths, cos_i), &mut behind)
        })
        .collect();
    let of_all = |light: [f64; 3], came: [f64; 3]| {
        [0, 1, 2].map(|c| if came[c] > 0.0 { light[c] / came[c] } else { 0.0 })
    };
    let divisions: Vec<[[f64; 3]; 2]> =
        behind.iter().map(|of| of.left.map(|left| of_all(left, of.came))).collect();
    let trapped: Vec<[f64; 3]> = behind.iter().map(|of| of_all(of.trapped, of.came)).collect();
    let largest = |of: &dyn Fn(&AtAngle, usize) -> f64| {
        let of_angle = |sums: &AtAngle| (0..3).map(|c| of(sums, c)).fold(0.0, f64::max);
        angles.iter().map(of_angle).fold(0.0, f64::max)
    };
    // The light of cuts at an angle, in these shares.
    let cut = |sums: &AtAngle, c: usize, share: &dyn Fn(usize) -> f64| -> f64 {
        let lights = sums.cuts.iter().enumerate();
        lights.map(|(cut, light)| light[c] * share(cut)).sum::<f64>() / sums.rays
    };
    let all_cuts = |sums: &AtAngle, c: usize| cut(sums, c, &|_| 1.0).max(f64::MIN_POSITIVE);
    let to_side =
        |sums: &AtAngle, c: usize, side: usize| cut(sums, c, &|cut| divisions[cut][side][c]);
    let dropped = [0, 1].map(|side: usize| {
        largest(&|sums, c| {
            // Light that is trapped between smooth faces may leave on either side of rough ones.
            let may_leave = |cut: usize| (divisions[cut][side][c] + trapped[cut][c]).min(1.0);
            let light = cut(sums, c, &may_leave);
            light * (1.0 + PRECISION + CERTAINTY * sums.errors[0] / all_cuts(sums, c))
        })
    });
    let shadowed = largest(&|sums, c| {
        (1.0 + PRECISION) * sums.lost[c] / sums.rays + CERTAINTY * sums.errors[1]
    });
    let shadowed = if shadowed > LEAST_LOST { shadowed + RARELY_LOST } else { shadowed };
    let max_weights =
        (0..paths).map(|path| largest(&|sums, c| sums.weights[path][c] / sums.rays)).collect();
    let peaks = (0..paths).map(|path| largest(&|sums, _| sums.peaks[path])).collect();
    let cut_peaks = [0, 1]
        .map(|side| largest(&|sums, c| sums.cut_peak * to_side(sums, c, side) / all_cuts(sums, c)));
    Light { max_weights, peaks, cut_peaks, divisions, dropped, shadowed }
}

/// Follows batches of rays at one angle until their sums are known well enough.
fn at_angle(
    faces: &Faces<'_>,
    shares: &mut MeanShares,
    tree: &Tree,
    (paths, cos_i): (usize, f64),
    behind: &mut [Behind],
) -> AtAngle {
    let mut sums = AtAngle { cuts: vec![[0.0; 3]; tree.cuts], ..AtAngle::new(paths) };
    add_extremes(faces, shares, tree, cos_i, &mut sums);
    let depth = tree.depth();
    let mut of_batches: Vec<[f64; 2]> = vec![];
    for number in 0..BATCHES[1] {
        let indices = number * BATCH..(number + 1) * BATCH;
        let of_meeting = |k: u32| -> Vec<[f64; 2]> {
            let seed = PixelSeed::new(0, 0, 0).of_meeting(k);
            let of = |index: u32| {
                let [u, v, ..] = sample(&seed, index);
                facet_at([u, v])
            };
            indices.clone().map(of).collect()
        };
        let facets: Vec<Vec<[f64; 2]>> = (0..depth as u32).map(of_meeting).collect();
        let rays = faces.camera_rays(cos_i, indices.start, BATCH as usize);
        let mut batch = Batch {
            faces,
            shares,
            tree,
            cos_i,
            sums: &mut sums,
            behind,
            facets: &facets,
            of_rays: vec![0.0; rays.len()],
            peaks: vec![0.0; rays.len()],
            lost: 0.0,
        };
        batch.follow(rays);
        let (peaks, lost) = (batch.peaks, batch.lost);
        let of_cuts: f64 = batch.of_rays.iter().sum();
        of_batches.push([of_cuts, lost].map(|sum| sum / f64::from(BATCH)));
        sums.rays += f64::from(BATCH);
        sums.cut_peak = peaks.into_iter().fold(sums.cut_peak, f64::max);
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

/// Finds the largest weights of rays that meet one steep facet, upwards or downwards, at each of the meetings: the rays of an image are many
/// more than those of all batches.
fn add_extremes(
    faces: &Faces<'_>,
    shares: &mut MeanShares,
    tree: &Tree,
    cos_i: f64,
    sums: &mut AtAngle,
) {
    if faces.alphas.iter().all(|alpha| *alpha == 0.0) {
        return;
    }
    let depth = tree.depth();
    let steep = [faces.azimuth.x * STEEPEST, faces.azimuth.y * STEEPEST];
    let of_ray = |k: usize, meeting: usize| match (k / 2 == meeting, k % 2) {
        (false, _) => [0.0; 2],
        (true, 0) => steep,
        (true, _) => steep.map(|slope| -slope),
    };
    let facets: Vec<Vec<[f64; 2]>> =
        (0..depth).map(|meeting| (0..2 * depth).map(|k| of_ray(k, meeting)).collect()).collect();
    let mut of_rare = AtAngle { cuts: sums.cuts.clone(), ..AtAngle::new(sums.weights.len()) };
    let mut batch = Batch {
        faces,
        shares,
        tree,
        cos_i,
        sums: &mut of_rare,
        behind: &mut vec![Behind::default(); tree.cuts],
        facets: &facets,
        of_rays: vec![0.0; 2 * depth],
        peaks: vec![0.0; 2 * depth],
        lost: 0.0,
    };
    batch.follow(faces.camera_rays(cos_i, 0, 2 * depth));
    sums.cut_peak = batch.peaks.into_iter().fold(sums.cut_peak, f64::max);
    for (peak, rare) in sums.peaks.iter_mut().zip(of_rare.peaks) {
        *peak = peak.max(rare);
    }
}

impl Batch<'_, '_> {
    /// Follows rays from the first node along all branches.
    fn follow(&mut self, rays: Vec<Ray>) {
        let mut arrived = vec![vec![]; self.tree.nodes.len()];
        if let Some(first) = arrived.first_mut() {
            *first = rays;
        }
        for index in 0..arrived.len() {
            let rays = std::mem::take(&mut arrived[index]);
            let node = &self.tree.nodes[index];
            let split = self.split(node, &rays);
            for (reflects, rays) in [false, true].into_iter().zip(split) {
                let meeting = Meeting { face: node.face, inward: node.inward, reflects };
                match node.branches[usize::from(reflects)] {
                    Branch::To(next) => {
                        arrived[next] = rays.into_iter().map(|(ray, _)| ray).collect();
                    }
                    Branch::Leaf(path) => {
                        for (ray, mean) in rays {
                            (0..3).for_each(|c| self.sums.weights[path][c] += mean[c]);
                            let peak = &mut self.sums.peaks[path];
                            *peak = ray.weights().into_iter().fold(*peak, f64::max);
                        }
                    }
                    Branch::Cut(cut) => self.cut((meeting, cut), &rays),
                }
            }
        }
    }

    /// Splits rays at a node: into those that pass and those that are reflected, each with its mean weights over all facets.
    fn split(&mut self, node: &Node, rays: &[Ray]) -> [Vec<(Ray, [f64; 3])>; 2] {
        let at = At { face: node.face, inward: node.inward, cos_i: self.cos_i };
        let mut split: [Vec<(Ray, [f64; 3])>; 2] = [vec![], vec![]];
        for (ray, facet) in rays.iter().zip(&self.facets[node.depth]) {
            let (branches, lost) = self.shares.split(self.faces, ray, at, *facet);
            (0..3).for_each(|c| self.sums.lost[c] += lost[c]);
            self.lost += lost.into_iter().fold(0.0, f64::max);
            for (split, of) in split.iter_mut().zip(branches) {
                split.push(of);
            }
        }
        split
    }

    /// Adds the light of a cut, and divides that of some of its rays.
    fn cut(&mut self, (meeting, cut): (Meeting, usize), rays: &[(Ray, [f64; 3])]) {
        for (k, (ray, mean)) in rays.iter().enumerate() {
            (0..3).for_each(|c| self.sums.cuts[cut][c] += mean[c]);
            self.of_rays[k] += mean.iter().copied().fold(0.0, f64::max);
            let light = ray.weights();
            self.peaks[k] += light.into_iter().fold(0.0, f64::max);
            if k % DIVIDING == 0 && light != [0.0; 3] {
                let Escaped { left, trapped } = self.faces.escape(ray, meeting, self.cos_i);
                let behind = &mut self.behind[cut];
                for c in 0..3 {
                    behind.came[c] += light[c];
                    behind.trapped[c] += trapped[c];
                    (0..2).for_each(|side| behind.left[side][c] += left[side][c]);
                }
            }
        }
    }
}
