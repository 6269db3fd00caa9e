//! Rays behind a bent pane, in lanes; [`super::bow`] has the closed forms.

use super::bow::Bow;
use super::lanes::{CHUNK, LANES, Lane};
use super::shade::{weights_of_faces, weights_to_the_end};
use super::slab::{Order, Slab};
use glam::Vec3;

/// Rays of a chunk at the front face of a bent pane.
pub(super) struct BentRays {
    /// Entry points.
    entry: [[Lane; CHUNK]; 3],
    /// Unit normals of the face there; they point away from the lens.
    normal: [[Lane; CHUNK]; 3],
    /// Unit directions.
    direction: [[Lane; CHUNK]; 3],
    /// Angle that a pass turns, over kappa sin theta: in glass and in air, m.
    turn: [[Lane; CHUNK]; 2],
    /// Length of a pass over the thickness.
    inverse_cos_t: [Lane; CHUNK],
    /// Reflectance and transmittance of the front and of the rear face for s and p polarised light.
    reflectance: [[[Lane; CHUNK]; 2]; 2],
    transmittance: [[[Lane; CHUNK]; 2]; 2],
}

/// Directions (x, y, 1) relative to the pixels' centres, and points in the plane z = 0, of sixteen rays.
pub(super) struct RayLanes {
    pub(super) relative: [Lane; 2],
    pub(super) point: [Lane; 2],
}

/// Place at which a ray meets the front face.
struct Met {
    entry: Vec3,
    normal: Vec3,
    direction: Vec3,
}

/// Computes [`Bow::entry`] of one lane, for rays that `scene::check_geometry` has accepted.
#[inline(always)]
fn meet(bow: &Bow, slab: &Slab, [ax, ay]: [f32; 2], [dx, dy]: [f32; 2]) -> Met {
    let (n, kappa) = (slab.normal.as_vec3(), bow.curvature_per_m as f32);
    let distance_m = bow.distance_m as f32;
    let (d_n, d_d) = (dx * n.x + dy * n.y + n.z, dx * dx + dy * dy + 1.0);
    let a_n = ax * n.x + ay * n.y - distance_m * n.z;
    let (a_a, a_d) = (ax * ax + ay * ay + distance_m * distance_m, ax * dx + ay * dy - distance_m);
    let (square, linear) = (kappa * d_d, kappa * a_d + d_n);
    let constant = kappa * a_a + 2.0 * a_n;
    let root = (linear * linear - square * constant).sqrt();
    let z = -constant / (linear + root);
    let [px, py, pz] = [ax + z * dx, ay + z * dy, z - distance_m];
    let inverse = 1.0 / d_d.sqrt();
    Met {
        entry: Vec3::new(px, py, z),
        normal: Vec3::new(n.x + kappa * px, n.y + kappa * py, n.z + kappa * pz),
        direction: Vec3::new(dx * inverse, dy * inverse, inverse),
    }
}

impl BentRays {
    pub(super) fn new() -> Box<Self> {
        let lanes = [[0.0; LANES]; CHUNK];
        Box::new(Self {
            entry: [lanes; 3],
            normal: [lanes; 3],
            direction: [lanes; 3],
            turn: [lanes; 2],
            inverse_cos_t: lanes,
            reflectance: [[lanes; 2]; 2],
            transmittance: [[lanes; 2]; 2],
        })
    }

    /// Finds the entries of `count` samples, and the optics of the glass there.
    #[inline(always)]
    pub(super) fn fill(
        &mut self,
        bow: &Bow,
        slab: &Slab,
        center: &[Lane; 2],
        relative: &[[Lane; CHUNK]; 2],
        lens: &[[Lane; CHUNK]; 2],
        count: usize,
    ) {
        let (ior, h, kappa) =
            (slab.ior as f32, slab.thickness_m as f32, bow.curvature_per_m as f32);
        let q = bow.ratio(slab) as f32;
        for s in 0..count {
            for l in 0..LANES {
                let d = [0, 1].map(|k| center[k][l] + relative[k][s][l]);
                let Met { entry, normal, direction } =
                    meet(bow, slab, [lens[0][s][l], lens[1][s][l]], d);
                let cos = dot(direction, normal);
                let along = direction - normal * cos;
                let sin_2 = dot(along, along);
                let sin_t_2 = sin_2 / (ior * ior);
                let cos_t = (1.0 - sin_t_2).sqrt();
                // Cosines at the rear face, times q.
                let (rear, rear_t) = ((q * q - sin_2).sqrt(), (q * q - sin_t_2).sqrt());
                let lengths = [(1.0 + q) / (rear_t + cos_t), (1.0 + q) / (rear + cos)];
                self.inverse_cos_t[s][l] = lengths[0];
                for (medium, index) in [ior, 1.0].into_iter().enumerate() {
                    // asin(x) over x is 1 + x^2 / 6 + 3 x^4 / 40 + ...
                    let chord = h * lengths[medium] / (index * q);
                    let x_2 = kappa * kappa * chord * chord * sin_2;
                    let series =
                        1.0 + x_2 * (1.0 / 6.0 + x_2 * (3.0 / 40.0 + x_2 * (15.0 / 336.0)));
                    self.turn[medium][s][l] = chord * series;
                }
                for (face, gamma) in
                    [cos / (ior * cos_t), rear / (ior * rear_t)].into_iter().enumerate()
                {
                    for (p, factor) in [1.0, ior * ior].into_iter().enumerate() {
                        let slope = factor * gamma;
                        let inverse = 1.0 / (1.0 + slope);
                        let amplitude = (1.0 - slope) * inverse;
                        self.reflectance[face][p][s][l] = amplitude * amplitude;
                        self.transmittance[face][p][s][l] = 4.0 * slope * inverse * inverse;
                    }
                }
                for (k, (entry, normal, direction)) in [
                    (entry.x, normal.x, direction.x),
                    (entry.y, normal.y, direction.y),
                    (entry.z, normal.z, direction.z),
                ]
                .into_iter()
                .enumerate()
                {
                    self.entry[k][s][l] = entry;
                    self.normal[k][s][l] = normal;
                    self.direction[k][s][l] = direction;
                }
            }
        }
    }

    /// Returns the rays of sample `s` after the glass (of the mirrored world, for reflected orders).
    #[inline(always)]
    pub(super) fn rays(
        &self,
        bow: &Bow,
        slab: &Slab,
        order: Order,
        center: &[Lane; 2],
        s: usize,
    ) -> RayLanes {
        let kappa = bow.curvature_per_m as f32;
        let passages = order.passages() as f32;
        let is_front = matches!(order, Order::Transmitted(_));
        let mut rays = RayLanes { relative: [[0.0; LANES]; 2], point: [[0.0; LANES]; 2] };
        for l in 0..LANES {
            let of = |v: &[[Lane; CHUNK]; 3]| Vec3::new(v[0][s][l], v[1][s][l], v[2][s][l]);
            let (entry, normal, d) = (of(&self.entry), of(&self.normal), of(&self.direction));
            let cos = dot(d, normal);
            let along = d - normal * cos;
            let air = if is_front { self.turn[1][s][l] } else { 0.0 };
            let turn = passages * self.turn[0][s][l] - air;
            let angle_2 = kappa * kappa * turn * turn * dot(along, along);
            // sin x / x and (1 - cos x) / x^2.
            let sine = 1.0 - angle_2 * (1.0 / 6.0 - angle_2 * (1.0 / 120.0));
            let versine = 0.5 - angle_2 * (1.0 / 24.0 - angle_2 * (1.0 / 720.0));
            let point = entry + along * (turn * sine)
                - normal * (kappa * turn * turn * versine * dot(along, along));
            // The component along the normal, before the turn.
            let (straight, cos) =
                if is_front { (d, cos) } else { (d - normal * (2.0 * cos), -cos) };
            let turned = straight * (1.0 - angle_2 * versine)
                + (straight * cos - normal) * (kappa * turn * sine);
            rays.set(l, slab, is_front, point, turned, center);
        }
        rays
    }
}

impl RayLanes {
    /// Returns the mirrored rays of sample `s` of the pinhole, off the smooth front face.
    #[inline(always)]
    pub(super) fn mirrored_pinhole(
        bow: &Bow,
        slab: &Slab,
        center: &[Lane; 2],
        film: &[[Lane; CHUNK]; 2],
        s: usize,
    ) -> Self {
        let mut rays = Self { relative: [[0.0; LANES]; 2], point: [[0.0; LANES]; 2] };
        for l in 0..LANES {
            let d = [0, 1].map(|k| center[k][l] + film[k][s][l]);
            let Met { entry, normal, direction } = meet(bow, slab, [0.0; 2], d);
            let mirrored = direction - normal * (2.0 * dot(direction, normal));
            rays.set(l, slab, false, entry, mirrored, center);
        }
        rays
    }

    /// Sets lane `l` from a point and a direction; those of reflected rays are mirrored in the plane of the pane.
    #[inline(always)]
    pub(super) fn set(
        &mut self,
        l: usize,
        slab: &Slab,
        is_front: bool,
        point: Vec3,
        direction: Vec3,
        center: &[Lane; 2],
    ) {
        let (n, plane_m) = (slab.normal.as_vec3(), slab.plane_distance_m as f32);
        let (point, direction) = if is_front {
            (point, direction)
        } else {
            (
                point - n * (2.0 * (dot(point, n) - plane_m)),
                direction - n * (2.0 * dot(direction, n)),
            )
        };
        let (dx, dy) = (direction.x / direction.z, direction.y / direction.z);
        self.relative[0][l] = dx - center[0][l];
        self.relative[1][l] = dy - center[1][l];
        self.point[0][l] = point.x - dx * point.z;
        self.point[1][l] = point.y - dy * point.z;
    }
}

/// The dot product with a fixed order of its sums.
#[inline(always)]
pub(super) fn dot(a: Vec3, b: Vec3) -> f32 {
    a.x * b.x + a.y * b.y + a.z * b.z
}

impl BentRays {
    /// Computes the weights of an order for sample `s`, without absorption.
    #[inline(always)]
    pub(super) fn weights(&self, order: Order, s: usize) -> Lane {
        let ([front, rear], [through_front, through_rear]) =
            (&self.reflectance, &self.transmittance);
        weights_of_faces(
            order,
            [[&front[0][s], &front[1][s]], [&rear[0][s], &rear[1][s]]],
            [
                [&through_front[0][s], &through_front[1][s]],
                [&through_rear[0][s], &through_rear[1][s]],
            ],
        )
    }

    /// Computes the weights of an order with those of all longer ones, for one colour (see [`weights_to_the_end`]).
    #[inline(always)]
    pub(super) fn weights_to_the_end(&self, order: Order, s: usize, tau: &Lane) -> Lane {
        let [[a, b], [c, d]] = [0, 1].map(|face| [0, 1].map(|q| &self.reflectance[face][q][s]));
        let [[e, f], [g, h]] = [0, 1].map(|face| [0, 1].map(|q| &self.transmittance[face][q][s]));
        weights_to_the_end(order, [[a, b], [c, d]], [[e, f], [g, h]], tau)
    }

    /// Returns the length of a pass over the thickness, for sample `s`.
    #[inline(always)]
    pub(super) fn inverse_cos_t(&self, s: usize) -> &Lane {
        &self.inverse_cos_t[s]
    }
}
