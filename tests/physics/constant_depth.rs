//! For planes parallel to the film with a linear ramp of radiance, every layer has a closed form.
//!
//! A line with direction (p, 1) from the lens centre, shifted by kappa n for the normal n, meets the plane z = Z at
//! X = p (Z - kappa n_z) + kappa (n_x, n_y). The mean over the lens is close to the value at its centre.

use crate::case::{Apex, CLEAN, Case, GLASS, I, Photo, T};
use glam::{DVec2, DVec3};
use render::trace::Order;

const DEPTH_M: f64 = 2.2;
const OFFSET: f64 = 0.5;

fn slope(c: usize) -> DVec2 {
    [DVec2::new(0.21, 0.05), DVec2::new(-0.12, 0.3), DVec2::new(0.0, -0.25)][c]
}

/// Makes a plane at `depth_m` with radiance `OFFSET + slope . (X, Y)`.
fn ramp(depth_m: f64) -> Photo {
    const SIZE: usize = 64;
    const TAN: f64 = 0.5;
    let at = move |k: usize| ((k as f64 + 0.5) / SIZE as f64 * 2.0 - 1.0) * TAN * depth_m;
    Photo::new(
        [9, 5],
        [SIZE, SIZE],
        [TAN; 2],
        |_, _| depth_m,
        move |i, j| [0, 1, 2].map(|c| OFFSET + slope(c).dot(DVec2::new(at(i), at(j)))),
    )
}

/// Returns (x, y) of the point where the line from the lens centre, shifted by kappa n, meets the plane z = `depth_m`.
fn landing(case: &Case, p: DVec2, kappa: f64, depth_m: f64) -> DVec2 {
    let (n, _) = case.pane();
    p * (depth_m - kappa * n.z) + kappa * n.truncate()
}

/// Returns the largest deviations of the four layers from the formulas.
fn deviations(case: &Case) -> [f64; 4] {
    let scene = case.scene();
    let (n, _) = case.pane();
    let [tx, ty] = case.tan_half_fov();
    let [w, h] = case.film;
    let mut worst = [0f64; 4];
    for (q, pixel) in case.render().iter().enumerate() {
        let (x, y) = (q as u32 % w, q as u32 / w);
        let mut expected = [[0.0; 3]; 4];
        const STEPS: u32 = 8;
        for sub in 0..STEPS * STEPS {
            let at = |k: u32, sub: u32, n: u32| {
                2.0 * (f64::from(k) + (f64::from(sub) + 0.5) / f64::from(STEPS)) / f64::from(n)
                    - 1.0
            };
            let p = DVec2::new(at(x, sub % STEPS, w) * tx, at(y, sub / STEPS, h) * ty);
            let d = DVec3::new(p.x, p.y, 1.0).normalize();
            let cos_i = d.dot(n);
            let gamma = (d.dot(n) / case.ior)
                / (1.0 - d.cross(n).length_squared() / (case.ior * case.ior)).sqrt();
            for followed in scene.orders.front.iter().chain(&scene.orders.back) {
                let weight = scene.slab.weight(followed.order, cos_i);
                let (kappa, is_front) = match followed.order {
                    Order::Transmitted(k) => {
                        (case.thickness_m * (1.0 - f64::from(2 * k + 1) * gamma), true)
                    }
                    Order::Reflected(k) => (-case.thickness_m * gamma * f64::from(2 * k), false),
                };
                let mut place = landing(case, p, kappa, DEPTH_M);
                if !is_front {
                    place.x = -place.x;
                }
                for c in 0..3 {
                    let value = (OFFSET + slope(c).dot(place)) / f64::from(STEPS * STEPS);
                    expected[I][c] += weight[c] * value;
                    if !is_front {
                        expected[GLASS][c] += weight[c] * value;
                    } else if followed.order == Order::Transmitted(0) {
                        expected[T][c] += value;
                    }
                }
            }
            let place = DVec2::new(-p.x, p.y) * DEPTH_M;
            for c in 0..3 {
                expected[CLEAN][c] += (OFFSET + slope(c).dot(place)) / f64::from(STEPS * STEPS);
            }
        }
        for layer in 0..4 {
            for c in 0..3 {
                let difference = f64::from(pixel.mean[layer][c]) - expected[layer][c];
                worst[layer] = worst[layer].max(difference.abs());
            }
        }
    }
    worst
}

fn case() -> Case {
    let mut case = Case::new(ramp(DEPTH_M), ramp(DEPTH_M));
    case.film = [12, 8];
    case.spp = 1024;
    case
}

fn check(name: &str, case: &Case) {
    let worst = deviations(case);
    println!("{name}: I, T, R~, R off by {worst:?}");
    // 1,024 Sobol points integrate a ramp over pixel and lens to about 1e-5 of its range there; R has 256.
    assert!(worst.iter().all(|d| *d < 4e-5), "{name}: {worst:?}");
}

#[test]
fn ramps_do_not_depend_on_focus_and_aperture() {
    for focus_m in [0.9, 2.2, 8.0, f64::INFINITY] {
        for aperture_m in [0.0, 0.00893, 0.03] {
            let mut case = case();
            (case.focus_m, case.aperture_m) = (focus_m, aperture_m);
            check(&format!("focus {focus_m} m, aperture {aperture_m} m"), &case);
        }
    }
}

#[test]
fn ramps_behind_tilted_panes_match_the_formulas() {
    for (tilt_deg, thickness_m) in [([0.0, 25.0], 0.01), ([-30.0, 12.0], 0.05), ([8.0, -45.0], 0.1)]
    {
        let mut case = case();
        (case.tilt_deg, case.thickness_m) = (tilt_deg, thickness_m);
        case.absorption_per_m = [0.0, 2.0, 9.0];
        check(&format!("tilt {tilt_deg:?}, {thickness_m} m"), &case);
    }
}

/// With an untilted pane, a plane captured from the lens looks like one captured from the lens's mirror image.
#[test]
fn ramps_from_apex_camera_match_those_from_apex_mirror() {
    let mut mirror = case();
    mirror.aperture_m = 0.0;
    // The lens is nearer to the back plane than the lens's mirror image, by twice the distance of the pane.
    let mut camera = mirror.clone();
    camera.apex = Apex::Camera;
    camera.back = ramp(DEPTH_M - 0.6);
    let (a, b) = (mirror.render(), camera.render());
    let mut worst = [0f32; 4];
    for (a, b) in a.iter().zip(&b) {
        for (layer, worst) in worst.iter_mut().enumerate() {
            for c in 0..3 {
                *worst = worst.max((a.mean[layer][c] - b.mean[layer][c]).abs());
            }
        }
    }
    println!("apex camera against mirror: {worst:?}");
    assert!(worst[..3].iter().all(|worst| *worst < 2e-6));
    // R takes samples with apex `camera`, and is in closed form with apex `mirror`.
    assert!(worst[3] < 1e-5);
}

#[test]
fn glass_with_the_ior_of_air_has_no_effect() {
    let mut case = case();
    case.ior = 1.0;
    case.tilt_deg = [10.0, 20.0];
    for pixel in case.render() {
        assert_eq!(pixel.mean[I], pixel.mean[T]);
        assert_eq!(pixel.mean[GLASS], [0.0; 3]);
    }
    check("ior 1", &case);
}

/// A pane without thickness bends nothing: I = total transmittance x T + total reflectance x R.
#[test]
fn thin_glass_splits_light_and_bends_nothing() {
    let mut case = case();
    case.thickness_m = 0.0;
    case.aperture_m = 0.0;
    let r = (0.6f64 / 2.6).powi(2);
    let (through, back) = ((1.0 - r) / (1.0 + r), 2.0 * r / (1.0 + r));
    case.focal_length_mm = 2000.0;
    let mut worst = 0f64;
    for pixel in case.render() {
        for c in 0..3 {
            let [i, t, glass, clean] = [I, T, GLASS, CLEAN].map(|l| f64::from(pixel.mean[l][c]));
            worst = worst.max((glass - back * clean).abs());
            worst = worst.max((i - through * t - back * clean).abs());
        }
    }
    println!("thickness 0, near normal incidence: {worst:.1e}");
    // The dropped orders t_2, t_3, ... and r_3, r_4, ... add up to at most 1e-5.
    assert!(worst < 4e-5);
    check("thickness 0", &case);
}

/// Renders constant planes at aperture 0 and normal incidence.
#[test]
fn constant_planes_mix_by_the_totals() {
    let mut case = Case::new(Photo::flat(3.0, [0.8, 0.4, 0.1]), Photo::flat(1.5, [0.2, 1.0, 0.5]));
    case.film = [1, 1];
    case.focal_length_mm = 5000.0;
    case.aperture_m = 0.0;
    case.tolerance = 1e-9;
    let pixel = case.render()[0];
    assert_eq!(pixel.mean[T], [0.8, 0.4, 0.1]);
    assert_eq!(pixel.mean[CLEAN], [0.2, 1.0, 0.5]);
    for c in 0..3 {
        let (front, back) = ([0.8, 0.4, 0.1][c], [0.2, 1.0, 0.5][c]);
        let expected = 0.898_876_404 * front + 0.101_123_596 * back;
        assert!((f64::from(pixel.mean[I][c]) - expected).abs() < 1e-6);
    }
}
