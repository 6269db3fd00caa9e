//! Bent panes, compared with rays that are followed explicitly from sphere to sphere.

use crate::case::{CLEAN, Case, GLASS, I, T, bumpy};
use crate::optics::{Exit, face, mirrored};
use glam::DVec3;
use proptest::prelude::*;
use render::trace::{Bow, Order, Slab};

/// A pane between two concentric spheres.
#[derive(Clone, Copy)]
pub(crate) struct BentPane {
    pub(crate) normal: DVec3,
    pub(crate) pivot: DVec3,
    pub(crate) radius_m: f64,
    pub(crate) thickness_m: f64,
    pub(crate) ior: f64,
    pub(crate) absorption_per_m: [f64; 3],
}

impl BentPane {
    fn center(&self) -> DVec3 {
        self.pivot - self.radius_m * self.normal
    }

    /// Returns the face's unit normal away from the lens.
    fn normal_at(&self, point: DVec3) -> DVec3 {
        (point - self.center()).normalize() * self.radius_m.signum()
    }

    /// Returns the positions at which a line meets a sphere about the centre, in lengths of unit `d`.
    fn meets(&self, radius_m: f64, origin: DVec3, d: DVec3) -> [f64; 2] {
        let from = origin - self.center();
        let along = from.dot(d);
        let root = (along * along - (from.length_squared() - radius_m * radius_m)).sqrt();
        [-along - root, -along + root]
    }

    /// Returns the point of the front face that a camera ray meets: of the sphere's two, the one nearer to the pivot.
    pub(crate) fn entry(&self, origin: DVec3, d: DVec3) -> DVec3 {
        let [a, b] = self.meets(self.radius_m.abs(), origin, d).map(|t| origin + t * d);
        if a.distance(self.pivot) < b.distance(self.pivot) { a } else { b }
    }

    /// Returns the direction in which the smooth front face reflects a ray at `point`.
    pub(crate) fn reflected(&self, point: DVec3, d: DVec3) -> DVec3 {
        mirrored(d, self.normal_at(point))
    }

    /// Follows the light of an order from face to face.
    pub(crate) fn follow(&self, origin: DVec3, d: DVec3, order: Order) -> Exit {
        let mut point = self.entry(origin, d);
        let (mut inside, r) = face(d, self.normal_at(point), 1.0, self.ior);
        if order == Order::Reflected(0) {
            let direction = self.reflected(point, d);
            return Exit { point, direction, share: r.map(|r| [r; 3]) };
        }
        let mut share = r.map(|r| [1.0 - r; 3]);
        let radii_m = [self.radius_m.abs(), (self.radius_m + self.thickness_m).abs()];
        for pass in 1..=order.passages() {
            let (is_outward, is_last) = (pass % 2 == 1, pass == order.passages());
            let all = self.meets(radii_m[usize::from(is_outward)], point, inside);
            let length = all.into_iter().filter(|t| *t > 1e-9).fold(f64::INFINITY, f64::min);
            point += length * inside;
            for share in &mut share {
                for (share, a) in share.iter_mut().zip(self.absorption_per_m) {
                    *share *= (-a * length).exp();
                }
            }
            let normal = self.normal_at(point) * if is_outward { 1.0 } else { -1.0 };
            let (out, r) = face(inside, normal, self.ior, 1.0);
            let part = |q: usize| if is_last { 1.0 - r[q] } else { r[q] };
            share = [0, 1].map(|q| share[q].map(|s| s * part(q)));
            inside = if is_last { out } else { mirrored(inside, normal) };
        }
        Exit { point, direction: inside, share }
    }
}

fn pane(radius_m: f64, tilt_deg: [f64; 2]) -> BentPane {
    BentPane {
        normal: Slab::tilted_normal(tilt_deg),
        pivot: DVec3::new(0.0, 0.0, 0.4),
        radius_m,
        thickness_m: 0.008,
        ior: 1.52,
        absorption_per_m: [0.0; 3],
    }
}

proptest! {
    /// The closed form agrees with rays followed from sphere to sphere.
    #[test]
    fn orders_leave_along_the_lines_of_explicit_rays(
        radius_m in prop_oneof![0.6..30.0f64, -30.0..-0.6f64],
        pitch in -30.0..30.0f64, yaw in -30.0..30.0f64,
        x in -0.3..0.3f64, y in -0.3..0.3f64, lens_x in -0.02..0.02f64, lens_y in -0.02..0.02f64,
        k in 0u32..5, is_front: bool,
    ) {
        let pane = pane(radius_m, [pitch, yaw]);
        let (origin, d) = (DVec3::new(lens_x, lens_y, 0.0), DVec3::new(x, y, 1.0));
        let slab = Slab {
            normal: pane.normal,
            plane_distance_m: pane.pivot.dot(pane.normal),
            thickness_m: pane.thickness_m,
            ior: pane.ior,
            absorption_per_m: [0.0; 3],
        };
        let bow = Bow { curvature_per_m: 1.0 / radius_m, distance_m: pane.pivot.z };
        let order = if is_front { Order::Transmitted(k) } else { Order::Reflected(k) };
        let expected = pane.follow(origin, d.normalize(), order);
        prop_assume!(expected.direction.is_finite() && expected.point.is_finite());
        let (point, direction) = bow.exit(&slab, order, origin, d).unwrap();
        // Reflected orders are those of the mirrored world.
        let (point, direction) = if is_front {
            (point, direction)
        } else {
            let n = slab.normal;
            let beyond_m = point.dot(n) - slab.plane_distance_m;
            (point - 2.0 * beyond_m * n, direction - 2.0 * direction.dot(n) * n)
        };
        prop_assert!((direction - expected.direction).length() < 1e-11, "{direction} {expected:?}");
        let off = (point - expected.point).cross(expected.direction).length();
        prop_assert!(off < 1e-11, "{off:e} m");
    }
}

/// A pane with a huge radius is the flat pane; R is then sampled, so that only its noise differs.
#[test]
fn a_slight_bend_is_the_flat_pane() {
    let mut flat = Case::new(bumpy(5, false), bumpy(6, false));
    (flat.film, flat.tilt_deg, flat.absorption_per_m) = ([11, 8], [4.0, 15.0], [6.0, 2.0, 4.0]);
    let expected = flat.render();
    for radius_m in [1e8, -1e8] {
        let mut case = flat.clone();
        case.bow_radius_m = Some(radius_m);
        let (mut worst, mut of_r) = (0f32, 0f32);
        for (pixel, expected) in case.render().iter().zip(&expected) {
            for c in 0..3 {
                for layer in [I, T, GLASS] {
                    worst = worst.max((pixel.mean[layer][c] - expected.mean[layer][c]).abs());
                }
                of_r = of_r.max((pixel.mean[CLEAN][c] - expected.mean[CLEAN][c]).abs());
            }
        }
        println!("radius {radius_m} m: within {worst:.1e}, R {of_r:.1e}");
        // A ray may fall on the other side of an edge.
        assert!(worst <= 1.0 / 128.0 && of_r < 3e-2, "{worst}, {of_r}");
    }
}
