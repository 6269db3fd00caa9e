//! Reflection and refraction at a facet, and coordinates in frames.

use super::super::bent::dot;
use super::super::lanes::max;
use super::Step;
use glam::Vec3;

/// Least cosine of a direction's angle to the normal of a face, and to the optical axis. Flatter rays would leave the
/// range of the numbers.
pub(super) const LEAST_COS: f32 = 1.0e-4;

/// Reflects or refracts a ray with unit direction `d`, in coordinates with the face's normal as z, at a facet with the normal (x, y, 1)
/// and the inverse of its length. Returns the new direction, and the factors of the weights for s and p.
#[inline(always)]
pub(super) fn scatter<const REFLECTS: bool>(
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
