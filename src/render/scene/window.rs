//! The part of a side that is visible on the film, which a panorama's view must cover.
//!
//! Every order of the glass is the camera's ray, or its reflection in the front face, shifted along the normal
//! ([`crate::trace::Slab::kappa_m`]). In the view of the side's capture camera, such a line extends from the sphere of
//! the nearest surface to infinity, and its image is monotone in between. The two ends of the outermost lines therefore
//! bound all points that a ray can hit.

use super::geometry::{
    BackCamera, bow, film_directions, film_plane, film_reach, largest_roughness, layers, slab,
    stack,
};
use super::negligible::Negligible;
use crate::trace::{Bow, Lens, Order, Slab, Stack};
use glam::{DMat3, DVec3};
use glasshouse_line::{Focus, FocusAt, GlassLayer, SceneLine};

/// Largest number of round trips inside the glass to consider. The light of further round trips is negligible.
const ROUND_TRIPS: u32 = 8;

/// Tangent of 85 degrees, the limit of a pinhole view. Scenes beyond this limit are refused.
const MAX_TANGENT: f64 = 11.43;

/// Horizontal and vertical tangents `[least, most]` in the capture camera's view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Window(pub(super) [[f64; 2]; 2]);

/// The rays that can hit a side.
pub(super) struct Sight {
    /// Directions of the camera's rays over film and lens.
    directions: Vec<DVec3>,
    slab: Slab,
    stack: Option<Stack>,
    bow: Option<Bow>,
    aperture_radius_m: f64,
    /// Tangent by which rough faces scatter 99.99 % of the light at normal incidence; 0 for smooth ones.
    scatter: f64,
    /// Orthogonal matrix from the lens's coordinates (for the back, of the mirrored world) to the capture camera's.
    rotation: DMat3,
    translation_m: DVec3,
    order: fn(u32) -> Order,
    /// True if rays pass beside the pane, without a shift.
    passes_beside: bool,
    /// Distance of the pane. Nearer surfaces are refused, except for a few pixels.
    pub(super) pane_m: f64,
}

impl Sight {
    pub(super) fn front(line: &SceneLine) -> Self {
        let aligned = (DMat3::IDENTITY, DVec3::ZERO);
        Self::new(line, slab(line), aligned, Order::Transmitted)
    }

    pub(super) fn back(line: &SceneLine) -> Self {
        let slab = slab(line);
        let capture_from_lens =
            BackCamera::new(line.back.apex().unwrap_or_default(), &slab).capture_from_lens();
        Self::new(line, slab, capture_from_lens, Order::Reflected)
    }

    fn new(
        line: &SceneLine,
        slab: Slab,
        (rotation, translation_m): (DMat3, DVec3),
        order: fn(u32) -> Order,
    ) -> Self {
        let film = film_plane(line);
        let aperture_radius_m = line.camera.aperture_radius_m;
        let inverse_focus_per_m = match line.camera.focus {
            Focus::Distance { distance_m } => 1.0 / distance_m,
            // The focus is unknown before both sides are decoded. The pane is the nearest plausible focus.
            Focus::At { at: FocusAt::FrontCenter | FocusAt::BackCenter } => {
                1.0 / line.glass.distance_m
            }
            Focus::At { at: FocusAt::Infinity } => 0.0,
        };
        let lens = Lens { aperture_radius_m, inverse_focus_per_m };
        let negligible = Negligible::of(line, &lens, line.glass.distance_m);
        let line = &*negligible.without(line);
        Self {
            directions: film_directions(film_reach(&film, &lens)),
            translation_m,
            slab,
            stack: stack(line),
            bow: bow(line),
            aperture_radius_m,
            scatter: largest_roughness(line)
                .map_or(0.0, |alphas| scatter(&layers(line), &alphas, order(0)))
                + turned(&layers(line), steepest(line), order(0)),
            rotation,
            order,
            passes_beside: line.glass.outline.is_some(),
            pane_m: line.glass.distance_m,
        }
    }

    /// Returns the shift along the normal of light after some round trips through the whole pane, m.
    fn shift_m(&self, round_trips: u32, cos_i: f64) -> f64 {
        let order = (self.order)(round_trips);
        let Some(stack) = &self.stack else {
            return self.slab.kappa_m(order, self.slab.gamma(cos_i));
        };
        let straight_m = stack.kappa_m(&stack.straight(), cos_i);
        let passage_m = stack.thickness_m() - straight_m;
        match order {
            Order::Transmitted(k) => straight_m - 2.0 * f64::from(k) * passage_m,
            Order::Reflected(k) => -2.0 * f64::from(k) * passage_m,
        }
    }

    /// Returns the window that shows all surfaces at `nearest_m` or more from the capture camera.
    pub(super) fn window(&self, nearest_m: f64) -> Window {
        let a = self.aperture_radius_m;
        let lens_points = [[-a, -a], [-a, a], [a, -a], [a, a]];
        let mut window = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        let mut include = |point: DVec3| {
            for (side, value) in window.iter_mut().zip([point.x, point.y]) {
                // A point behind the capture camera, or beyond 85 degrees, extends the window to the limit of a view.
                let tangent = if point.z > value.abs() / MAX_TANGENT {
                    value / point.z
                } else {
                    MAX_TANGENT.copysign(value)
                };
                *side = [side[0].min(tangent), side[1].max(tangent)];
            }
        };
        let mut include_line = |start: DVec3, d: DVec3| {
            let (start, direction) =
                (self.rotation * start + self.translation_m, self.rotation * d);
            include(direction);
            let along = start.dot(direction);
            let inside = along * along + nearest_m * nearest_m - start.length_squared();
            include(start + direction * (inside.max(0.0).sqrt() - along));
        };
        for d in &self.directions {
            let d = d.normalize();
            // `check_geometry` refuses panes with a normal at more than 85 degrees to a ray.
            let cos_i = d.dot(self.slab.normal).abs().max(1e-3);
            for [x, y] in lens_points {
                let lens = DVec3::new(x, y, 0.0);
                if self.passes_beside {
                    include_line(lens, d);
                }
                for round_trips in [0, ROUND_TRIPS] {
                    let shift = self.slab.normal * self.shift_m(round_trips, cos_i);
                    let order = (self.order)(round_trips);
                    // Behind a bent pane, every order has its own direction, too.
                    let bent = self.bow.and_then(|bow| bow.exit(&self.slab, order, lens, d));
                    let (start, d) = bent.unwrap_or((lens + shift, d));
                    include_line(start, d);
                    let aside = self.scatter / cos_i;
                    for [x, y] in if aside > 0.0 { lens_points.as_slice() } else { &[] } {
                        let [x, y] = [x, y].map(|v| aside.copysign(*v));
                        include_line(start, d + DVec3::new(x, y, 0.0));
                    }
                }
            }
        }
        Window(window)
    }
}

/// Returns the tangent within which rough faces scatter all but 1e-4 of the light of `order` at normal incidence: three
/// times the root of the sum of squares over the faces. A facet turns refracted light by its slope times the step of the index, and
/// reflected light by twice the slope, which the way out of the glass multiplies by the index.
fn scatter(pane: &Stack, alphas: &[f64], order: Order) -> f64 {
    let alpha = alphas.iter().copied().fold(0.0, f64::max);
    let step = |face| {
        let [near, far] = pane.iors(face);
        (far - near) * (far - near)
    };
    let refracted: f64 = (0..pane.coatings().len()).map(step).sum();
    let reflected = 2.0 * pane.largest_ior();
    3.0 * alpha
        * match order {
            Order::Transmitted(_) => refracted.sqrt(),
            Order::Reflected(_) => (reflected * reflected + 2.0 * refracted).sqrt(),
        }
}

/// Bounds the slope of a line's faces against the flat pane, by waves and wedges.
fn steepest(line: &SceneLine) -> f64 {
    let wedges = line.glass.layers.iter().flat_map(GlassLayer::wedge_deg);
    let wedge_deg: f64 = wedges.map(f64::abs).sum();
    line.glass.wave.map_or(0.0, |wave| wave.largest_slope()) + libm::tan(wedge_deg.to_radians())
}

/// Bounds the tangent by which faces with this slope turn the light of `order`: by twice the slope in each reflection, which the
/// way out of the glass multiplies by the index, and by the slope times the step of the index in each refraction.
fn turned(pane: &Stack, slope: f64, order: Order) -> f64 {
    let step = |face| {
        let [near, far] = pane.iors(face);
        (far - near).abs()
    };
    let refracted: f64 = (0..pane.coatings().len()).map(step).sum();
    slope
        * match order {
            Order::Transmitted(_) => refracted,
            Order::Reflected(_) => 2.0 * (pane.largest_ior() + refracted),
        }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(more: &str, back: &str) -> SceneLine {
        serde_json::from_str(&format!(
            r#"{{"schema":"glasshouse.scene/1","id":"w","seed":1,"film":{{"width":64,"height":64,"spp":4}},
            "camera":{{"focal_length_mm":55,"aperture_radius_m":0,"focus":{{"at":"infinity"}}}},
            "glass":{{"distance_m":0.3,{more}}},"front":{{"panorama":"p"}},"back":{{"panorama":"p"{back}}}}}"#
        ))
        .unwrap()
    }

    fn near(window: Window, expected: [[f64; 2]; 2], tolerance: f64) {
        let found = window.0.into_iter().flatten();
        for (found, expected) in found.zip(expected.into_iter().flatten()) {
            assert!((found - expected).abs() <= tolerance, "{window:?}");
        }
    }

    #[test]
    fn without_glass_and_lens_the_window_is_the_film() {
        let t = 36f64.hypot(24.0) / 110.0 / 2f64.sqrt();
        let line = line(r#""thickness_m":0,"ior":1"#, "");
        near(Sight::front(&line).window(1.0), [[-t, t]; 2], 1e-12);
        near(Sight::back(&line).window(1.0), [[-t, t]; 2], 1e-12);
    }

    #[test]
    fn a_camera_at_the_lens_sees_the_reflection_from_further_back() {
        let t = 36f64.hypot(24.0) / 110.0 / 2f64.sqrt();
        let line = line(r#""thickness_m":0,"ior":1.5"#, r#","apex":"camera""#);
        let Window([across, _]) = Sight::back(&line).window(2.0);
        // The ray starts at z = -0.6 m and meets the sphere of 2 m: x^2 + y^2 + z^2 = 4 with x = y = t (z + 0.6).
        let z = {
            let (a, b, c) = (1.0 + 2.0 * t * t, 2.0 * t * t * 0.6, 2.0 * t * t * 0.36 - 4.0);
            (-b + (b * b - a * c).sqrt()) / a
        };
        let expected = t * (z + 0.6) / z;
        assert!((across[1] - expected).abs() < 1e-9, "{across:?} {expected}");
        // If the pane turns by 10 degrees, the reflection turns by 20.
        let tilted = SceneLine {
            glass: glasshouse_line::Glass { tilt_deg: [0.0, 10.0], ..line.glass.clone() },
            ..line
        };
        let Window([across, down]) = Sight::back(&tilted).window(1e9);
        let middle = libm::atan(across[0]).midpoint(libm::atan(across[1]));
        assert!((middle.abs().to_degrees() - 20.0).abs() < 1e-6, "{across:?}");
        assert!((down[0] + down[1]).abs() < 1e-9);
    }

    #[test]
    fn a_near_sphere_a_wide_lens_and_thick_glass_widen_the_window() {
        let thin = Sight::front(&line(r#""thickness_m":0.01,"ior":1.5"#, ""));
        let thick = Sight::front(&line(r#""thickness_m":0.04,"ior":1.5"#, ""));
        let width = |window: Window| window.0[0][1];
        assert!(width(thick.window(2.0)) > width(thin.window(2.0)));
        assert!(width(thin.window(0.5)) > width(thin.window(2.0)));
        let mut wide = line(r#""thickness_m":0.01,"ior":1.5"#, "");
        wide.camera.aperture_radius_m = 0.02;
        let open = Sight::front(&wide).window(2.0);
        assert!((width(open) - width(thin.window(2.0)) - 0.01).abs() < 2e-3);
    }
}
