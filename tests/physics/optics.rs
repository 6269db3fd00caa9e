//! Follows a ray face by face: Snell's law in vectors, Fresnel amplitudes of both polarisations, two explicit planes.

use glam::DVec3;
use render::trace::Order;

/// A pane with two parallel faces.
#[derive(Clone, Copy)]
pub(crate) struct Pane {
    pub(crate) normal: DVec3,
    pub(crate) distance_m: f64,
    pub(crate) thickness_m: f64,
    pub(crate) ior: f64,
    pub(crate) absorption_per_m: [f64; 3],
}

/// A ray that has left the pane, with the share of power for each polarisation and colour.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Exit {
    pub(crate) point: DVec3,
    pub(crate) direction: DVec3,
    pub(crate) share: [[f64; 3]; 2],
}

impl Exit {
    /// Returns the weight for unpolarised light.
    pub(crate) fn weight(&self) -> [f64; 3] {
        [0, 1, 2].map(|c| 0.5 * (self.share[0][c] + self.share[1][c]))
    }
}

/// Returns the refracted direction and the reflectances (s, p) at a face from `n1` to `n2`; `normal` points to `n2`.
pub(crate) fn face(d: DVec3, normal: DVec3, n1: f64, n2: f64) -> (DVec3, [f64; 2]) {
    let cos_i = d.dot(normal);
    // |d x n| is accurate at small angles, where 1 - cos^2 loses digits.
    let sin_t = n1 / n2 * d.cross(normal).length();
    let cos_t = ((1.0 - sin_t) * (1.0 + sin_t)).sqrt();
    let r_s = (n1 * cos_i - n2 * cos_t) / (n1 * cos_i + n2 * cos_t);
    let r_p = (n2 * cos_i - n1 * cos_t) / (n2 * cos_i + n1 * cos_t);
    let refracted = n1 / n2 * (d - cos_i * normal) + cos_t * normal;
    (refracted, [r_s * r_s, r_p * r_p])
}

pub(crate) fn mirrored(d: DVec3, normal: DVec3) -> DVec3 {
    d - 2.0 * d.dot(normal) * normal
}

impl Pane {
    /// Returns the first `count` transmitted and reflected orders of the ray from `origin` along unit `d`.
    pub(crate) fn follow(&self, origin: DVec3, d: DVec3, count: usize) -> [Vec<Exit>; 2] {
        let n = self.normal;
        let to_plane = |p: DVec3, d: DVec3, distance: f64| (distance - p.dot(n)) / d.dot(n);
        let mut point = origin + to_plane(origin, d, self.distance_m) * d;
        let (mut inside, r) = face(d, n, 1.0, self.ior);
        let mut share = r.map(|r| [1.0 - r; 3]);
        let mut transmitted = vec![];
        let mut reflected =
            vec![Exit { point, direction: mirrored(d, n), share: r.map(|r| [r; 3]) }];
        while transmitted.len() < count || reflected.len() < count {
            let outward = inside.dot(n) > 0.0;
            let plane = self.distance_m + if outward { self.thickness_m } else { 0.0 };
            let length = to_plane(point, inside, plane);
            point += length * inside;
            let normal = if outward { n } else { -n };
            let (out, r) = face(inside, normal, self.ior, 1.0);
            for share in &mut share {
                for (share, a) in share.iter_mut().zip(self.absorption_per_m) {
                    *share *= (-a * length).exp();
                }
            }
            let exit = Exit {
                point,
                direction: out,
                share: [0, 1].map(|q| share[q].map(|s| s * (1.0 - r[q]))),
            };
            if outward {
                transmitted.push(exit);
            } else {
                reflected.push(exit);
            }
            share = [0, 1].map(|q| share[q].map(|s| s * r[q]));
            inside = mirrored(inside, n);
        }
        [transmitted, reflected]
    }

    /// Returns one order of [`Pane::follow`].
    pub(crate) fn exit(&self, origin: DVec3, d: DVec3, order: Order) -> Exit {
        match order {
            Order::Transmitted(k) => self.follow(origin, d, k as usize + 1)[0][k as usize],
            Order::Reflected(k) => self.follow(origin, d, k as usize + 1)[1][k as usize],
        }
    }
}
