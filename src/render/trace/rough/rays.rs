//! Rays along the paths through rough faces, in lanes; [`super`] has the formulas.

use super::super::bent::RayLanes;
use super::super::isa::Isa;
use super::super::lanes::{CHUNK, LANES, Lane, exp_neg, max};
use super::super::patch::Patch;
use super::super::scene::Sampling;
use super::coat::CoatLanes;
use super::form::{Form, STILL, WAVED};
use super::meet::{BENT, Beam, FLAT, WAVES, WEDGES, dim, lane, leave_frame, visible_facets};
use super::program::{Meet, Program, Target};
use super::scatter::{LEAST_COS, Scattered, from_frame, split, to_frame};
use super::{Rest, RoughPane};

/// Rays of a chunk along the paths of a pane, after the glass (of the mirrored world, for reflected light).
pub(in super::super) struct RoughRays {
    /// Facets by meeting, and whether they are those of the current chunk.
    pub(super) facets: Vec<(bool, Facets)>,
    /// The first sample of the chunk, and the number of its samples.
    pub(super) first: u32,
    pub(super) count: usize,
    /// The chunk's rays at the first face, if they have arrived: points and unit directions, as in [`Light`].
    pub(super) arrival: [[Lane; CHUNK]; 6],
    pub(super) has_arrived: bool,
    /// Rays by order: those of the front, of the back, and that of T.
    pub(super) ways: Vec<Box<Way>>,
    /// The light at each meeting of the tree, for one sample.
    light: Vec<Beam>,
    /// Shares of the pane's coatings for one sample.
    coats: Vec<CoatLanes>,
    /// Number of samples that a meeting serves.
    served: Vec<usize>,
    /// True if the weights of the three colours differ.
    pub(in super::super) is_coloured: bool,
}

/// Rays of a chunk along one order.
pub(super) struct Way {
    /// Directions (x, y, 1) relative to the pixels' centres.
    pub(super) relative: [[Lane; CHUNK]; 2],
    /// Points in the plane z = 0, m.
    pub(super) point: [[Lane; CHUNK]; 2],
    /// Weights for red, green and blue; only the first are set if the pane is not coloured.
    pub(super) weight: [[Lane; CHUNK]; 3],
}

/// Facets of a chunk: slopes across and down of all facets of a face, in units of alpha.
#[derive(Clone)]
pub(super) struct Facets {
    pub(super) x: [Lane; CHUNK],
    pub(super) y: [Lane; CHUNK],
}

/// The camera rays of a chunk.
pub(in super::super) struct CameraRays<'a> {
    pub(in super::super) patch: &'a Patch,
    pub(in super::super) sampling: Sampling,
    /// Directions relative to the pixels' centres.
    pub(in super::super) direction: &'a [[Lane; CHUNK]; 2],
    /// Points of the lens, m.
    pub(in super::super) lens: &'a [[Lane; CHUNK]; 2],
    /// Number of samples of each pixel along each way.
    pub(in super::super) taken: &'a [usize],
    /// The form of the rays in the zone of the patch, if they have one.
    pub(in super::super) form: Option<&'a Form>,
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
            ways: vec![],
            light: vec![],
            coats: vec![],
            served: vec![],
            is_coloured: false,
        })
    }

    /// Begins a chunk with the samples `first .. first + count` of each pixel.
    pub(in super::super) fn begin(&mut self, first: u32, count: usize) {
        (self.first, self.count, self.has_arrived) = (first, count, false);
        self.facets.iter_mut().for_each(|(is_ready, _)| *is_ready = false);
    }

    /// Traces camera rays along all paths of a pane, as many samples of each as its order takes.
    ///
    /// This function is never inlined, because the loops of smooth panes must not contain its code. Therefore it selects the
    /// instruction set itself.
    #[inline(never)]
    pub(in super::super) fn follow(&mut self, pane: &RoughPane, rays: &CameraRays<'_>, isa: Isa) {
        if pane.has_waves || pane.has_wedges {
            return self.follow_turned(pane, rays, isa);
        }
        #[cfg(target_arch = "x86_64")]
        #[allow(unsafe_code, reason = "calling functions compiled for AVX2 and AVX-512")]
        if isa.is_available() {
            match isa {
                // SAFETY: this machine has AVX-512.
                Isa::Avx512 => return unsafe { self.follow_avx512(pane, rays) },
                // SAFETY: this machine has AVX2.
                Isa::Avx2 => return unsafe { self.follow_avx2(pane, rays) },
                Isa::Baseline => {}
            }
        }
        self.follow_lanes(pane, rays);
    }

    /// [`Self::follow`] of a pane with waves or wedges, whose code the loops of parallel faces must not contain.
    #[inline(never)]
    fn follow_turned(&mut self, pane: &RoughPane, rays: &CameraRays<'_>, isa: Isa) {
        #[cfg(target_arch = "x86_64")]
        #[allow(unsafe_code, reason = "calling functions compiled for AVX2 and AVX-512")]
        if isa.is_available() {
            match isa {
                // SAFETY: this machine has AVX-512.
                Isa::Avx512 => return unsafe { self.follow_turned_avx512(pane, rays) },
                // SAFETY: this machine has AVX2.
                Isa::Avx2 => return unsafe { self.follow_turned_avx2(pane, rays) },
                Isa::Baseline => {}
            }
        }
        self.follow_turned_lanes(pane, rays);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn follow_avx2(&mut self, pane: &RoughPane, rays: &CameraRays<'_>) {
        self.follow_lanes(pane, rays);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,avx512f,avx512vl,avx512dq,avx512bw")]
    fn follow_avx512(&mut self, pane: &RoughPane, rays: &CameraRays<'_>) {
        self.follow_lanes(pane, rays);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn follow_turned_avx2(&mut self, pane: &RoughPane, rays: &CameraRays<'_>) {
        self.follow_turned_lanes(pane, rays);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,avx512f,avx512vl,avx512dq,avx512bw")]
    fn follow_turned_avx512(&mut self, pane: &RoughPane, rays: &CameraRays<'_>) {
        self.follow_turned_lanes(pane, rays);
    }

    #[inline(always)]
    fn follow_lanes(&mut self, pane: &RoughPane, rays: &CameraRays<'_>) {
        self.prepare(pane, rays);
        for program in pane.programs() {
            if pane.curvature_per_m == 0.0 {
                self.run::<FLAT>(pane, program, rays);
            } else {
                self.run::<BENT>(pane, program, rays);
            }
        }
    }

    #[inline(always)]
    fn follow_turned_lanes(&mut self, pane: &RoughPane, rays: &CameraRays<'_>) {
        if let Some(form) = rays.form {
            self.make_room(pane);
            if pane.has_waves {
                self.follow_form::<WAVED>(pane, form, rays);
            } else {
                self.follow_form::<STILL>(pane, form, rays);
            }
            return;
        }
        self.prepare(pane, rays);
        for program in pane.programs() {
            match (pane.has_waves, pane.has_wedges) {
                (true, false) => self.run::<WAVES>(pane, program, rays),
                (true, true) => self.run::<{ WAVES | WEDGES }>(pane, program, rays),
                (false, _) => self.run::<WEDGES>(pane, program, rays),
            }
        }
    }

    /// Makes room for the rays of a pane.
    #[inline(always)]
    fn make_room(&mut self, pane: &RoughPane) {
        self.is_coloured = pane.is_coloured;
        while self.ways.len() < pane.ways() {
            let lanes = [[0.0; LANES]; CHUNK];
            let way = Way { relative: [lanes; 2], point: [lanes; 2], weight: [lanes; 3] };
            self.ways.push(Box::new(way));
        }
    }

    /// Makes room, and finds the rays at face 0, if the chunk does not have them yet.
    #[inline(always)]
    fn prepare(&mut self, pane: &RoughPane, rays: &CameraRays<'_>) {
        self.make_room(pane);
        let meetings = pane.programs().map(|program| program.meets.len()).max().unwrap_or(0);
        self.light.resize(meetings.max(self.light.len()), Beam::DARK);
        self.coats.resize(pane.coats.len(), [[[0.0; LANES]; 3]; 2]);
        if !self.has_arrived {
            self.arrive(pane, rays);
        }
    }

    /// Follows the rays of all samples along the paths of a program.
    #[inline(always)]
    fn run<const SHAPE: u8>(
        &mut self,
        pane: &RoughPane,
        program: &Program,
        camera: &CameraRays<'_>,
    ) {
        let mut served = std::mem::take(&mut self.served);
        program.serve(camera.taken, &mut served);
        for (meet, served) in program.meets.iter().zip(&served) {
            if *served > 0 && meet.step.is_rough {
                self.draw(camera, meet.depth);
            }
        }
        let most = served.first().copied().unwrap_or(0);
        for s in 0..most {
            for (coat, lanes) in pane.coats.iter().zip(&mut self.coats) {
                coat.find(&self.arrival[5][s], lanes);
            }
            self.light[0] = Beam {
                point: [0, 1, 2].map(|k| self.arrival[k][s]),
                direction: [3, 4, 5].map(|k| self.arrival[k][s]),
                power: [[1.0; LANES]; 2],
                tint: [[1.0; LANES]; 3],
            };
            let mut dropped = [[[0.0; LANES]; 3]; 2];
            for (index, meet) in program.meets.iter().enumerate() {
                if served[index] > s {
                    self.meet::<SHAPE>(pane, (index, meet), camera, &served, s, &mut dropped);
                }
            }
            for (rest, dropped) in program.rests.iter().zip(&dropped) {
                if let Some(rest) = rest.filter(|rest| camera.taken[rest.way] > s) {
                    self.leave_cuts(pane, rest, dropped, s);
                }
            }
            #[cfg(test)]
            self.assert_sum(program, camera, s);
        }
        self.served = served;
    }

    /// Asserts that the weights of all orders of a sample add up to at most 1.
    #[cfg(test)]
    fn assert_sum(&self, program: &Program, camera: &CameraRays<'_>, s: usize) {
        let ways = program.rests.iter().flatten().map(|rest| rest.way + 1).max().unwrap_or(0);
        if camera.taken[..ways].iter().any(|taken| *taken <= s) {
            return;
        }
        for l in 0..LANES {
            let sum: f32 = self.ways[..ways].iter().map(|way| way.weight[0][s][l]).sum();
            assert!((0.0..1.0 + 1e-5).contains(&sum), "the weights of a sample add up to {sum}");
        }
    }

    /// Stores the light of cuts of sample `s`, on the line of another way.
    #[inline(always)]
    fn leave_cuts(&mut self, pane: &RoughPane, rest: Rest, dropped: &[Lane; 3], s: usize) {
        let Ok([way, line]) = self.ways.get_disjoint_mut([rest.way, rest.line]) else {
            unreachable!("the light of cuts has a way of its own")
        };
        for k in 0..2 {
            (way.relative[k][s], way.point[k][s]) = (line.relative[k][s], line.point[k][s]);
        }
        for c in 0..pane.colours() {
            way.weight[c][s] = dropped[c];
        }
    }

    /// Moves the rays of a meeting to its face, splits them at their facets, and hands the light on.
    ///
    /// Each loop is over lanes alone, with its arrays on the stack, so that the compiler turns it into vector instructions.
    #[inline(always)]
    fn meet<const SHAPE: u8>(
        &mut self,
        pane: &RoughPane,
        (index, meet): (usize, &Meet),
        camera: &CameraRays<'_>,
        served: &[usize],
        s: usize,
        dropped: &mut [[Lane; 3]; 2],
    ) {
        let (before, behind) = self.light.split_at_mut(index + 1);
        let light = &mut before[index];
        let step = &meet.step;
        let (mut along, mut slope) = ([[0.0; LANES]; 3], [0.0; LANES]);
        let way_m = light.arrive::<SHAPE>(pane, step, meet.depth == 0, &mut along, &mut slope);
        let colours = pane.colours();
        if step.absorbs {
            for c in 0..colours {
                for l in 0..LANES {
                    light.tint[c][l] *= exp_neg(max(step.absorption_per_m[c] * way_m[l], 0.0));
                }
            }
        }
        let mut facet = [[0.0; LANES]; 2];
        if step.is_rough {
            let Facets { x, y } = &self.facets[meet.depth].1;
            facet = visible_facets(&along, step.alpha, [&x[s], &y[s]]);
        }
        let mut out = [Beam::DARK; 2];
        let (mut tangent_2, mut total) = ([[0.0; LANES]; 2], [0.0; LANES]);
        for l in 0..LANES {
            let d = lane(&along, l);
            let both = split(step.ior, d, [facet[0][l], facet[1][l]]);
            total[l] = f32::from(u8::from(both[0].is_total));
            for (branch, Scattered { direction, shares, leaves, tangent_2: of, .. }) in
                both.into_iter().enumerate()
            {
                let direction = leave_frame::<SHAPE>(pane, step, light, slope[l], direction, l);
                for (k, v) in [direction.x, direction.y, direction.z].into_iter().enumerate() {
                    out[branch].direction[k][l] = v;
                }
                for (q, share) in shares.into_iter().enumerate() {
                    // A coating's share is a tint.
                    let share =
                        if step.coat.is_some() { f32::from(u8::from(leaves)) } else { share };
                    out[branch].power[q][l] = light.power[q][l] * share;
                }
                tangent_2[branch][l] = of;
            }
        }
        for (branch, target) in meet.branches.iter().enumerate() {
            let is_needed = match *target {
                Target::To(next) => served[next] > s,
                Target::Leaf { way, .. } => camera.taken[way] > s,
                Target::Cut(_) => true,
                Target::Nothing => false,
            };
            if !is_needed {
                continue;
            }
            let out = &mut out[branch];
            (out.point, out.tint) = (light.point, light.tint);
            if step.is_rough {
                dim(out, step.alpha, &tangent_2[branch]);
            }
            if let Some(coat) = step.coat {
                let of = &self.coats[coat];
                for c in 0..colours {
                    let (own, passed) = (&of[branch][c], &of[0][c]);
                    for l in 0..LANES {
                        // A facet that reflects totally keeps what the coating would let pass.
                        let kept = if branch == 0 { 0.0 } else { total[l] * passed[l] };
                        out.tint[c][l] *= own[l] + kept;
                    }
                }
            }
            match *target {
                Target::To(next) => behind[next - index - 1] = *out,
                Target::Leaf { way, is_front, joins, .. } => {
                    let place = (is_front, joins, &camera.patch.center, s);
                    self.ways[way].take::<SHAPE>(pane, out, place);
                }
                Target::Cut(ref division) => {
                    for (side, dropped) in dropped.iter_mut().enumerate() {
                        for c in 0..colours {
                            for l in 0..LANES {
                                let power = 0.5 * (out.power[0][l] + out.power[1][l]);
                                dropped[c][l] += power * out.tint[c][l] * division[side][c];
                            }
                        }
                    }
                }
                Target::Nothing => {}
            }
        }
    }

    /// Returns the rays of sample `s` along a way.
    #[inline(always)]
    pub(in super::super) fn rays(&self, way: usize, s: usize) -> RayLanes {
        let way = &self.ways[way];
        let of = |lanes: &[[Lane; CHUNK]; 2]| [lanes[0][s], lanes[1][s]];
        RayLanes { relative: of(&way.relative), point: of(&way.point) }
    }

    /// Returns the weights of the rays along a way, for each colour.
    #[inline(always)]
    pub(in super::super) fn weights(&self, way: usize) -> &[[Lane; CHUNK]; 3] {
        &self.ways[way].weight
    }
}

impl Way {
    /// Stores the rays of sample `s` after their last face. If they join others, both have the mean line, weighted by their light.
    #[inline(always)]
    fn take<const SHAPE: u8>(
        &mut self,
        pane: &RoughPane,
        light: &Beam,
        (is_front, joins, center, s): (bool, bool, &[Lane; 2], usize),
    ) {
        let colours = pane.colours();
        let (mut weight, mut share) = ([[0.0; LANES]; 3], [1.0; LANES]);
        for c in 0..colours {
            for l in 0..LANES {
                let power = 0.5 * (light.power[0][l] + light.power[1][l]);
                weight[c][l] = power * light.tint[c][l];
            }
        }
        if joins {
            let (mut own, mut all) = ([0.0; LANES], [0.0; LANES]);
            for c in 0..colours {
                let others = &self.weight[c][s];
                for l in 0..LANES {
                    own[l] += weight[c][l];
                    weight[c][l] += others[l];
                    all[l] += weight[c][l];
                }
            }
            for l in 0..LANES {
                share[l] = if all[l] > 0.0 { own[l] / all[l] } else { 0.0 };
            }
        }
        // Reflected rays are mirrored in the plane of the pane.
        let sign = if is_front { 1.0 } else { -1.0 };
        let mut line = [[0.0; LANES]; 4];
        for l in 0..LANES {
            let (mut p, mut d) = (lane(&light.point, l), lane(&light.direction, l));
            if SHAPE == BENT {
                (p, d) = (to_frame(pane.axes, p), to_frame(pane.axes, d));
            }
            (p.z, d.z) = (p.z * sign, d.z * sign);
            let (p, d) = (from_frame(pane.axes, p), from_frame(pane.axes, d));
            let inverse = 1.0 / max(d.z, LEAST_COS);
            let (dx, dy) = (d.x * inverse, d.y * inverse);
            let distance_m = p.z + pane.distance_m;
            line[0][l] = dx - center[0][l];
            line[1][l] = dy - center[1][l];
            line[2][l] = p.x - dx * distance_m;
            line[3][l] = p.y - dy * distance_m;
        }
        let Self { relative: [dx, dy], point: [x, y], .. } = self;
        for (lanes, line) in [dx, dy, x, y].into_iter().zip(line) {
            let lanes = &mut lanes[s];
            if joins {
                for l in 0..LANES {
                    lanes[l] += (line[l] - lanes[l]) * share[l];
                }
            } else {
                *lanes = line;
            }
        }
        for c in 0..colours {
            self.weight[c][s] = weight[c];
        }
    }
}
