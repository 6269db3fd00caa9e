//! The glass in closed form: a plane-parallel slab maps a ray to parallel rays, so nothing is intersected.
//!
//! With unit direction d, normal n, c = d.n the cosine of incidence, cos_t = sqrt(1 - (1 - c^2)/ior^2) and
//!
//! ```text
//! gamma = c / (ior cos_t) = c / sqrt(ior^2 - 1 + c^2)          (tan_t / tan_i; 1/ior at normal incidence)
//! ```
//!
//! the order t_k leaves as the line of the unrefracted ray shifted by kappa n, the order r_k as the line of the
//! ray mirrored in the front face shifted (in the mirrored world) by kappa n:
//!
//! ```text
//! kappa(t_k) = h (1 - (2k + 1) gamma),      kappa(r_k) = -2 k h gamma
//! ```
//!
//! because shifts along d itself do not move a line. The Fresnel reflectances of both polarisations are
//!
//! ```text
//! R_s = ((1 - gamma) / (1 + gamma))^2,      R_p = ((1 - ior^2 gamma) / (1 + ior^2 gamma))^2
//! ```
//!
//! (Hecht, *Optics*, 5th ed., eq. 4.34 and 4.40, divided by cos_t), and an order's weight for unpolarised light
//! is the mean over q = s, p of
//!
//! ```text
//! t_k: (1 - R_q)^2 R_q^(2k) tau^(2k+1)     r_0: R_q     r_k: (1 - R_q)^2 R_q^(2k-1) tau^(2k)
//! ```
//!
//! with tau = exp(-absorption h / cos_t). s and p are kept apart to the end: a mean taken at each face is off by
//! up to 3 % of full scale at 60 degrees. This file is the f64 reference; [`super::bundle`] has the same in lanes.

use glam::DVec3;

/// The pane, in the camera's frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Slab {
    /// Unit normal, away from the lens.
    pub normal: DVec3,
    /// Distance of the front face from the lens along the normal: the face is `x . normal = plane_distance_m`.
    pub plane_distance_m: f64,
    /// Thickness.
    pub thickness_m: f64,
    /// Index of refraction against air, at least 1.
    pub ior: f64,
    /// Absorption coefficient of red, green, blue, per metre.
    pub absorption_per_m: [f64; 3],
}

/// Side of the pane that an order leaves by, and the number of round trips inside it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Order {
    /// t_k: through the pane, to the front scene.
    Transmitted(u32),
    /// r_k: back from the pane, to the back scene.
    Reflected(u32),
}

impl Slab {
    /// Normal of a pane tilted by `[pitch, yaw]` degrees: Ry(yaw) Rx(pitch) (0, 0, 1).
    pub fn tilted_normal([pitch_deg, yaw_deg]: [f64; 2]) -> DVec3 {
        let (pitch, yaw) = (pitch_deg.to_radians(), yaw_deg.to_radians());
        DVec3::new(
            libm::sin(yaw) * libm::cos(pitch),
            -libm::sin(pitch),
            libm::cos(yaw) * libm::cos(pitch),
        )
    }

    /// The normal is not the optical axis.
    pub fn is_tilted(&self) -> bool {
        self.normal.x != 0.0 || self.normal.y != 0.0
    }

    /// Any colour is absorbed.
    pub fn absorbs(&self) -> bool {
        self.thickness_m > 0.0 && self.absorption_per_m.iter().any(|&a| a > 0.0)
    }

    /// gamma at cosine of incidence `cos_i` in (0, 1].
    pub fn gamma(&self, cos_i: f64) -> f64 {
        cos_i / (self.ior * self.ior - 1.0 + cos_i * cos_i).sqrt()
    }

    /// Shift of the order's line along the normal, metres.
    pub fn kappa_m(&self, order: Order, gamma: f64) -> f64 {
        match order {
            Order::Transmitted(k) => self.thickness_m * (1.0 - f64::from(2 * k + 1) * gamma),
            Order::Reflected(k) => -self.thickness_m * f64::from(2 * k) * gamma,
        }
    }

    /// Fresnel reflectance of one face, `[R_s, R_p]`.
    pub fn reflectance(&self, cos_i: f64) -> [f64; 2] {
        let gamma = self.gamma(cos_i);
        let square = |x: f64| x * x;
        let p = self.ior * self.ior * gamma;
        [
            square((1.0 - gamma) / (1.0 + gamma)),
            square((1.0 - p) / (1.0 + p)),
        ]
    }

    /// 1 - reflectance, without cancellation.
    fn transmittance(&self, cos_i: f64) -> [f64; 2] {
        let gamma = self.gamma(cos_i);
        let p = self.ior * self.ior * gamma;
        [
            4.0 * gamma / ((1.0 + gamma) * (1.0 + gamma)),
            4.0 * p / ((1.0 + p) * (1.0 + p)),
        ]
    }

    /// Share of the light that one passage through the glass leaves, for each colour.
    pub fn tau(&self, cos_i: f64) -> [f64; 3] {
        let cos_t = (1.0 - (1.0 - cos_i * cos_i) / (self.ior * self.ior)).sqrt();
        self.absorption_per_m
            .map(|a| libm::exp(-a * self.thickness_m / cos_t))
    }

    /// Weight of an order for unpolarised light, for each colour.
    pub fn weight(&self, order: Order, cos_i: f64) -> [f64; 3] {
        let (r, t) = (self.reflectance(cos_i), self.transmittance(cos_i));
        let mean = |f: &dyn Fn(usize) -> f64| 0.5 * (f(0) + f(1));
        let (weight, passages) = match order {
            Order::Transmitted(k) => (mean(&|q| t[q] * t[q] * power(r[q], 2 * k)), 2 * k + 1),
            Order::Reflected(0) => (mean(&|q| r[q]), 0),
            Order::Reflected(k) => (mean(&|q| t[q] * t[q] * power(r[q], 2 * k - 1)), 2 * k),
        };
        self.tau(cos_i).map(|tau| weight * power(tau, passages))
    }

    /// Sum of the weights of all transmitted orders, for each colour.
    pub fn total_transmittance(&self, cos_i: f64) -> [f64; 3] {
        let (r, t) = (self.reflectance(cos_i), self.transmittance(cos_i));
        self.tau(cos_i).map(|tau| {
            let q = |k: usize| t[k] * t[k] * tau / (1.0 - r[k] * r[k] * tau * tau);
            0.5 * (q(0) + q(1))
        })
    }

    /// Sum of the weights of all reflected orders, for each colour.
    pub fn total_reflectance(&self, cos_i: f64) -> [f64; 3] {
        let (r, t) = (self.reflectance(cos_i), self.transmittance(cos_i));
        self.tau(cos_i).map(|tau| {
            let q =
                |k: usize| r[k] + t[k] * t[k] * r[k] * tau * tau / (1.0 - r[k] * r[k] * tau * tau);
            0.5 * (q(0) + q(1))
        })
    }
}

fn power(base: f64, exponent: u32) -> f64 {
    (0..exponent).fold(1.0, |product, _| product * base)
}
