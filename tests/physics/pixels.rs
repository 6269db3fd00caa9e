//! Compares pixels of rough scenes with the brute-force renderer: intersections, optics, lens and colour together.

use crate::case::{Apex, Case, Photo, noise, whole_film};
use crate::cover::{Edges, noisy_card};
use crate::reference::Reference;
use crate::stack::{coated_double_pane, double_pane};
use render::trace::Isa;

/// Shape of the depth image.
#[derive(Clone, Copy)]
enum Relief {
    Steps,
    Noise,
    Smooth,
}

fn rough(size: [usize; 2], texture: [usize; 2], relief: Relief, key: u64) -> Photo {
    let depth = |i: usize, j: usize| {
        let (x, y) = (i as f64, j as f64);
        match relief {
            Relief::Steps => 0.8 + 3.0 * (noise(i / 3, j / 2, key) * 4.0).floor() / 4.0,
            Relief::Noise => 0.8 + 2.0 * noise(i, j, key),
            Relief::Smooth => 2.0 + 0.6 * (0.7 * x).sin() + 0.5 * (0.5 * y + 0.3 * x).cos(),
        }
    };
    // The photograph's field of view is narrower than the film's, so rays also hit the continuation of the border.
    let colour = |i: usize, j: usize| [0, 1, 2].map(|c| noise(i, j, key + 17 + c));
    Photo::new(size, texture, [0.24, 0.22], depth, colour)
}

/// Returns the largest difference of every `step`-th pixel of every `step`-th row, and all differences, both sorted.
pub(crate) fn differences(case: &Case, step: u32) -> (Vec<f64>, Vec<f64>) {
    let scene = case.scene();
    let rendered = whole_film(&scene, Isa::detect()).pixels;
    let reference = Reference::new(case, &scene);
    let [w, h] = case.film;
    let (mut largest, mut all) = (vec![], vec![]);
    for y in (0..h).step_by(step as usize) {
        for x in (0..w).step_by(step as usize) {
            let pixel = &rendered[(y * w + x) as usize];
            let expected = reference.pixel(x, y, pixel);
            let mut worst = 0f64;
            for layer in 0..4 {
                for c in 0..3 {
                    let difference = (f64::from(pixel.mean[layer][c]) - expected[layer][c]).abs();
                    worst = worst.max(difference);
                    all.push(difference);
                }
            }
            largest.push(worst);
        }
    }
    largest.sort_by(f64::total_cmp);
    all.sort_by(f64::total_cmp);
    (largest, all)
}

/// Renders a case, and compares every third pixel of every third row with [`Reference`].
pub(crate) fn compare(name: &str, case: &Case) {
    compare_within(name, case, 1e-6);
}

/// Like [`compare`], with this limit of the mean difference.
fn compare_within(name: &str, case: &Case, mean_limit: f64) {
    let (largest, all) = differences(case, 3);
    let mean = all.iter().sum::<f64>() / all.len() as f64;
    let close = largest.iter().filter(|d| **d <= 1e-5).count();
    let worst = largest[largest.len() - 1];
    println!(
        "{name}: mean {mean:.1e}, median {:.1e}, worst {worst:.1e}, {close} of {} within 1e-5",
        largest[largest.len() / 2],
        largest.len()
    );
    assert!(mean <= mean_limit, "{name}: mean difference {mean}");
    assert!(close * 10 >= largest.len() * 9, "{name}: {largest:?}");
    // Rounding to f32 may move a ray across a depth edge, which changes a sample by at most the largest radiance, 1.
    // The limit allows two such changes in a pixel, for an order that takes half of the samples.
    let flip = 1.0 / f64::from(case.spp / 2);
    assert!(worst <= 2.0 * flip, "{name}: worst {worst}");
}

fn case(front: Relief, back: Relief) -> Case {
    let mut case =
        Case::new(rough([13, 11], [29, 17], front, 1), rough([12, 10], [7, 23], back, 2));
    case.film = [13, 10];
    case.focus_m = 1.7;
    case.spp = 64;
    case
}

#[test]
fn steps_match_with_apex_mirror() {
    compare("steps, mirror", &case(Relief::Steps, Relief::Steps));
}

#[test]
fn noise_matches_with_apex_camera() {
    let mut case = case(Relief::Noise, Relief::Noise);
    case.apex = Apex::Camera;
    compare("noise, camera", &case);
}

#[test]
fn smooth_surfaces_match_with_the_gaussian_filter() {
    let mut case = case(Relief::Smooth, Relief::Smooth);
    case.spp = 256;
    case.gaussian = true;
    compare("smooth, mirror, Gaussian, 256", &case);
}

#[test]
fn tilted_absorbing_panes_match_with_apex_mirror() {
    let mut case = case(Relief::Steps, Relief::Noise);
    case.tilt_deg = [30.0, -30.0];
    case.absorption_per_m = [0.0, 5.0, 40.0];
    case.thickness_m = 0.04;
    case.tolerance = 1e-7;
    compare("steps and noise, mirror, tilt 30 -30, absorbing", &case);
}

#[test]
fn tilted_panes_match_with_apex_camera() {
    let mut case = case(Relief::Steps, Relief::Steps);
    case.apex = Apex::Camera;
    case.tilt_deg = [-12.0, 20.0];
    case.gaussian = true;
    compare("steps, camera, tilt -12 20, Gaussian", &case);
}

#[test]
fn smooth_surfaces_match_with_a_tilted_pane_and_apex_camera() {
    let mut case = case(Relief::Smooth, Relief::Smooth);
    case.apex = Apex::Camera;
    case.tilt_deg = [25.0, 10.0];
    case.focus_m = f64::INFINITY;
    case.absorption_per_m = [3.0; 3];
    compare("smooth, camera, tilt 25 10, focus at infinity", &case);
}

#[test]
fn thick_glass_matches_with_a_wide_lens_and_near_focus() {
    let mut case = case(Relief::Noise, Relief::Steps);
    case.aperture_m = 0.04;
    case.focus_m = 0.9;
    case.thickness_m = 0.1;
    case.focal_length_mm = 24.0;
    compare("noise and steps, 24 mm, thick glass, wide lens", &case);
}

#[test]
fn double_panes_match_with_both_apexes() {
    let mut case = case(Relief::Steps, Relief::Noise);
    case.stack = Some(double_pane());
    case.focal_length_mm = 35.0;
    compare("steps and noise, mirror, double pane", &case);
    case.tilt_deg = [-12.0, 20.0];
    case.apex = Apex::Camera;
    case.stack = Some(coated_double_pane());
    compare("steps and noise, camera, tilt -12 20, coated double pane", &case);
}

/// Edges of a pane that ends inside the picture, with a frame.
fn edges() -> Edges {
    Edges {
        x_m: [-0.06, 0.05],
        y_m: [-0.045, 0.07],
        frame_m: 0.02,
        frame_radiance: [0.3, 0.2, 0.1],
    }
}

/// A pane that ends inside the picture, with frame and cards on both sides, alone and with other features.
#[test]
fn covered_panes_match_with_both_apexes() {
    let mut case = case(Relief::Steps, Relief::Noise);
    let front = [noisy_card(1.6, [0.2, 0.1], 0.9, 3), noisy_card(0.6, [-0.05, 0.0], 0.25, 4)];
    let back = [noisy_card(1.1, [-0.3, 0.0], 1.2, 5), noisy_card(0.2, [0.1, 0.05], 0.3, 6)];
    case.covered.edges = Some(edges());
    compare("steps and noise, mirror, frame", &case);
    case.covered.cards = [front.to_vec(), back.to_vec()];
    compare("steps and noise, mirror, frame and cards", &case);
    case.tilt_deg = [-12.0, 20.0];
    case.absorption_per_m = [3.0, 1.0, 8.0];
    compare("steps and noise, mirror, frame and cards, tilt -12 20, absorbing", &case);
    case.apex = Apex::Camera;
    case.gaussian = true;
    case.stack = Some(coated_double_pane());
    compare("steps and noise, camera, frame and cards, coated double pane, Gaussian", &case);
    case.covered.edges = None;
    (case.tilt_deg, case.stack) = ([0.0; 2], None);
    compare("steps and noise, camera, cards", &case);
}

/// Bent panes of both signs, alone and with frame and cards.
#[test]
fn bent_panes_match_with_both_apexes() {
    let mut case = case(Relief::Steps, Relief::Noise);
    (case.tolerance, case.absorption_per_m) = (1e-7, [3.0, 1.0, 8.0]);
    for (radius_m, tilt_deg, apex, gaussian) in [
        (8.0, [0.0, 0.0], Apex::Mirror, false),
        (-3.0, [0.0, 0.0], Apex::Camera, true),
        (-8.0, [-12.0, 20.0], Apex::Mirror, true),
        (1.5, [10.0, -25.0], Apex::Camera, false),
    ] {
        case.bow_radius_m = Some(radius_m);
        (case.tilt_deg, case.apex, case.gaussian) = (tilt_deg, apex, gaussian);
        compare(&format!("steps and noise, radius {radius_m} m, {apex:?}"), &case);
    }
    case.covered.edges = Some(edges());
    let card = noisy_card(0.7, [0.1, 0.0], 0.4, 3);
    case.covered.cards = [vec![card.clone()], vec![card]];
    compare("steps and noise, radius 1.5 m, camera, frame and cards", &case);
}

/// Rough faces, alone and with every other feature of a pane.
#[test]
fn rough_panes_match_with_every_other_feature() {
    let mut case = case(Relief::Steps, Relief::Noise);
    case.roughness = Some(vec![0.02; 2]);
    compare("steps and noise, alpha 0.02", &case);
    (case.tilt_deg, case.gaussian) = ([0.0, 40.0], true);
    case.roughness = Some(vec![0.1, 0.03]);
    compare("steps and noise, alpha 0.1 and 0.03, tilt 40, Gaussian", &case);
    (case.tilt_deg, case.apex) = ([-12.0, 20.0], Apex::Camera);
    case.absorption_per_m = [3.0, 1.0, 8.0];
    compare("steps and noise, camera, alpha 0.1 and 0.03, tilt -12 20, absorbing", &case);
    case.bow_radius_m = Some(-3.0);
    let name = "steps and noise, camera, alpha 0.1 and 0.03, radius -3 m, tilt, absorbing";
    // One weak ray crosses a depth edge.
    compare_within(name, &case, 1e-5);
    (case.bow_radius_m, case.tilt_deg) = (Some(6.0), [0.0; 2]);
    let card = noisy_card(0.7, [0.1, 0.0], 0.4, 3);
    case.covered.edges = Some(edges());
    case.covered.cards = [vec![card.clone()], vec![card]];
    compare("steps and noise, camera, alpha 0.1 and 0.03, radius 6 m, frame and cards", &case);
    (case.bow_radius_m, case.apex) = (None, Apex::Mirror);
    case.stack = Some(coated_double_pane());
    case.roughness = Some(vec![0.01, 0.0, 0.0, 0.04]);
    compare("steps and noise, rough coated double pane, frame and cards", &case);
    case.tolerance = 1e-7;
    compare("steps and noise, rough coated double pane, many paths", &case);
}

/// Panes with waves, against rays that are followed from face to face over the height field.
#[test]
fn waved_panes_match_with_every_other_feature() {
    let mut case = case(Relief::Steps, Relief::Noise);
    case.tolerance = 1e-6;
    case.wave = Some([1e-4, 0.3, 0.0]);
    compare("steps and noise, waves of 0.1 mm over 0.3 m", &case);
    (case.tilt_deg, case.gaussian) = ([0.0, 40.0], true);
    case.absorption_per_m = [3.0, 1.0, 8.0];
    case.wave = Some([2e-4, 0.05, 35.0]);
    compare("steps and noise, waves of 0.2 mm over 0.05 m, tilt 40, Gaussian, absorbing", &case);
    (case.tilt_deg, case.apex) = ([-12.0, 20.0], Apex::Camera);
    case.stack = Some(coated_double_pane());
    compare("steps and noise, camera, waves, coated double pane", &case);
    case.roughness = Some(vec![0.01, 0.0, 0.02, 0.0]);
    let card = noisy_card(0.7, [0.1, 0.0], 0.4, 3);
    case.covered.edges = Some(edges());
    case.covered.cards = [vec![card.clone()], vec![card]];
    compare("steps and noise, camera, waves, rough coated double pane, frame and cards", &case);
}

/// Panes that are not parallel, against rays that are followed from face to face.
#[test]
fn wedged_panes_match_with_every_other_feature() {
    let mut case = case(Relief::Steps, Relief::Noise);
    case.tolerance = 1e-6;
    case.turned_deg = vec![[0.0; 2], [0.3, -0.5]];
    compare("steps and noise, wedge of 0.3, -0.5", &case);
    (case.tilt_deg, case.gaussian) = ([-12.0, 20.0], true);
    case.stack = Some(coated_double_pane());
    case.turned_deg = vec![[0.0; 2], [0.0; 2], [0.2, 1.0], [0.2, 1.0]];
    compare("steps and noise, coated double pane of two directions, tilt, Gaussian", &case);
    case.apex = Apex::Camera;
    case.wave = Some([1e-4, 0.1, 70.0]);
    compare("steps and noise, camera, the same with waves", &case);
    case.roughness = Some(vec![0.01, 0.0, 0.02, 0.0]);
    let card = noisy_card(0.7, [0.1, 0.0], 0.4, 3);
    case.covered.cards = [vec![card.clone()], vec![card]];
    compare("steps and noise, camera, the same with waves, roughness and cards", &case);
}

#[test]
fn weak_orders_match_over_several_blocks() {
    let mut case = case(Relief::Smooth, Relief::Steps);
    case.spp = 512;
    case.film = [4, 7];
    compare("smooth and steps, 512 samples", &case);
}

/// Checks quantiles of the differences between f32 and f64 pixels of rough, smooth, tilted and Gaussian cases.
#[test]
fn quantiles_of_pixel_errors_are_small() {
    let mut all = vec![];
    for (front, back, apex, tilt_deg, gaussian) in [
        (Relief::Steps, Relief::Noise, Apex::Mirror, [0.0, 0.0], false),
        (Relief::Noise, Relief::Steps, Apex::Camera, [0.0, 0.0], true),
        (Relief::Smooth, Relief::Smooth, Apex::Mirror, [20.0, -25.0], true),
        (Relief::Steps, Relief::Smooth, Apex::Camera, [-9.0, 14.0], false),
    ] {
        let mut case = case(front, back);
        (case.apex, case.tilt_deg, case.gaussian) = (apex, tilt_deg, gaussian);
        case.film = [30, 20];
        all.extend(differences(&case, 1).1);
    }
    all.sort_by(f64::total_cmp);
    let at = |share: f64| all[((all.len() - 1) as f64 * share) as usize];
    let [median, p99, p999, most] = [0.5, 0.99, 0.999, 1.0].map(at);
    println!(
        "{} values: median {median:.1e}, 99 % {p99:.1e}, 99.9 % {p999:.1e}, most {most:.1e}",
        all.len()
    );
    assert!(median <= 1e-7 && p99 <= 1e-6 && p999 <= 1e-4);
    // Two samples of an order that takes half of the samples may be on the other side of an edge.
    assert!(most <= 2.0 / 32.0);
}
