//! Rays along the paths through rough faces, in lanes; [`super`] has the formulas.

use super::super::bent::RayLanes;
use super::super::camera::concentric_disc;
use super::super::lanes::{CHUNK, LANES, Lane, exp_neg, max, min, neg_ln};
use super::super::patch::Patch;
use super::super::sampler::{SeedLanes, points};
use super::super::scene::Sampling;
use super::{RoughPane, RoughPath, Step};
use glam::Vec3;

/// Least cosine of a direction's angle to the normal of a face, and to the optical axis. Flatter rays would
/// leave the numbers' range.
const LEAST_COS: f32 = 1.0e-4;

/// Largest square of a facet's coordinates in the unit disc, from which its slopes are drawn: the logarithm of 0 has no end.
const MOST_OF_DISC: f32 = 1.0 - 1.0 / 16_777_216.0;

/// Rays of a chunk along one path, after the glass (of the mirrored world, for reflected light).
pub(in super::super) struct RoughRays {
    /// Slopes of the facets of a face with roughness 1 (across and down), for each meeting of a path.
    slopes: Vec<[[Lane; CHUNK]; 2]>,
    /// Number of meetings whose slopes belong to the current chunk, and its samples.
    ready: usize,
    first: u32,
    count: usize,
    /// Directions (x, y, 1) relative to the pixels' centres.
    relative: [[Lane; CHUNK]; 2],
    /// Points in the plane z = 0, m.
    point: [[Lane; CHUNK]; 2],
    /// Weights for red, green and blue; only the first are set if the pane is not coloured.
    pub(in super::super) weight: [[Lane; CHUNK]; 3],
    /// True if the weights of the three colours differ.
    pub(in super::super) is_coloured: bool,
}

/// Sixteen rays on their way through the pane. Points are relative to the pivot.
struct Travellers {
    point: [Lane; 3],
    direction: [Lane; 3],
    /// Weights for s and p polarised light, without coatings and absorption.
    power: [Lane; 2],
    /// Optical depths of red, green and blue.
    depth: [Lane; 3],
}

impl RoughRays {
    pub(in super::super) fn new() -> Box<Self> {
        let lanes = [[0.0; LANES]; CHUNK];
        Box::new(Self {
            slopes: vec![],
            ready: 0,
            first: 0,
            count: 0,
            relative: [lanes; 2],
            point: [lanes; 2],
            weight: [lanes; 3],
            is_coloured: false,
        })
    }

    /// Begins a chunk with the samples `first .. first + count` of each pixel.
    pub(in super::super) fn begin(&mut self, first: u32, count: usize) {
        (self.ready, self.first, self.count) = (0, first, count);
    }

    /// Draws the slopes of the facets of the first `meetings` faces of all paths of the chunk.
    #[inline(always)]
    fn draw(&mut self, sampling: Sampling, seeds: &SeedLanes, meetings: usize) {
        if self.slopes.len() < meetings {
            self.slopes.resize(meetings, [[[0.0; LANES]; CHUNK]; 2]);
        }
        for k in self.ready..meetings {
            let [x, y] = &mut self.slopes[k];
            let (x, y) = (&mut x[..self.count], &mut y[..self.count]);
            points(sampling, &seeds.of_meeting(k as u32), 0, self.first, x, y);
            for s in 0..self.count {
                for l in 0..LANES {
                    (x[s][l], y[s][l]) = slopes(x[s][l], y[s][l]);
                }
            }
        }
        self.ready = self.ready.max(meetings);
    }

    /// Traces the first `count` rays of the chunk along a path.
    #[inline(always)]
    pub(in super::super) fn follow(
        &mut self,
        (pane, path): (&RoughPane, &RoughPath),
        sampling: Sampling,
        patch: &Patch,
        direction: &[[Lane; CHUNK]; 2],
        lens: &[[Lane; CHUNK]; 2],
        count: usize,
    ) {
        self.draw(sampling, &patch.seeds, path.steps.len());
        self.is_coloured = pane.is_coloured;
        for s in 0..count {
            let start = [&direction[0][s], &direction[1][s], &lens[0][s], &lens[1][s]];
            let mut rays = Travellers::new(pane, &patch.center, start);
            for (k, step) in path.steps.iter().enumerate() {
                let slopes = [&self.slopes[k][0][s], &self.slopes[k][1][s]];
                if pane.curvature_per_m == 0.0 {
                    rays.meet::<false>(pane, step, k == 0, slopes);
                } else {
                    rays.meet::<true>(pane, step, k == 0, slopes);
                }
            }
            self.leave(pane, path, &rays, &patch.center, s);
        }
    }

    /// Returns the rays of sample `s`.
    #[inline(always)]
    pub(in super::super) fn rays(&self, s: usize) -> RayLanes {
        let of = |lanes: &[[Lane; CHUNK]; 2]| [lanes[0][s], lanes[1][s]];
        RayLanes { relative: of(&self.relative), point: of(&self.point) }
    }

    /// Stores the rays of sample `s` after their last face.
    #[inline(always)]
    fn leave(
        &mut self,
        pane: &RoughPane,
        path: &RoughPath,
        rays: &Travellers,
        center: &[Lane; 2],
        s: usize,
    ) {
        let n = pane.axes[0];
        // Reflected rays are mirrored in the plane of the pane.
        let mirrored = if path.is_front { 0.0 } else { 2.0 };
        for l in 0..LANES {
            let (p, d) = (lane(&rays.point, l), lane(&rays.direction, l));
            let p = p - n * (mirrored * dot(p, n));
            let d = d - n * (mirrored * dot(d, n));
            let inverse = 1.0 / max(d.z, LEAST_COS);
            let (dx, dy) = (d.x * inverse, d.y * inverse);
            self.relative[0][s][l] = dx - center[0][l];
            self.relative[1][s][l] = dy - center[1][l];
            self.point[0][s][l] = p.x - dx * (p.z + pane.distance_m);
            self.point[1][s][l] = p.y - dy * (p.z + pane.distance_m);
        }
        for c in 0..if pane.is_coloured { 3 } else { 1 } {
            for l in 0..LANES {
                let share = if path.absorbs { exp_neg(max(rays.depth[c][l], 0.0)) } else { 1.0 };
                let power = 0.5 * (rays.power[0][l] + rays.power[1][l]);
                self.weight[c][s][l] = power * path.coated[c] * share;
            }
        }
    }
}

impl Travellers {
    /// Starts at the lens, with directions relative to `center` and lens points.
    #[inline(always)]
    fn new(pane: &RoughPane, center: &[Lane; 2], [dx, dy, ax, ay]: [&Lane; 4]) -> Self {
        let mut rays = Self {
            point: [[0.0; LANES], [0.0; LANES], [-pane.distance_m; LANES]],
            direction: [[0.0; LANES]; 3],
            power: [[1.0; LANES]; 2],
            depth: [[0.0; LANES]; 3],
        };
        for l in 0..LANES {
            let (x, y) = (center[0][l] + dx[l], center[1][l] + dy[l]);
            let inverse = 1.0 / (1.0 + (x * x + y * y)).sqrt();
            rays.point[0][l] = ax[l];
            rays.point[1][l] = ay[l];
            rays.direction[0][l] = x * inverse;
            rays.direction[1][l] = y * inverse;
            rays.direction[2][l] = inverse;
        }
        rays
    }

    /// Moves the rays to a face, and reflects or refracts them there at facets with these slopes over alpha.
    #[inline(always)]
    fn meet<const BENT: bool>(
        &mut self,
        pane: &RoughPane,
        step: &Step,
        is_first: bool,
        slopes: [&Lane; 2],
    ) {
        let [n, across, down] = pane.axes;
        let kappa = pane.curvature_per_m;
        let (alpha, [before, behind]) = (step.alpha, step.ior);
        let eta = before / behind;
        for l in 0..LANES {
            let (p, d) = (lane(&self.point, l), lane(&self.direction, l));
            let along = dot(d, n);
            let way_m = if BENT {
                let linear = kappa * dot(p, d) + along;
                let from_lens = kappa * dot(p, p) + 2.0 * dot(p, n);
                let constant = if is_first { from_lens } else { step.constant_m };
                let root = max(linear * linear - kappa * constant, 0.0).sqrt();
                -constant / (linear + root.copysign(linear))
            } else {
                (if is_first { -dot(p, n) } else { step.travel_m }) / along
            };
            let p = p + d * way_m;
            let (n, across, down) = if BENT {
                let n = (n + p * kappa) * step.inverse_ratio;
                let across = across - n * dot(across, n);
                let across = across * (1.0 / dot(across, across).sqrt());
                (n, across, cross(n, across))
            } else {
                (n, across, down)
            };
            for c in 0..3 {
                self.depth[c][l] += step.absorption_per_m[c] * way_m;
            }
            let (x, y) = (slopes[0][l] * alpha, slopes[1][l] * alpha);
            // The facet's normal m, with a component of 1 along n.
            let m = n + across * x + down * y;
            let (square, to_face, to_facet) = (1.0 + (x * x + y * y), dot(d, n), dot(d, m));
            let inverse = 1.0 / square.sqrt();
            let cos = to_facet.abs() * inverse;
            // n_1 sin_1 = n_2 sin_2; beyond total reflection, nothing is transmitted.
            let cos_t = max(1.0 - eta * eta * (1.0 - cos * cos), 0.0).sqrt();
            let (out, straight) = if step.reflects {
                (d - m * (2.0 * to_facet / square), d - n * (2.0 * to_face))
            } else {
                let sine_part = cos_t.copysign(to_facet) * inverse - eta * to_facet / square;
                (d * eta + m * sine_part, d)
            };
            let shape = to_facet / to_face;
            let leaves = dot(out, n) * to_face.signum();
            let leaves = if step.reflects { -leaves } else { leaves };
            let is_possible = shape > 0.0 && leaves > LEAST_COS;
            let out = select(is_possible, out, straight);
            let shape = if is_possible { shape } else { 0.0 };
            for q in 0..2 {
                let (a, b) = if q == 0 {
                    (before * cos, behind * cos_t)
                } else {
                    (behind * cos, before * cos_t)
                };
                let sum = 1.0 / (a + b);
                let amplitude = (a - b) * sum;
                let share =
                    if step.reflects { amplitude * amplitude } else { 4.0 * a * b * sum * sum };
                let share = if step.is_coated { 1.0 } else { share };
                self.power[q][l] *= share * shape;
            }
            for (k, (p, d)) in [(p.x, out.x), (p.y, out.y), (p.z, out.z)].into_iter().enumerate() {
                self.point[k][l] = p;
                self.direction[k][l] = d;
            }
        }
    }
}

/// Maps a point of the unit square to the slopes of a facet of roughness 1: with the square of the distance r from the centre of
/// the unit disc as uniform number, tan^2 = -ln(1 - r^2).
#[inline(always)]
fn slopes(u: f32, v: f32) -> (f32, f32) {
    let (x, y) = concentric_disc(u, v);
    let square = min(x * x + y * y, MOST_OF_DISC);
    let scale = (neg_ln(1.0 - square) / max(square, 1.0e-30)).sqrt();
    (x * scale, y * scale)
}

#[inline(always)]
fn lane(v: &[Lane; 3], l: usize) -> Vec3 {
    Vec3::new(v[0][l], v[1][l], v[2][l])
}

#[inline(always)]
fn select(first: bool, a: Vec3, b: Vec3) -> Vec3 {
    Vec3::new(
        if first { a.x } else { b.x },
        if first { a.y } else { b.y },
        if first { a.z } else { b.z },
    )
}

/// The dot product with a fixed order of its sums.
#[inline(always)]
fn dot(a: Vec3, b: Vec3) -> f32 {
    a.x * b.x + a.y * b.y + a.z * b.z
}

#[inline(always)]
fn cross(a: Vec3, b: Vec3) -> Vec3 {
    Vec3::new(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)
}
