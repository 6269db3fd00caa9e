//! A pane bent to concentric spheres: every pass of a ray crosses an equal chord, and every order leaves in its own direction.
//!
//! Face 0 is the sphere through the pivot P with centre C = P - r n, and the other face the concentric sphere of radius
//! |r + h|. With curvature kappa = 1 / r, q = 1 + kappa h, a unit direction d, the entry point p, the normal N = n + kappa (p - P)
//! there and the angle of incidence theta,
//!
//! ```text
//! chord in a medium of index m:   L_m = h (1 + q) / (sqrt(q^2 - s^2) + sqrt(1 - s^2))     s = sin theta / m
//! angle that a pass turns about C: alpha_m = asin(kappa L_m s / q)
//! ```
//!
//! A ray keeps its distance from C in air, so an order's line is the unbent line (for r_k: the line mirrored in N at p), turned
//! about C by
//!
//! ```text
//! t_k: (2 k + 1) alpha_n - alpha_1         r_k: 2 k alpha_n
//! ```
//!
//! in the plane of incidence. All expressions hold for kappa = 0, where they become those of [`super::slab`]. This file is the f64
//! reference; [`super::bent`] computes the same in SIMD lanes.

use super::slab::{Order, Slab};
use glam::DVec3;

/// Curvature of a bent pane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bow {
    /// 1 / radius: positive if the centre is on the lens's side, so that the lens sees a concave mirror.
    pub curvature_per_m: f64,
    /// Distance of the pivot from the lens along the optical axis.
    pub distance_m: f64,
}

impl Bow {
    /// Returns the place at which the ray through `point` of the lens's plane along (x, y, 1) meets the front face, with its
    /// normal; `None` if it does not meet the face. In the units and coordinates of the lens.
    pub fn entry(&self, slab: &Slab, point: DVec3, direction: DVec3) -> Option<(DVec3, DVec3)> {
        let (n, kappa) = (slab.normal, self.curvature_per_m);
        let pivot = DVec3::Z * self.distance_m;
        let from = point - pivot;
        let square = kappa * direction.length_squared();
        let linear = kappa * direction.dot(from) + direction.dot(n);
        let constant = kappa * from.length_squared() + 2.0 * from.dot(n);
        let root = linear * linear - square * constant;
        // The comparison is false for NaN, too.
        if !(linear > 0.0 && root > 0.0) {
            return None;
        }
        let past = from - constant / (linear + root.sqrt()) * direction;
        Some((past + pivot, n + kappa * past))
    }

    /// Returns a point and the unit direction of an order's light (for reflected orders, of the mirrored world); `None` if the ray
    /// does not meet the front face, or its light does not leave the pane.
    pub fn exit(
        &self,
        slab: &Slab,
        order: Order,
        point: DVec3,
        direction: DVec3,
    ) -> Option<(DVec3, DVec3)> {
        let (entry, normal) = self.entry(slab, point, direction)?;
        let (d, n, kappa) = (direction.normalize(), slab.normal, self.curvature_per_m);
        let (cos, q) = (d.dot(normal), self.ratio(slab));
        let along = d - cos * normal;
        let sin_2 = along.length_squared();
        // The angle that a pass turns about the centre, over kappa sin theta.
        let turn_m = |index: f64| {
            let square = sin_2 / (index * index);
            let roots = (q * q - square).sqrt() + (1.0 - square).sqrt();
            let chord_m = slab.thickness_m * (1.0 + q) / (roots * index * q);
            let x = kappa * chord_m * sin_2.sqrt();
            if x == 0.0 { chord_m } else { chord_m * libm::asin(x) / x }
        };
        let passages = f64::from(order.passages());
        let turn_m = match order {
            Order::Transmitted(_) => passages * turn_m(slab.ior) - turn_m(1.0),
            Order::Reflected(_) => passages * turn_m(slab.ior),
        };
        let axis = kappa * turn_m * normal.cross(d);
        let turn = |v: DVec3| {
            let angle = axis.length();
            let (sine, versine) = if angle < 1e-6 {
                (1.0, 0.5)
            } else {
                let half = libm::sin(0.5 * angle) / angle;
                (libm::sin(angle) / angle, 2.0 * half * half)
            };
            sine * axis.cross(v) + versine * axis.cross(axis.cross(v))
        };
        let bent = |v: DVec3| v + turn(v);
        // The centre is `entry - normal / kappa`; for a flat pane, the turn is a shift along the face.
        let moved = if kappa == 0.0 { turn_m * along } else { turn(normal / kappa) };
        let (point, direction) = match order {
            Order::Transmitted(_) => (entry + moved, bent(d)),
            Order::Reflected(_) => {
                let point = entry + moved;
                let out = bent(d - 2.0 * cos * normal);
                let beyond_m = point.dot(n) - slab.plane_distance_m;
                (point - 2.0 * beyond_m * n, out - 2.0 * out.dot(n) * n)
            }
        };
        direction.is_finite().then_some((point, direction))
    }

    /// Returns the ratio of the radii of the rear and the front face.
    pub fn ratio(&self, slab: &Slab) -> f64 {
        1.0 + self.curvature_per_m * slab.thickness_m
    }
}
