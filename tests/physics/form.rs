//! Forms of the rays behind waves and wedges: they are the followed rays.

use crate::case::{Case, I, bumpy, whole_film};
use crate::optics::{Exit, mirrored};
use crate::reference::Reference;
use crate::rough::RoughReference;
use glam::DVec3;
use render::trace::{BundleProbe, Forms, Isa, Order, PixelSeed, Scene, Stack, StackLayer, sample};

const STEP_PX: u32 = 212;

fn double_pane() -> Stack {
    let layer = |thickness_m, ior| StackLayer { thickness_m, ior, absorption_per_m: [4.0; 3] };
    let air = StackLayer { absorption_per_m: [0.0; 3], ..layer(0.016, 1.0) };
    Stack::new(vec![layer(0.004, 1.52), air, layer(0.004, 1.52)], vec![None; 4])
}

/// Returns panes with the waves and wedges of real windows.
fn cases() -> Vec<(&'static str, Case)> {
    let mut case = Case::new(bumpy(1, false), bumpy(2, false));
    (case.film, case.spp, case.joins) = ([640, 480], 16, false);
    (case.distance_m, case.focus_m) = (0.6, 2.5);
    let mut steep = case.clone();
    (steep.tilt_deg, steep.gaussian, steep.wave) = ([3.0, 40.0], true, Some([1e-4, 0.2, 0.0]));
    let mut wedged = case.clone();
    (wedged.turned_deg, wedged.tilt_deg) = (vec![[0.0; 2], [0.05, 0.1]], [-4.0, 25.0]);
    let mut both = case.clone();
    (both.wave, both.stack) = (Some([1e-4, 0.3, 90.0]), Some(double_pane()));
    both.turned_deg = vec![[0.0; 2], [0.05, -0.02], [0.1, 0.1], [-0.05, 0.0]];
    both.aperture_m = 0.003;
    let mut pinhole = both.clone();
    (pinhole.aperture_m, pinhole.turned_deg) = (0.0, vec![]);
    vec![("steep waves", steep), ("wedge", wedged), ("both", both), ("pinhole", pinhole)]
}

/// Returns the largest distance of a probe's lines from those in f64, of points at infinity and at the pane, px.
fn worst_px(case: &Case, scene: &Scene, order: Order, index: usize) -> f64 {
    let probe = BundleProbe::new(scene, Some(order), STEP_PX).expect("a sheet");
    let reference = Reference::new(case, scene);
    let followed = RoughReference::of_any(case);
    let pane = scene.rough.as_ref().expect("waves or wedges");
    let paths = pane.paths(order, index);
    let [path] = paths[..] else { panic!("orders stay apart") };
    let is_back = matches!(order, Order::Reflected(_));
    let (normal, plane_m) = case.pane();
    let pixel = scene.film.pixel_tangent();
    let corners = |length: u32| (0..length).step_by(STEP_PX as usize);
    let corners: Vec<[u32; 2]> =
        corners(case.film[1]).flat_map(|y| corners(case.film[0]).map(move |x| [x, y])).collect();
    let mut worst = 0.0f64;
    for (number, ray) in probe.rays().iter().enumerate() {
        let (lane, index) = ((number % 16) as u32, (number / 16 % 16) as u32);
        let [x, y] = corners[number / 256];
        let (x, y) = (x + lane % 4, y + lane / 4);
        let seed = PixelSeed::new(case.seed, x, y);
        let (_, origin, d) = reference.camera(x, y, sample(&seed, index));
        let Exit { mut point, mut direction, .. } =
            followed.follow(path, (&seed, index), origin, d);
        if is_back {
            // The world that reflected rays see is mirrored in the plane of face 0.
            point -= 2.0 * (point.dot(normal) - plane_m) * normal;
            direction = mirrored(direction, normal);
        }
        let exact = direction / direction.z;
        let at_lens = point - point.z * exact;
        // The axis of a mirrored view points the other way.
        let sign = if is_back { -1.0 } else { 1.0 };
        let [found, from] = [ray.direction, ray.origin]
            .map(|[x, y, _]| DVec3::new(sign * f64::from(x), f64::from(y), 0.0));
        for inverse_m in [0.0, 1.0 / plane_m] {
            let apart = (found - exact) + (from - at_lens) * inverse_m;
            (0..2).for_each(|k| worst = worst.max((apart[k] / pixel[k]).abs()));
        }
    }
    worst
}

/// The lines of forms are those of rays that are followed in f64, within a thousandth of a pixel; those of weak orders within the rounding of rays followed in f32.
#[test]
fn lines_of_forms_are_exact() {
    for (name, case) in cases() {
        let scene = case.scene();
        let orders = &scene.orders;
        for side in [&orders.front, &orders.back] {
            let worst: Vec<f64> = side
                .iter()
                .enumerate()
                .map(|(index, of)| worst_px(&case, &scene, of.order, index))
                .collect();
            let largest = worst.iter().copied().fold(0.0, f64::max);
            println!(
                "{name}: {} orders, first {:.1e} px, worst {largest:.1e} px",
                worst.len(),
                worst[0]
            );
            assert!(worst[0] < 1e-3 && largest < 2e-3, "{name}: {worst:?}");
        }
    }
}

/// Returns the scene with rays that are all followed.
fn followed(case: &Case) -> Scene {
    let mut scene = case.scene();
    scene.zones.forms = Forms::default();
    scene
}

/// Returns the largest difference of the pictures of forms and of followed rays.
fn worst_difference(case: &Case) -> f64 {
    let [formed, followed] =
        [case.scene(), followed(case)].map(|scene| whole_film(&scene, Isa::detect()).pixels);
    let pairs = formed.iter().zip(&followed);
    let of = |c: usize| pairs.clone().map(move |(a, b)| (a.mean[I][c] - b.mean[I][c]).abs());
    (0..3).flat_map(of).fold(0.0, f32::max).into()
}

/// Pictures of forms differ from those of followed rays by rounding; waves that are too short for a form are followed.
#[test]
fn pictures_of_forms_are_those_of_followed_rays() {
    for (name, mut case) in cases() {
        case.film = [160, 120];
        let worst = worst_difference(&case);
        println!("{name}: {worst:.1e}");
        assert!(worst > 0.0, "{name}: the rays have a form");
        assert!(worst < 2e-5, "{name}: {worst:e}");
    }
    let mut case = Case::new(bumpy(1, false), bumpy(2, false));
    (case.film, case.spp, case.wave) = ([40, 32], 4, Some([1e-5, 0.01, 30.0]));
    assert_eq!(worst_difference(&case), 0.0, "short waves are followed");
}
