//! Refuses panes at a grazing angle and panes that cut the lens.

use super::geometry::{bow, filter_reach_px, layers, slab, turned_faces, unfiltered_film};
use crate::trace::Slab;
use glam::DVec3;
use glasshouse_line::SceneLine;

/// Largest angle between a camera ray and the pane's normal.
pub const MAX_INCIDENCE_DEG: f64 = 85.0;

/// A pane that cannot be rendered.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GeometryError {
    /// A ray that meets the pane at a grazing angle.
    #[error(
        "a ray of film point ({u} px, {v} px) meets the pane at {angle_deg:.2} degrees, but at most \
         85 are allowed: reduce glass.tilt_deg ({pitch_deg}, {yaw_deg}), increase \
         camera.focal_length_mm ({focal_length_mm}) or reduce camera.aperture_radius_m"
    )]
    Grazing {
        /// Film point of the refused ray, px.
        u: f64,
        v: f64,
        /// Angle between this ray and the pane's normal.
        angle_deg: f64,
        pitch_deg: f64,
        yaw_deg: f64,
        focal_length_mm: f64,
    },
    /// A tilted pane that reaches into the lens opening.
    #[error(
        "the pane cuts the lens: its plane is {plane_distance_m} m from the lens centre, but must be \
         farther than {reach_m} m, the reach of the opening towards the pane: increase glass.distance_m \
         ({distance_m}), reduce glass.tilt_deg or reduce camera.aperture_radius_m"
    )]
    PaneCutsLens {
        /// Distance of the pane's plane from the lens centre, along the normal.
        plane_distance_m: f64,
        /// Largest distance of a point of the lens opening from the lens centre, along the normal.
        reach_m: f64,
        distance_m: f64,
    },
    /// A bent pane that a ray misses, or that reflects a ray sideways.
    #[error(
        "the bent pane folds the view: the ray of film point ({u} px, {v} px) {problem}: give glass.bow_radius_m \
         ({radius_m} m) a larger magnitude, or reduce glass.tilt_deg or the field of view (camera.focal_length_mm)"
    )]
    Folded {
        /// Film point of the refused ray, px.
        u: f64,
        v: f64,
        problem: &'static str,
        radius_m: f64,
    },
    /// A layer whose wedge leaves it without thickness inside the picture.
    #[error(
        "the faces before and behind layer {layer} of the pane meet inside the picture, at film point ({u} px, {v} px): reduce \
         glass.layers[{layer}].wedge_deg (in recipes glass.wedge_deg), glass.distance_m or glass.tilt_deg, or make the layer thicker"
    )]
    FacesMeet {
        layer: usize,
        /// Film point whose ray meets the pane there, px.
        u: f64,
        v: f64,
    },
}

/// Refuses a pane that cuts the lens, or that a camera ray meets at more than [`MAX_INCIDENCE_DEG`].
///
/// `inverse_focus_distance_per_m` is 1 / focus distance, and 0 for a focus at infinity. The focus is a parameter
/// because a focus on a side's centre is known only after the side's files have been read.
pub fn check_geometry(
    line: &SceneLine,
    inverse_focus_distance_per_m: f64,
) -> Result<(), GeometryError> {
    let slab = slab(line);
    let (normal, plane_distance_m) = (slab.normal, slab.plane_distance_m);
    let aperture_radius_m = line.camera.aperture_radius_m;

    let reach_m = aperture_radius_m * libm::sqrt((1.0 - normal.z * normal.z).max(0.0));
    // This comparison and that of `is_steep_enough` are false for NaN, so NaN is refused, too.
    let is_clear = plane_distance_m > reach_m;
    if !is_clear {
        return Err(GeometryError::PaneCutsLens {
            plane_distance_m,
            reach_m,
            distance_m: line.glass.distance_m,
        });
    }

    let spread = aperture_radius_m * inverse_focus_distance_per_m;
    let least_cos = libm::cos(MAX_INCIDENCE_DEG.to_radians());
    check_bow(line, &slab, spread, least_cos)?;
    for corner in film_corners(line) {
        let direction = worst_direction(corner.slope, spread, normal, least_cos);
        let is_steep_enough = excess(direction, normal, least_cos) >= 0.0;
        if !is_steep_enough {
            let length =
                libm::sqrt(direction[0] * direction[0] + direction[1] * direction[1] + 1.0);
            let cos_i = (dot(direction, normal) + normal.z) / length;
            // Adding 0 turns -0 into 0 for the message.
            let (u, v) = (corner.u + 0.0, corner.v + 0.0);
            let angle_deg = libm::acos(cos_i.clamp(-1.0, 1.0)).to_degrees();
            let [pitch_deg, yaw_deg] = line.glass.tilt_deg;
            let focal_length_mm = line.camera.focal_length_mm;
            return Err(GeometryError::Grazing {
                u,
                v,
                angle_deg,
                pitch_deg,
                yaw_deg,
                focal_length_mm,
            });
        }
    }
    check_wedges(line, &slab)
}

/// Refuses wedges with which two faces of the pane meet inside the picture. Depths of faces over face 0 are linear, so the corners
/// of the film decide.
fn check_wedges(line: &SceneLine, slab: &Slab) -> Result<(), GeometryError> {
    let Some(turned) = turned_faces(line) else {
        return Ok(());
    };
    let (stack, n) = (layers(line), slab.normal);
    let pivot = DVec3::Z * line.glass.distance_m;
    for corner in film_corners(line) {
        let d = DVec3::new(corner.slope[0], corner.slope[1], 1.0);
        let from_pivot = d * (slab.plane_distance_m / d.dot(n)) - pivot;
        let depth_m = |face: usize| {
            let normal = turned[face] * n;
            stack.depth_m(face) - from_pivot.dot(normal) / n.dot(normal)
        };
        // The margin is for the rounding of layers without thickness. The comparison is false for NaN, so NaN is refused, too.
        let is_open = |layer: &usize| depth_m(layer + 1) - depth_m(*layer) >= -1e-12;
        if let Some(layer) = (0..turned.len() - 1).find(|layer| !is_open(layer)) {
            return Err(GeometryError::FacesMeet { layer, u: corner.u + 0.0, v: corner.v + 0.0 });
        }
    }
    Ok(())
}

/// Least ratio of the radii of a bent pane's faces; its inverse is the largest.
const LEAST_RATIO: f64 = 0.5;

/// Refuses a bent pane that the rays of a grid over film and lens miss, meet at more than [`MAX_INCIDENCE_DEG`], or leave
/// sideways.
fn check_bow(
    line: &SceneLine,
    slab: &Slab,
    spread: f64,
    least_cos: f64,
) -> Result<(), GeometryError> {
    const STEPS: u32 = 16;
    let (Some(bow), Some(radius_m)) = (bow(line), line.glass.bow_radius_m) else {
        return Ok(());
    };
    let film = unfiltered_film(line);
    let (beyond, a) = (filter_reach_px(line.film.filter), line.camera.aperture_radius_m);
    let ratio = bow.ratio(slab);
    let problem_of = |lens: DVec3, direction: DVec3| {
        if !(LEAST_RATIO..=1.0 / LEAST_RATIO).contains(&ratio) {
            return Some("meets faces with too different radii");
        }
        let Some((_, normal)) = bow.entry(slab, lens, direction) else {
            return Some("misses it");
        };
        let d = direction.normalize();
        let cos = d.dot(normal);
        let mirrored = d - 2.0 * cos * normal;
        let mirrored = mirrored - 2.0 * mirrored.dot(slab.normal) * slab.normal;
        match () {
            // The sine must also be smaller than the ratio, or light does not leave the rear face.
            () if cos < least_cos || 1.0 - cos * cos >= (ratio * ratio).min(1.0) => {
                Some("meets it at more than 85 degrees")
            }
            () if mirrored.z < libm::cos(MAX_INCIDENCE_DEG.to_radians()) => {
                Some("is reflected sideways")
            }
            () => None,
        }
    };
    let at = |step: u32, size: u32| {
        f64::from(step) / f64::from(STEPS) * (f64::from(size) + 2.0 * beyond) - beyond
    };
    for (i, j) in (0..=STEPS).flat_map(|j| (0..=STEPS).map(move |i| (i, j))) {
        let (u, v) = (at(i, film.width), at(j, film.height));
        let [x, y] = film.tangent(u, v);
        for (lx, ly) in [(0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)] {
            let direction = DVec3::new(x - spread * lx, y - spread * ly, 1.0);
            if let Some(problem) = problem_of(DVec3::new(a * lx, a * ly, 0.0), direction) {
                return Err(GeometryError::Folded { u, v, problem, radius_m });
            }
        }
    }
    Ok(())
}

/// A corner of the film: its pixel coordinates, and x/z and y/z of its pinhole ray.
struct Corner {
    u: f64,
    v: f64,
    slope: [f64; 2],
}

fn film_corners(line: &SceneLine) -> [Corner; 4] {
    let film = unfiltered_film(line);
    let (width, height) = (f64::from(film.width), f64::from(film.height));
    let beyond = filter_reach_px(line.film.filter);
    let corner = |u: f64, v: f64| Corner { u, v, slope: film.tangent(u, v) };
    [
        corner(-beyond, -beyond),
        corner(width + beyond, -beyond),
        corner(-beyond, height + beyond),
        corner(width + beyond, height + beyond),
    ]
}

/// Computes d.n - `least_cos` |d| for d = (slope, 1), which is negative for refused rays.
///
/// The value is concave in the slope. Its minimum over the film widened by the lens (the Minkowski sum of a rectangle
/// and a disc) is therefore on the circle about one of the four corners.
fn excess(slope: [f64; 2], normal: DVec3, least_cos: f64) -> f64 {
    let length = libm::sqrt(slope[0] * slope[0] + slope[1] * slope[1] + 1.0);
    dot(slope, normal) + normal.z - least_cos * length
}

fn dot(slope: [f64; 2], normal: DVec3) -> f64 {
    slope[0] * normal.x + slope[1] * normal.y
}

/// Returns the slope with the least [`excess`] on the circle of radius `spread` about `corner`.
///
/// Each step moves to the point of the circle opposite to the gradient, which never raises a concave function. Eight
/// starts avoid local minima.
fn worst_direction(corner: [f64; 2], spread: f64, normal: DVec3, least_cos: f64) -> [f64; 2] {
    const STARTS: u32 = 8;
    const STEPS: u32 = 32;
    if spread == 0.0 {
        return corner;
    }
    let mut worst = (f64::INFINITY, corner);
    for start in 0..STARTS {
        let (sin, cos) = libm::sincos(f64::from(start) * std::f64::consts::TAU / f64::from(STARTS));
        let mut toward = [cos, sin];
        for _ in 0..STEPS {
            let slope = [corner[0] + spread * toward[0], corner[1] + spread * toward[1]];
            let value = excess(slope, normal, least_cos);
            if value < worst.0 || value.is_nan() {
                worst = (value, slope);
            }
            let length = libm::sqrt(slope[0] * slope[0] + slope[1] * slope[1] + 1.0);
            let gradient = [
                normal.x - least_cos * slope[0] / length,
                normal.y - least_cos * slope[1] / length,
            ];
            let steepness = libm::hypot(gradient[0], gradient[1]);
            if steepness == 0.0 {
                break;
            }
            toward = [-gradient[0] / steepness, -gradient[1] / steepness];
        }
    }
    worst.1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::Slab;
    use glasshouse_line::published;
    use glasshouse_line::{Filter, GlassLayer, Roughness};
    use proptest::prelude::*;

    fn tilted(pitch_deg: f64, yaw_deg: f64) -> SceneLine {
        let mut line = published();
        line.glass.tilt_deg = [pitch_deg, yaw_deg];
        line
    }

    #[test]
    fn the_published_pane_is_accepted_at_every_focus() {
        for inverse_focus_per_m in [0.0, 1.0 / 7.05, 2.0] {
            check_geometry(&published(), inverse_focus_per_m).unwrap();
        }
    }

    #[test]
    fn the_film_s_corner_limits_the_tilt_of_a_pane() {
        // A corner ray of the square film meets the pane at 85 degrees for a pitch of 69.28 degrees.
        check_geometry(&tilted(69.0, 0.0), 0.0).unwrap();
        let error = check_geometry(&tilted(72.0, 0.0), 0.0).unwrap_err();
        assert!(matches!(error, GeometryError::Grazing { .. }), "{error}");
        assert!(error.to_string().contains("glass.tilt_deg (72, 0)"), "{error}");
    }

    #[test]
    fn the_gaussian_filter_reaches_beyond_the_film() {
        let mut line = tilted(0.0, 0.0);
        line.film.width = 4;
        line.film.height = 4;
        let limit = (0..900)
            .map(|tenth| f64::from(tenth) / 10.0)
            .find(|&yaw| check_geometry(&tilted_film(&line, yaw), 0.0).is_err())
            .unwrap();
        line.film.filter = Filter::Gaussian;
        assert!(check_geometry(&tilted_film(&line, limit - 5.0), 0.0).is_err());
    }

    fn tilted_film(line: &SceneLine, yaw_deg: f64) -> SceneLine {
        let mut line = line.clone();
        line.glass.tilt_deg = [0.0, yaw_deg];
        line
    }

    #[test]
    fn a_pane_in_the_lens_is_refused() {
        let mut line = tilted(0.0, 60.0);
        line.glass.distance_m = 0.015;
        let error = check_geometry(&line, 0.0).unwrap_err();
        assert!(matches!(error, GeometryError::PaneCutsLens { .. }), "{error}");
        line.glass.distance_m = 0.016;
        check_geometry(&line, 0.0).unwrap();
    }

    #[test]
    fn wedges_whose_faces_meet_inside_the_picture_are_refused() {
        let wedged = |glass_m: f64, wedge_deg: [f64; 2]| {
            let mut line = published();
            let (ior, absorption_per_m) = (1.52, [0.0; 3]);
            let layers = [GlassLayer::Glass { glass_m, ior, absorption_per_m, wedge_deg }];
            line.glass.set_stack(&layers);
            let half_m = film_corners(&line)[0].slope[0].abs() * line.glass.distance_m;
            (check_geometry(&line, 0.0), half_m)
        };
        // The faces meet where the distance from the pivot times the slope is the thickness.
        let (found, half_m) = wedged(0.004, [0.0, 0.1]);
        found.unwrap();
        let meets_deg = (0.004 / half_m).atan().to_degrees();
        wedged(0.004, [0.0, 0.99 * meets_deg]).0.unwrap();
        for wedge_deg in [[0.0, 1.01 * meets_deg], [0.0, -1.01 * meets_deg]] {
            let error = wedged(0.004, wedge_deg).0.unwrap_err().to_string();
            assert!(
                error.contains("behind layer 0 of the pane meet inside the picture"),
                "{error}"
            );
            assert!(error.contains("reduce glass.layers[0].wedge_deg"), "{error}");
        }
        assert!(wedged(0.0, [0.1, 0.0]).0.is_err());
    }

    #[test]
    fn panes_that_fold_the_view_are_refused() {
        let bent = |radius_m: f64, tilt_deg: [f64; 2]| {
            let mut line = published();
            (line.glass.bow_radius_m, line.glass.tilt_deg) = (Some(radius_m), tilt_deg);
            check_geometry(&line, 1.0 / 3.0).map_err(|error| error.to_string())
        };
        for radius_m in [8.0, -8.0, 1.0, -1.0] {
            bent(radius_m, [0.0; 2]).unwrap();
        }
        for (radius_m, tilt_deg, problem) in [
            (-0.05, [0.0; 2], "misses it"),
            (0.005, [0.0; 2], "too different radii"),
            (-0.2, [0.0; 2], "is reflected sideways"),
            (-0.6, [0.0, 60.0], "misses it"),
        ] {
            let error = bent(radius_m, tilt_deg).unwrap_err();
            assert!(error.contains(problem), "{radius_m}: {error}");
            assert!(error.contains("give glass.bow_radius_m"), "{error}");
        }
    }

    /// Facets that hide each other are a part of the model, so roughness refuses no angle.
    #[test]
    fn rough_panes_are_accepted_at_the_angles_of_smooth_ones() {
        let rough = |alpha: f64, yaw_deg: f64| {
            let mut line = tilted(0.0, yaw_deg);
            line.glass.roughness = Some(Roughness::All(alpha));
            check_geometry(&line, 0.0)
        };
        // A corner ray meets the pane at about 15.7 degrees more than the tilt.
        for alpha in [0.0, 0.02, 0.1] {
            rough(alpha, 69.0).unwrap();
            assert!(matches!(rough(alpha, 72.0), Err(GeometryError::Grazing { .. })));
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(256))]
        /// The check agrees with the largest angle over a fine grid of film and lens points.
        #[test]
        fn refusal_agrees_with_brute_force(
            pitch in -80.0..80.0f64, yaw in -80.0..80.0f64, focal_length_mm in 12.0..80.0f64,
            width in 1u32..600, height in 1u32..600, aperture_radius_m in 0.0..0.2f64,
            inverse_focus_per_m in 0.0..4.0f64, gaussian: bool,
        ) {
            let mut line = tilted(pitch, yaw);
            line.glass.distance_m = 5.0;
            line.camera.focal_length_mm = focal_length_mm;
            line.camera.aperture_radius_m = aperture_radius_m;
            line.film.width = width;
            line.film.height = height;
            line.film.filter = if gaussian { Filter::Gaussian } else { Filter::Box };
            let beyond = if gaussian { 2.0 } else { 0.0 };
            let (w, h) = (f64::from(width), f64::from(height));

            let normal = Slab::tilted_normal(line.glass.tilt_deg).to_array();
            let diagonal = 36f64.hypot(24.0) / (2.0 * focal_length_mm) / w.hypot(h);
            let mut widest_deg = 0.0f64;
            for film in 0..121 {
                let (across, down) = (f64::from(film % 11) / 10.0, f64::from(film / 11) / 10.0);
                let u = -beyond + across * (w + 2.0 * beyond);
                let v = -beyond + down * (h + 2.0 * beyond);
                let tx = diagonal * w;
                let ty = diagonal * h;
                for lens in 0..240 {
                    let radius = aperture_radius_m * f64::from(lens / 120);
                    let (sin, cos) = (f64::from(lens % 120) * 3f64.to_radians()).sin_cos();
                    let d = [
                        (2.0 * u / w - 1.0) * tx - radius * cos * inverse_focus_per_m,
                        (2.0 * v / h - 1.0) * ty - radius * sin * inverse_focus_per_m,
                        1.0,
                    ];
                    let length = d.iter().map(|x| x * x).sum::<f64>().sqrt();
                    let cos_i = d.iter().zip(normal).map(|(a, b)| a * b).sum::<f64>() / length;
                    widest_deg = widest_deg.max(cos_i.acos().to_degrees());
                }
            }
            match check_geometry(&line, inverse_focus_per_m) {
                Ok(()) => prop_assert!(widest_deg <= 85.0 + 1e-9, "{widest_deg}"),
                Err(GeometryError::Grazing { angle_deg, .. }) => {
                    prop_assert!(angle_deg > 85.0);
                    prop_assert!(widest_deg > 84.9, "{widest_deg} for {angle_deg}");
                }
                Err(GeometryError::PaneCutsLens { plane_distance_m, reach_m, .. }) => {
                    prop_assert!(plane_distance_m <= reach_m);
                }
                Err(other) => prop_assert!(false, "the pane is flat, smooth and parallel: {other}"),
            }
        }
    }
}
