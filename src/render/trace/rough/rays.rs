//! Rays along the paths through rough faces, in lanes; [`super`] has the formulas.

use super::super::bent::{RayLanes, dot};
use super::super::camera::concentric_disc;
use super::super::isa::Isa;
use super::super::lanes::{CHUNK, LANES, Lane, exp_neg, max, min, neg_ln};
use super::super::patch::Patch;
use super::super::sampler::points;
use super::super::scene::Sampling;
use super::super::smudges::SmudgeLanes;
use super::scatter::{LEAST_COS, cross, from_frame, scatter, to_frame};
use super::{RoughPane, RoughPath, Step};
use glam::Vec3;

/// Largest square of a facet's coordinates in the unit disc, from which its slopes are drawn: at 1, the slopes are infinite.
const MOST_OF_DISC: f32 = 1.0 - 1.0 / 16_777_216.0;

/// Number that stands for the smudges in place of that of a meeting, for a sample point of their own.
pub(super) const SMUDGES: u32 = u32::MAX;

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
    /// 1 where a ray meets a smudge, else 0.
    smeared: [Lane; CHUNK],
    /// Directions (x, y, 1) relative to the pixels' centres.
    relative: [[Lane; CHUNK]; 2],
    /// Points in the plane z = 0, m.
    point: [[Lane; CHUNK]; 2],
    /// Weights for red, green and blue; only the first are set if the pane is not coloured.
    pub(in super::super) weight: [[Lane; CHUNK]; 3],
    /// True if the weights of the three colours differ.
    pub(in super::super) is_coloured: bool,
}

/// Shapes of panes: parallel planes, spheres, and planes with waves, with wedges, or with both.
const FLAT: u8 = 0;
const BENT: u8 = 1;
const WAVES: u8 = 2;
const WEDGES: u8 = 4;

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
            smeared: lanes,
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
        if pane.has_waves || pane.has_wedges {
            return self.follow_turned(pane, path, rays, isa);
        }
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

    /// [`Self::follow`] of a pane with waves or wedges, whose code the loops of parallel faces must not contain.
    #[inline(never)]
    fn follow_turned(
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
                Isa::Avx512 => return unsafe { self.follow_turned_avx512(pane, path, rays) },
                // SAFETY: this machine has AVX2.
                Isa::Avx2 => return unsafe { self.follow_turned_avx2(pane, path, rays) },
                Isa::Baseline => {}
            }
        }
        self.follow_turned_lanes(pane, path, rays);
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

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn follow_turned_avx2(&mut self, pane: &RoughPane, path: &RoughPath, rays: &CameraRays<'_>) {
        self.follow_turned_lanes(pane, path, rays);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,avx512f,avx512vl,avx512dq,avx512bw")]
    fn follow_turned_avx512(&mut self, pane: &RoughPane, path: &RoughPath, rays: &CameraRays<'_>) {
        self.follow_turned_lanes(pane, path, rays);
    }

    #[inline(always)]
    fn follow_lanes(&mut self, pane: &RoughPane, path: &RoughPath, rays: &CameraRays<'_>) {
        self.prepare(pane, path, rays);
        if pane.curvature_per_m == 0.0 {
            self.pass::<FLAT>(pane, path, rays);
        } else {
            self.pass::<BENT>(pane, path, rays);
        }
    }

    #[inline(always)]
    fn follow_turned_lanes(&mut self, pane: &RoughPane, path: &RoughPath, rays: &CameraRays<'_>) {
        self.prepare(pane, path, rays);
        match (pane.has_waves, pane.has_wedges) {
            (true, false) => self.pass::<WAVES>(pane, path, rays),
            (true, true) => self.pass::<{ WAVES | WEDGES }>(pane, path, rays),
            (false, _) => self.pass::<WEDGES>(pane, path, rays),
        }
    }

    /// Finds the rays at face 0 and the facets of a path, if the chunk does not have them yet.
    #[inline(always)]
    fn prepare(&mut self, pane: &RoughPane, path: &RoughPath, rays: &CameraRays<'_>) {
        self.is_coloured = pane.is_coloured;
        if !self.has_arrived {
            self.arrive(pane, rays);
        }
        for (k, step) in path.steps.iter().enumerate() {
            self.draw(pane, rays, k, step.roughness);
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
                for (lanes, v) in self.arrival.iter_mut().zip([p.x, p.y, p.z, d.x, d.y, d.z]) {
                    lanes[s][l] = v;
                }
            }
        }
        if pane.has_waves {
            self.arrive_at_waves(pane);
        }
        match &pane.smudges {
            Some(smudges) => self.arrive_at_smudges(pane, smudges, rays),
            None => self.smeared[..self.count].fill([0.0; LANES]),
        }
        self.has_arrived = true;
    }

    /// Finds the rays that meet smudges.
    #[inline(always)]
    fn arrive_at_smudges(
        &mut self,
        pane: &RoughPane,
        smudges: &SmudgeLanes,
        rays: &CameraRays<'_>,
    ) {
        let seeds = rays.patch.seeds.of_meeting(SMUDGES);
        let (mut u, mut unused) = ([[0.0; LANES]; CHUNK], [[0.0; LANES]; CHUNK]);
        let count = self.count;
        points(rays.sampling, &seeds, 0, self.first, &mut u[..count], &mut unused[..count]);
        for s in 0..count {
            for l in 0..LANES {
                let p = [0, 1, 2].map(|k| self.arrival[k][s][l]);
                let mut p = Vec3::from_array(p);
                if pane.curvature_per_m != 0.0 {
                    p = to_frame(pane.axes, p);
                }
                self.smeared[s][l] = f32::from(u8::from(u[s][l] < smudges.share(p)));
            }
        }
    }

    /// Moves the rays of a pane with waves from the plane of face 0 to the face.
    #[inline(always)]
    fn arrive_at_waves(&mut self, pane: &RoughPane) {
        for s in 0..self.count {
            for l in 0..LANES {
                let [px, py, pz, dx, dy, dz] =
                    self.arrival.each_mut().map(|lanes| &mut lanes[s][l]);
                let d = Vec3::new(*dx, *dy, *dz);
                let (way_m, _) = pane.wave.meet::<false>(Vec3::new(*px, *py, *pz), d);
                *px += d.x * way_m;
                *py += d.y * way_m;
                *pz += d.z * way_m;
            }
        }
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
        let [clean, smeared] = pane.alphas[roughness];
        // The facets of a smooth face are those that `facets` begins with.
        if *is_ready || [clean, smeared] == [0.0; 2] {
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
                let alpha = if self.smeared[s][l] == 0.0 { clean } else { smeared };
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
        let constant = path.coated.constant();
        for c in 0..if pane.is_coloured { 3 } else { 1 } {
            let of_coatings = constant.map_or(1.0, |shares| shares[c]);
            for l in 0..LANES {
                let share = if path.absorbs { exp_neg(max(rays.depth[c][l], 0.0)) } else { 1.0 };
                let power = 0.5 * (rays.power[0][l] + rays.power[1][l]);
                self.weight[c][s][l] = power * of_coatings * share;
            }
            for l in 0..if constant.is_some() { 0 } else { LANES } {
                self.weight[c][s][l] *= path.coated.at(c, self.arrival[5][s][l]);
            }
            if let Some(smudges) = &pane.smudges {
                let transmittance = smudges.transmittance[usize::from(!path.is_front)];
                for l in 0..LANES {
                    let clean = self.smeared[s][l] == 0.0;
                    self.weight[c][s][l] *= if clean { 1.0 } else { transmittance };
                }
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
            } else if SHAPE != BENT {
                let (mut q, mut along) = (p - step.origin, d);
                if SHAPE & WEDGES != 0 {
                    (q, along) = (to_frame(step.axes, q), to_frame(step.axes, along));
                }
                let (way_m, mut out, shares);
                if SHAPE & WAVES == 0 {
                    way_m = if FIRST { 0.0 } else { -q.z / along.z };
                    (out, shares) = scatter::<REFLECTS>(step, along, facet);
                } else {
                    let slope;
                    (way_m, slope) = pane.wave.meet::<FIRST>(q, along);
                    let frame = pane.wave.frame(slope);
                    (out, shares) = scatter::<REFLECTS>(step, to_frame(frame, along), facet);
                    out = from_frame(frame, out);
                }
                if SHAPE & WEDGES != 0 {
                    out = from_frame(step.axes, out);
                }
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

#[inline(always)]
fn lane(v: &[Lane; 3], l: usize) -> Vec3 {
    Vec3::new(v[0][l], v[1][l], v[2][l])
}
