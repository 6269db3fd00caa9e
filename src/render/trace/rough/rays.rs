//! Rays along the paths through rough faces, in lanes; [`super`] has the formulas.

use super::super::bent::RayLanes;
use super::super::camera::concentric_disc;
use super::super::isa::Isa;
use super::super::lanes::{CHUNK, LANES, Lane, exp_neg, max, min, neg_ln};
use super::super::patch::Patch;
use super::super::sampler::points;
use super::super::scene::Sampling;
use super::{RoughPane, RoughPath, Step};
use glam::Vec3;

/// Least cosine of a direction's angle to the normal of a face, and to the optical axis. Flatter rays would leave the
/// range of the numbers.
const LEAST_COS: f32 = 1.0e-4;

/// Largest square of a facet's coordinates in the unit disc, from which its slopes are drawn: at 1, the slopes are infinite.
const MOST_OF_DISC: f32 = 1.0 - 1.0 / 16_777_216.0;

/// Rays of a chunk along one path, after the glass (of the mirrored world, for reflected light).
pub(in super::super) struct RoughRays {
    /// Facets by meeting and roughness, and whether they are those of the current chunk.
    facets: Vec<(bool, Facets)>,
    /// The first sample of the chunk, and the number of its samples.
    first: u32,
    count: usize,
    /// The chunk's rays at the first face, if they have arrived: points and unit directions, as in [`Travellers`].
    arrival: [[Lane; CHUNK]; 6],
    has_arrived: bool,
    /// Directions (x, y, 1) relative to the pixels' centres.
    relative: [[Lane; CHUNK]; 2],
    /// Points in the plane z = 0, m.
    point: [[Lane; CHUNK]; 2],
    /// Weights for red, green and blue; only the first are set if the pane is not coloured.
    pub(in super::super) weight: [[Lane; CHUNK]; 3],
    /// True if the weights of the three colours differ.
    pub(in super::super) is_coloured: bool,
}

/// Shapes of panes: parallel planes, spheres, and planes with waves or wedges.
const FLAT: u8 = 0;
const BENT: u8 = 1;
const FREE: u8 = 2;

/// Facets of a chunk: slopes across and down, and the inverse length of the normal (x, y, 1).
#[derive(Clone)]
struct Facets {
    x: [Lane; CHUNK],
    y: [Lane; CHUNK],
    inverse: [Lane; CHUNK],
}

/// The camera rays of a chunk.
pub(in super::super) struct CameraRays<'a> {
    pub(in super::super) patch: &'a Patch,
    pub(in super::super) sampling: Sampling,
    /// Directions relative to the pixels' centres.
    pub(in super::super) direction: &'a [[Lane; CHUNK]; 2],
    /// Points of the lens, m.
    pub(in super::super) lens: &'a [[Lane; CHUNK]; 2],
    /// Number of samples of each pixel along the path.
    pub(in super::super) count: usize,
}

/// Sixteen rays on their way through the pane. Points are relative to the pivot. For a flat pane, all coordinates are those of its
/// axes.
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
            facets: vec![],
            first: 0,
            count: 0,
            arrival: [lanes; 6],
            has_arrived: false,
            relative: [lanes; 2],
            point: [lanes; 2],
            weight: [lanes; 3],
            is_coloured: false,
        })
    }

    /// Begins a chunk with the samples `first .. first + count` of each pixel.
    pub(in super::super) fn begin(&mut self, first: u32, count: usize) {
        (self.first, self.count, self.has_arrived) = (first, count, false);
        self.facets.iter_mut().for_each(|(is_ready, _)| *is_ready = false);
    }

    /// Traces camera rays along a path.
    ///
    /// This function is never inlined, because the loops of smooth panes must not contain its code. Therefore it selects the
    /// instruction set itself.
    #[inline(never)]
    pub(in super::super) fn follow(
        &mut self,
        pane: &RoughPane,
        path: &RoughPath,
        rays: &CameraRays<'_>,
        isa: Isa,
    ) {
        #[cfg(target_arch = "x86_64")]
        #[allow(unsafe_code, reason = "calling functions compiled for AVX2 and AVX-512")]
        if isa.is_available() {
            match isa {
                // SAFETY: this machine has AVX-512.
                Isa::Avx512 => return unsafe { self.follow_avx512(pane, path, rays) },
                // SAFETY: this machine has AVX2.
                Isa::Avx2 => return unsafe { self.follow_avx2(pane, path, rays) },
                Isa::Baseline => {}
            }
        }
        self.follow_lanes(pane, path, rays);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn follow_avx2(&mut self, pane: &RoughPane, path: &RoughPath, rays: &CameraRays<'_>) {
        self.follow_lanes(pane, path, rays);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,avx512f,avx512vl,avx512dq,avx512bw")]
    fn follow_avx512(&mut self, pane: &RoughPane, path: &RoughPath, rays: &CameraRays<'_>) {
        self.follow_lanes(pane, path, rays);
    }

    #[inline(always)]
    fn follow_lanes(&mut self, pane: &RoughPane, path: &RoughPath, rays: &CameraRays<'_>) {
        self.is_coloured = pane.is_coloured;
        if !self.has_arrived {
            self.arrive(pane, rays);
        }
        for (k, step) in path.steps.iter().enumerate() {
            self.draw(pane, rays, k, step.roughness);
        }
        if pane.curvature_per_m != 0.0 {
            self.pass::<BENT>(pane, path, rays);
        } else if pane.straight.is_some() {
            self.pass::<FREE>(pane, path, rays);
        } else {
            self.pass::<FLAT>(pane, path, rays);
        }
    }

    /// Finds the points at which the chunk's rays meet face 0, and their unit directions.
    #[inline(always)]
    fn arrive(&mut self, pane: &RoughPane, rays: &CameraRays<'_>) {
        let (n, kappa, center) = (pane.axes[2], pane.curvature_per_m, &rays.patch.center);
        for s in 0..self.count {
            for l in 0..LANES {
                let x = center[0][l] + rays.direction[0][s][l];
                let y = center[1][l] + rays.direction[1][s][l];
                let d = Vec3::new(x, y, 1.0) * (1.0 / (1.0 + (x * x + y * y)).sqrt());
                let p = Vec3::new(rays.lens[0][s][l], rays.lens[1][s][l], -pane.distance_m);
                // Without curvature, the root is the linear coefficient.
                let linear = kappa * dot(p, d) + dot(d, n);
                let constant = kappa * dot(p, p) + 2.0 * dot(p, n);
                let root = max(linear * linear - kappa * constant, 0.0).sqrt();
                let p = p - d * (constant / (linear + root));
                let is_flat = kappa == 0.0;
                let (p, d) =
                    if is_flat { (to_frame(pane.axes, p), to_frame(pane.axes, d)) } else { (p, d) };
                let waved_m = pane.wave.map_or(0.0, |wave| wave.way_m(p, d, 0.0));
                let p = p + d * waved_m;
                for (lanes, v) in self.arrival.iter_mut().zip([p.x, p.y, p.z, d.x, d.y, d.z]) {
                    lanes[s][l] = v;
                }
            }
        }
        self.has_arrived = true;
    }

    /// Draws the facets of meeting `k` for the pane's roughness with this number.
    #[inline(always)]
    fn draw(&mut self, pane: &RoughPane, rays: &CameraRays<'_>, k: usize, roughness: usize) {
        let index = k * pane.alphas.len() + roughness;
        while self.facets.len() <= index {
            let lanes = [[0.0; LANES]; CHUNK];
            self.facets
                .push((false, Facets { x: lanes, y: lanes, inverse: [[1.0; LANES]; CHUNK] }));
        }
        let (is_ready, facets) = &mut self.facets[index];
        let alpha = pane.alphas[roughness];
        // The facets of a smooth face are those that `facets` begins with.
        if *is_ready || alpha == 0.0 {
            return;
        }
        *is_ready = true;
        let Facets { x, y, inverse } = facets;
        let seeds = rays.patch.seeds.of_meeting(k as u32);
        points(rays.sampling, &seeds, 0, self.first, &mut x[..self.count], &mut y[..self.count]);
        for s in 0..self.count {
            for l in 0..LANES {
                let (u, v) = concentric_disc(x[s][l], y[s][l]);
                // The square of the distance from the centre is uniform, and tan^2 = -alpha^2 ln(1 - square).
                let square = min(u * u + v * v, MOST_OF_DISC);
                let scale = alpha * (neg_ln(1.0 - square) / max(square, 1.0e-30)).sqrt();
                (x[s][l], y[s][l]) = (u * scale, v * scale);
                inverse[s][l] = 1.0 / (1.0 + (x[s][l] * x[s][l] + y[s][l] * y[s][l])).sqrt();
            }
        }
    }

    #[inline(always)]
    fn pass<const SHAPE: u8>(
        &mut self,
        pane: &RoughPane,
        path: &RoughPath,
        camera: &CameraRays<'_>,
    ) {
        for s in 0..camera.count {
            let mut rays = Travellers {
                point: [0, 1, 2].map(|k| self.arrival[k][s]),
                direction: [3, 4, 5].map(|k| self.arrival[k][s]),
                power: [[1.0; LANES]; 2],
                depth: [[0.0; LANES]; 3],
            };
            for (k, step) in path.steps.iter().enumerate() {
                let (_, facets) = &self.facets[k * pane.alphas.len() + step.roughness];
                let facets = [&facets.x[s], &facets.y[s], &facets.inverse[s]];
                match (k, step.reflects) {
                    (0, false) => rays.meet::<SHAPE, true, false>(pane, step, facets),
                    (0, true) => rays.meet::<SHAPE, true, true>(pane, step, facets),
                    (_, false) => rays.meet::<SHAPE, false, false>(pane, step, facets),
                    (_, true) => rays.meet::<SHAPE, false, true>(pane, step, facets),
                }
            }
            self.leave::<SHAPE>(pane, path, &rays, &camera.patch.center, s);
        }
    }

    /// Stores the rays of sample `s` after their last face.
    #[inline(always)]
    fn leave<const SHAPE: u8>(
        &mut self,
        pane: &RoughPane,
        path: &RoughPath,
        rays: &Travellers,
        center: &[Lane; 2],
        s: usize,
    ) {
        // Reflected rays are mirrored in the plane of the pane.
        let sign = if path.is_front { 1.0 } else { -1.0 };
        for l in 0..LANES {
            let (mut p, mut d) = (lane(&rays.point, l), lane(&rays.direction, l));
            if SHAPE == BENT {
                (p, d) = (to_frame(pane.axes, p), to_frame(pane.axes, d));
            }
            (p.z, d.z) = (p.z * sign, d.z * sign);
            let (p, d) = (from_frame(pane.axes, p), from_frame(pane.axes, d));
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
                let coated = path.coated.at(c, self.arrival[5][s][l]);
                self.weight[c][s][l] = power * coated * share;
            }
        }
    }

    /// Returns the rays of sample `s`.
    #[inline(always)]
    pub(in super::super) fn rays(&self, s: usize) -> RayLanes {
        let of = |lanes: &[[Lane; CHUNK]; 2]| [lanes[0][s], lanes[1][s]];
        RayLanes { relative: of(&self.relative), point: of(&self.point) }
    }
}

impl Travellers {
    /// Moves the rays to a face (unless it is the `FIRST`, where they are), and reflects or refracts them at these facets.
    #[inline(always)]
    fn meet<const SHAPE: u8, const FIRST: bool, const REFLECTS: bool>(
        &mut self,
        pane: &RoughPane,
        step: &Step,
        [x, y, inverse]: [&Lane; 3],
    ) {
        for l in 0..LANES {
            let (p, d) = (lane(&self.point, l), lane(&self.direction, l));
            let facet = [x[l], y[l], inverse[l]];
            let (p, out, shares, way_m) = if SHAPE == FLAT {
                let way_m = if FIRST { 0.0 } else { step.travel_m / d.z };
                let (out, shares) = scatter::<REFLECTS>(step, d, facet);
                (p + d * way_m, out, shares, way_m)
            } else if SHAPE == FREE {
                let in_face = to_frame(step.axes, p - step.origin);
                let along = to_frame(step.axes, d);
                let way_m = match &pane.wave {
                    _ if FIRST => 0.0,
                    Some(wave) => wave.way_m(in_face, along, 0.0),
                    None => -in_face.z / along.z,
                };
                let frame = match &pane.wave {
                    Some(wave) => wave.frame(in_face + along * way_m),
                    None => [Vec3::X, Vec3::Y, Vec3::Z],
                };
                let (out, shares) = scatter::<REFLECTS>(step, to_frame(frame, along), facet);
                let out = from_frame(step.axes, from_frame(frame, out));
                (p + d * way_m, out, shares, way_m)
            } else {
                let (way_m, met) = if FIRST { (0.0, 1.0) } else { pane.way_m(step, p, d) };
                let p = p + d * way_m;
                let frame = pane.frame(p);
                let (out, shares) = scatter::<REFLECTS>(step, to_frame(frame, d), facet);
                (p, from_frame(frame, out), shares.map(|share| share * met), way_m)
            };
            for c in 0..3 {
                self.depth[c][l] += step.absorption_per_m[c] * way_m;
            }
            for (q, share) in shares.into_iter().enumerate() {
                self.power[q][l] *= share;
            }
            for (k, (p, d)) in [(p.x, out.x), (p.y, out.y), (p.z, out.z)].into_iter().enumerate() {
                self.point[k][l] = p;
                self.direction[k][l] = d;
            }
        }
    }
}

impl RoughPane {
    /// Returns the way of a ray from one sphere of a bent pane to the next, m, and 1; or 0 and 0 if a flat ray in the glass misses the
    /// inner sphere.
    #[inline(always)]
    fn way_m(&self, step: &Step, p: Vec3, d: Vec3) -> (f32, f32) {
        let kappa = self.curvature_per_m;
        let linear = kappa * dot(p, d) + dot(d, self.axes[2]);
        let square = linear * linear - kappa * step.constant_m;
        let way_m = -step.constant_m / (linear + max(square, 0.0).sqrt().copysign(linear));
        if square > 0.0 { (way_m, 1.0) } else { (0.0, 0.0) }
    }

    /// Returns two tangents and the normal of a face of a bent pane at `p`.
    #[inline(always)]
    fn frame(&self, p: Vec3) -> [Vec3; 3] {
        let [across, _, n] = self.axes;
        let n = n + p * self.curvature_per_m;
        let n = n * (1.0 / dot(n, n).sqrt());
        let across = across - n * dot(across, n);
        let across = across * (1.0 / dot(across, across).sqrt());
        [across, cross(n, across), n]
    }
}

/// Reflects or refracts a ray with unit direction `d`, in coordinates with the face's normal as z, at a facet with the normal (x, y, 1)
/// and the inverse of its length. Returns the new direction, and the factors of the weights for s and p.
#[inline(always)]
fn scatter<const REFLECTS: bool>(
    step: &Step,
    d: Vec3,
    [x, y, inverse]: [f32; 3],
) -> (Vec3, [f32; 2]) {
    let [before, behind] = step.ior;
    let eta = before / behind;
    let to_facet = d.x * x + d.y * y + d.z;
    let cos = to_facet.abs() * inverse;
    // n_1 sin_1 = n_2 sin_2; beyond total reflection, nothing is transmitted.
    let cos_t = max(1.0 - eta * eta * (1.0 - cos * cos), 0.0).sqrt();
    let along_facet = to_facet * inverse * inverse;
    let (out, straight) = if REFLECTS {
        let turn = -2.0 * along_facet;
        (Vec3::new(d.x + turn * x, d.y + turn * y, d.z + turn), Vec3::new(d.x, d.y, -d.z))
    } else {
        let turn = cos_t.copysign(to_facet) * inverse - eta * along_facet;
        (Vec3::new(eta * d.x + turn * x, eta * d.y + turn * y, eta * d.z + turn), d)
    };
    // The facet faces the light, and the light leaves on the right side of the face.
    let shape = to_facet / d.z;
    let leaves = out.z * straight.z.signum();
    let is_possible = shape > 0.0 && leaves > LEAST_COS;
    let shape = if is_possible { shape } else { 0.0 };
    // Amplitudes are differences over sums, for s and for p.
    let (s_1, s_2) = (before * cos, behind * cos_t);
    let (p_1, p_2) = (behind * cos, before * cos_t);
    let both = 1.0 / ((s_1 + s_2) * (p_1 + p_2));
    let share = |a: f32, b: f32, inverse: f32| {
        let share = if REFLECTS {
            let amplitude = (a - b) * inverse;
            amplitude * amplitude
        } else {
            4.0 * a * b * inverse * inverse
        };
        if step.is_coated { shape } else { share * shape }
    };
    let shares = [share(s_1, s_2, both * (p_1 + p_2)), share(p_1, p_2, both * (s_1 + s_2))];
    let out = Vec3::new(
        if is_possible { out.x } else { straight.x },
        if is_possible { out.y } else { straight.y },
        if is_possible { out.z } else { straight.z },
    );
    (out, shares)
}

#[inline(always)]
fn lane(v: &[Lane; 3], l: usize) -> Vec3 {
    Vec3::new(v[0][l], v[1][l], v[2][l])
}

/// Returns a vector's coordinates in a frame of three unit vectors at right angles.
#[inline(always)]
fn to_frame([x, y, z]: [Vec3; 3], v: Vec3) -> Vec3 {
    Vec3::new(dot(v, x), dot(v, y), dot(v, z))
}

/// Returns the vector with these coordinates in a frame.
#[inline(always)]
fn from_frame([x, y, z]: [Vec3; 3], v: Vec3) -> Vec3 {
    x * v.x + y * v.y + z * v.z
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
