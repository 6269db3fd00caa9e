//! Reflection and refraction at a facet, and coordinates in frames.

use super::super::bent::dot;
use super::super::lanes::max;
use glam::Vec3;

/// Least cosine of a direction's angle to the normal of a face, and to the optical axis. Flatter rays would leave the
/// range of the numbers.
pub(super) const LEAST_COS: f32 = 1.0e-4;

/// Light that leaves a facet on one side.
#[derive(Clone, Copy)]
pub(super) struct Scattered {
    pub(super) direction: Vec3,
    /// Fresnel's share for s and p; 0 where the light does not leave.
    pub(super) shares: [f32; 2],
    /// True if the light leaves, on the right side of the face. What is totally reflected does not pass.
    pub(super) leaves: bool,
    /// True if the facet reflects totally.
    pub(super) is_total: bool,
    /// Square of the tangent of the angle to the face's normal.
    pub(super) tangent_2: f32,
}

/// Splits a ray with unit direction `d`, in coordinates with the face's normal as z, at a facet with the normal (x, y, 1): into the light
/// that passes the facet and the light that it reflects. `ior` are the indices before and behind the face.
#[inline(always)]
pub(super) fn split([before, behind]: [f32; 2], d: Vec3, [x, y]: [f32; 2]) -> [Scattered; 2] {
    let eta = before / behind;
    let inverse = 1.0 / (1.0 + (x * x + y * y)).sqrt();
    let to_facet = d.x * x + d.y * y + d.z;
    let cos = to_facet.abs() * inverse;
    // n_1 sin_1 = n_2 sin_2; beyond total reflection, nothing is transmitted.
    let cos_t = max(1.0 - eta * eta * (1.0 - cos * cos), 0.0).sqrt();
    let along_facet = to_facet * inverse * inverse;
    let bend = cos_t.copysign(to_facet) * inverse - eta * along_facet;
    let turn = -2.0 * along_facet;
    let refracted = Vec3::new(eta * d.x + bend * x, eta * d.y + bend * y, eta * d.z + bend);
    let mirrored = Vec3::new(d.x + turn * x, d.y + turn * y, d.z + turn);
    // Amplitudes are differences over sums, for s and for p.
    let (s_1, s_2) = (before * cos, behind * cos_t);
    let (p_1, p_2) = (behind * cos, before * cos_t);
    let both = 1.0 / ((s_1 + s_2) * (p_1 + p_2));
    let of = |a: f32, b: f32, inverse: f32| {
        let amplitude = (a - b) * inverse;
        [4.0 * a * b * inverse * inverse, amplitude * amplitude]
    };
    let [s, p] = [of(s_1, s_2, both * (p_1 + p_2)), of(p_1, p_2, both * (s_1 + s_2))];
    // The facet faces the light.
    let is_lit = to_facet * d.z > 0.0;
    let is_total = cos_t == 0.0;
    let leave = |out: Vec3, straight: Vec3, shares: [f32; 2], passes: bool| {
        let along = out.z * straight.z.signum();
        let is_possible = is_lit && passes && along > LEAST_COS;
        let kept = |share: f32| if is_possible { share } else { 0.0 };
        let direction = Vec3::new(
            if is_possible { out.x } else { straight.x },
            if is_possible { out.y } else { straight.y },
            if is_possible { out.z } else { straight.z },
        );
        let across_2 = direction.x * direction.x + direction.y * direction.y;
        let tangent_2 = across_2 / (direction.z * direction.z);
        let shares = shares.map(kept);
        Scattered { direction, shares, leaves: is_possible, is_total, tangent_2 }
    };
    [
        leave(refracted, d, [s[0], p[0]], !is_total),
        leave(mirrored, Vec3::new(d.x, d.y, -d.z), [s[1], p[1]], true),
    ]
}

/// Returns a vector's coordinates in a frame of three unit vectors at right angles.
#[inline(always)]
pub(super) fn to_frame([x, y, z]: [Vec3; 3], v: Vec3) -> Vec3 {
    Vec3::new(dot(v, x), dot(v, y), dot(v, z))
}

/// Returns the vector with these coordinates in a frame.
#[inline(always)]
pub(super) fn from_frame([x, y, z]: [Vec3; 3], v: Vec3) -> Vec3 {
    x * v.x + y * v.y + z * v.z
}

#[inline(always)]
pub(super) fn cross(a: Vec3, b: Vec3) -> Vec3 {
    Vec3::new(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)
}
