//! Sixteen rays at a face: their way to it, the facets that they see, and the light that facets hide.

use super::super::bent::dot;
use super::super::lanes::{LANES, Lane, max};
use super::scatter::{LEAST_COS, cross, from_frame, to_frame};
use super::visible::{exact, has_series, series, share};
use super::{RoughPane, Step};
use glam::Vec3;

/// Shapes of panes: parallel planes, spheres, and planes with waves, with wedges, or with both.
pub(super) const FLAT: u8 = 0;
pub(super) const BENT: u8 = 1;
pub(super) const WAVES: u8 = 2;
pub(super) const WEDGES: u8 = 4;

/// Sixteen rays at a meeting. Points are relative to the pivot. For a flat pane, all coordinates are those of its axes.
#[derive(Clone, Copy)]
pub(super) struct Beam {
    pub(super) point: [Lane; 3],
    pub(super) direction: [Lane; 3],
    /// Weights for s and p polarised light, without those of colours.
    pub(super) power: [Lane; 2],
    /// Factors of red, green and blue, of coatings and absorption; only the first is used if the pane is not coloured.
    pub(super) tint: [Lane; 3],
}

impl Beam {
    pub(super) const DARK: Self = Self {
        point: [[0.0; LANES]; 3],
        direction: [[0.0; LANES]; 3],
        power: [[0.0; LANES]; 2],
        tint: [[1.0; LANES]; 3],
    };
}

impl Beam {
    /// Moves the rays to a face (unless it is the `first`, where they are). Returns their ways, m; sets their directions in the
    /// face's coordinates, and the slopes of its waves. Rays that do not reach the face lose their light.
    #[inline(always)]
    pub(super) fn arrive<const SHAPE: u8>(
        &mut self,
        pane: &RoughPane,
        step: &Step,
        first: bool,
        along: &mut [Lane; 3],
        slopes: &mut Lane,
    ) -> Lane {
        let mut ways_m = [0.0; LANES];
        for l in 0..LANES {
            let (p, d) = (lane(&self.point, l), lane(&self.direction, l));
            let (way_m, of_face, met);
            if SHAPE == FLAT {
                way_m = if first { 0.0 } else { step.travel_m / d.z };
                (of_face, met) = (d, true);
            } else if SHAPE == BENT {
                (way_m, met) = if first { (0.0, true) } else { pane.way_m(step, p, d) };
                of_face = to_frame(pane.frame(p + d * way_m), d);
            } else {
                let (mut q, mut in_face) = (p - step.origin, d);
                if SHAPE & WEDGES != 0 {
                    (q, in_face) = (to_frame(step.axes, q), to_frame(step.axes, in_face));
                }
                // A ray that is turned away from a face does not reach it.
                let meets = |z: f32| z * step.inward_sign > LEAST_COS;
                let safe = |d: Vec3| if meets(d.z) { d } else { Vec3::Z * step.inward_sign };
                in_face = safe(in_face);
                if SHAPE & WAVES == 0 {
                    way_m = if first { 0.0 } else { -q.z / in_face.z };
                    of_face = in_face;
                } else {
                    let slope;
                    (way_m, slope) = if first {
                        pane.wave.meet::<true>(q, in_face)
                    } else {
                        pane.wave.meet::<false>(q, in_face)
                    };
                    slopes[l] = slope;
                    of_face = safe(to_frame(pane.wave.frame(slope), in_face));
                }
                let turned = if SHAPE & WEDGES != 0 { to_frame(step.axes, d) } else { d };
                met = meets(turned.z)
                    && (SHAPE & WAVES == 0
                        || meets(to_frame(pane.wave.frame(slopes[l]), turned).z));
            }
            ways_m[l] = if met { way_m } else { 0.0 };
            for (k, (p, v)) in [(p.x, d.x), (p.y, d.y), (p.z, d.z)].into_iter().enumerate() {
                self.point[k][l] = p + v * ways_m[l];
            }
            for (along, v) in along.iter_mut().zip([of_face.x, of_face.y, of_face.z]) {
                along[l] = v;
            }
            for power in &mut self.power {
                power[l] = if met { power[l] } else { 0.0 };
            }
        }
        ways_m
    }
}

/// Returns the slopes of visible facets, made of those of all facets `x` and `y` in units of alpha, for rays in the face's
/// coordinates.
#[inline(always)]
pub(super) fn visible_facets(along: &[Lane; 3], alpha: f32, [x, y]: [&Lane; 2]) -> [Lane; 2] {
    let (mut product, mut square) = ([0.0; LANES], [0.0; LANES]);
    let (mut shift, mut tangent) = ([0.0; LANES], [[0.0; LANES]; 2]);
    let mut is_steep = false;
    for l in 0..LANES {
        let inverse = 1.0 / along[2][l];
        let [tx, ty] = [along[0][l] * inverse, along[1][l] * inverse];
        product[l] = -alpha * (x[l] * tx + y[l] * ty);
        square[l] = alpha * alpha * (tx * tx + ty * ty);
        shift[l] = series(product[l], square[l]);
        is_steep |= !has_series(square[l]);
        (tangent[0][l], tangent[1][l]) = (tx, ty);
    }
    if is_steep {
        for l in 0..LANES {
            if !has_series(square[l]) {
                shift[l] = exact(product[l], square[l]);
            }
        }
    }
    let mut slopes = [[0.0; LANES]; 2];
    for (slopes, (tangent, of_all)) in slopes.iter_mut().zip(tangent.iter().zip([x, y])) {
        for l in 0..LANES {
            slopes[l] = alpha * (of_all[l] + alpha * shift[l] * tangent[l]);
        }
    }
    slopes
}

/// Takes the light that facets hide from rays that leave a face.
#[inline(always)]
pub(super) fn dim(light: &mut Beam, alpha: f32, tangent_2: &Lane) {
    let mut steepest = 0.0;
    let mut square = [0.0; LANES];
    for l in 0..LANES {
        square[l] = alpha * alpha * tangent_2[l];
        steepest = max(square[l], steepest);
    }
    if share(steepest) < 1.0 {
        for l in 0..LANES {
            let share = share(square[l]);
            light.power.iter_mut().for_each(|power| power[l] *= share);
        }
    }
}

/// Returns a direction in the coordinates of a face in those of the pane.
#[inline(always)]
pub(super) fn leave_frame<const SHAPE: u8>(
    pane: &RoughPane,
    step: &Step,
    light: &Beam,
    slope: f32,
    mut d: Vec3,
    l: usize,
) -> Vec3 {
    if SHAPE == BENT {
        return from_frame(pane.frame(lane(&light.point, l)), d);
    }
    if SHAPE & WAVES != 0 {
        d = from_frame(pane.wave.frame(slope), d);
    }
    if SHAPE & WEDGES != 0 {
        d = from_frame(step.axes, d);
    }
    d
}

impl RoughPane {
    /// Returns the way of a ray from one sphere of a bent pane to the next, m, and true; or 0 and false if a flat ray in the glass
    /// misses the inner sphere.
    #[inline(always)]
    fn way_m(&self, step: &Step, p: Vec3, d: Vec3) -> (f32, bool) {
        let kappa = self.curvature_per_m;
        let linear = kappa * dot(p, d) + dot(d, self.axes[2]);
        let square = linear * linear - kappa * step.constant_m;
        let way_m = -step.constant_m / (linear + max(square, 0.0).sqrt().copysign(linear));
        if square > 0.0 { (way_m, true) } else { (0.0, false) }
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
pub(super) fn lane(v: &[Lane; 3], l: usize) -> Vec3 {
    Vec3::new(v[0][l], v[1][l], v[2][l])
}
