//! A ray that meets a facet, in f64: the reference of the lanes, for the choice of paths.

use super::visible;
use glam::DVec3;

/// The light of a ray that leaves a facet on one side.
#[derive(Clone, Copy, Debug)]
pub(super) struct Leaving {
    pub(super) direction: DVec3,
    /// Fresnel's share for s and p.
    pub(super) fresnel: [f64; 2],
    /// True if the facet reflects totally.
    pub(super) is_total: bool,
    /// Share of this light that the facets of the face let pass; 0 on the wrong side of the face.
    pub(super) passes: f64,
}

impl Leaving {
    /// Returns the number of what a facet does with light: it passes (0), is reflected in part (1), or totally (2); `None` for light that
    /// passes a facet that reflects totally.
    pub(super) fn kind(&self, reflects: bool) -> Option<usize> {
        match (reflects, self.is_total) {
            (false, false) => Some(0),
            (false, true) => None,
            (true, is_total) => Some(1 + usize::from(is_total)),
        }
    }
}

/// A face that a ray meets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Face {
    pub(super) alpha: f64,
    /// Indices before and behind the face, as the light travels.
    pub(super) iors: [f64; 2],
    /// Least cosine of a direction to the normal with which light goes on.
    pub(super) least_cos: f64,
}

impl Face {
    /// Splits a ray with unit direction `d`, in coordinates with the normal as z, at the visible facet with the slopes `facet`, in units
    /// of alpha, of all facets. Returns the light that passes and the light that is reflected.
    pub(super) fn split(&self, d: DVec3, facet: [f64; 2]) -> [Leaving; 2] {
        let tangent = [d.x / d.z, d.y / d.z];
        let product = -self.alpha * (facet[0] * tangent[0] + facet[1] * tangent[1]);
        let square = self.alpha * self.alpha * (tangent[0] * tangent[0] + tangent[1] * tangent[1]);
        let h = visible::shift_over_b(product as f32, square as f32);
        let slope = |k: usize| self.alpha * (facet[k] + self.alpha * f64::from(h) * tangent[k]);
        let m = DVec3::new(slope(0), slope(1), 1.0).normalize() * d.z.signum();
        let cos = d.dot(m);
        let [before, behind] = self.iors;
        let eta = before / behind;
        let cos_t = (1.0 - eta * eta * (1.0 - cos * cos)).max(0.0).sqrt();
        let of = |a: f64, b: f64| {
            let square = (a + b) * (a + b);
            [4.0 * a * b / square, (a - b) * (a - b) / square]
        };
        let [s, p] = [of(before * cos, behind * cos_t), of(behind * cos, before * cos_t)];
        let is_total = cos_t == 0.0;
        let leave = |out: DVec3, straight: DVec3, fresnel: [f64; 2], is_possible: bool| {
            let along = out.z * straight.z.signum();
            if cos <= 0.0 || !is_possible || along <= self.least_cos {
                return Leaving { direction: straight, fresnel, is_total, passes: 0.0 };
            }
            let b = self.alpha * (out.x * out.x + out.y * out.y).sqrt() / along;
            Leaving { direction: out, fresnel, is_total, passes: visible::visible_share(b) }
        };
        [
            leave(eta * d + (cos_t - eta * cos) * m, d, [s[0], p[0]], !is_total),
            leave(d - 2.0 * cos * m, DVec3::new(d.x, d.y, -d.z), [s[1], p[1]], true),
        ]
    }
}

/// Returns the slopes, in units of alpha, of a facet that a point of the unit square draws from all facets of a face.
pub(super) fn facet_at([u, v]: [f32; 2]) -> [f64; 2] {
    let angle = std::f64::consts::TAU * f64::from(v);
    let slope = (-libm::log(1.0 - f64::from(u))).sqrt();
    [slope * libm::cos(angle), slope * libm::sin(angle)]
}
