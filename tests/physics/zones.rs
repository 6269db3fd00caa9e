//! Zones: an order takes fewer samples where it can see no lamp, with the same result.

use crate::case::{Apex, Case, GLASS, Photo, noise, whole_film};
use crate::invariance::{bits, tiled};
use crate::pixels::differences;
use crate::stack::coated_double_pane;
use render::trace::{Isa, Scene, ZONE_PX};

/// Radiance of the lamp of a photograph.
const LAMP: f64 = 40.0;

fn with_lamp(key: u64, rest: f64) -> Photo {
    let depth = move |i: usize, j: usize| 0.9 + 2.0 * noise(i / 2, j / 2, key);
    Photo::new([40, 30], [64, 48], [0.4; 2], depth, move |i, j| {
        let is_lamp = (24..28).contains(&i) && (19..23).contains(&j);
        [0, 1, 2].map(|c| if is_lamp { LAMP } else { rest * noise(i, j, key + c) })
    })
}

/// Returns panes in front of a lamp and behind another.
fn cases(rest: f64) -> Vec<Case> {
    let mut case = Case::new(with_lamp(1, rest), with_lamp(2, rest));
    (case.film, case.spp) = ([140, 100], 16);
    let mut tilted = case.clone();
    (tilted.tilt_deg, tilted.apex, tilted.gaussian) = ([2.0, -3.0], Apex::Camera, true);
    let mut coated = tilted.clone();
    coated.stack = Some(coated_double_pane());
    let mut waved = case.clone();
    waved.wave = Some([1e-4, 0.1, 70.0]);
    let mut rough = case.clone();
    rough.roughness = Some(vec![0.002; 2]);
    vec![case, tilted, coated, waved, rough]
}

/// True if an order of the back is dimmer in some zones than in others.
fn has_zones(scene: &Scene) -> bool {
    let zones = |length_px: u32| (0..length_px).step_by(ZONE_PX as usize);
    let all = zones(scene.film.height).flat_map(|y| zones(scene.film.width).map(move |x| (x, y)));
    let first = scene.orders.front.len();
    let differs = |order: usize| {
        let mut of_zones = all.clone().map(|at| scene.zones.dimness(at, first + order));
        let one = of_zones.next();
        of_zones.any(|other| Some(other) != one)
    };
    (0..scene.orders.back.len()).any(differs)
}

#[test]
fn pixels_match_in_zones_of_any_light() {
    for (number, case) in cases(1.0).iter().enumerate() {
        assert!(has_zones(&case.scene()), "case {number}");
        let (largest, all) = differences(case, 12);
        let mean = all.iter().sum::<f64>() / all.len() as f64;
        let close = largest.iter().filter(|d| **d <= 1e-5 * LAMP).count();
        println!("case {number}: mean {mean:.1e}, {close} of {} close", largest.len());
        assert!(mean <= 1e-6 * LAMP && close * 20 >= largest.len() * 19, "case {number}: {mean}");
    }
}

#[test]
fn zones_do_not_depend_on_tiles() {
    for case in cases(1.0) {
        let scene = case.scene();
        let whole = bits(&whole_film(&scene, Isa::Baseline).pixels);
        for side in [7, 48, 16_384] {
            assert!(whole == bits(&tiled(&scene, side, Isa::detect())), "tiles of {side}");
        }
    }
}

/// Without other light, the first reflection is black in zones that cannot see the lamp, and is not in some of the others.
#[test]
fn dim_zones_do_not_see_the_lamp() {
    for (number, case) in cases(0.0).into_iter().enumerate() {
        if case.roughness.is_some() {
            continue;
        }
        let mut scene = case.scene();
        scene.first_reflection_alone = true;
        let pixels = whole_film(&scene, Isa::detect()).pixels;
        let (mut dark, mut lit) = (0, 0);
        for (q, pixel) in (0..).zip(&pixels) {
            let at = (q % scene.film.width, q / scene.film.width);
            let is_dark = scene.zones.dimness(at, scene.orders.front.len()) > 0;
            let light = pixel.mean[GLASS][0];
            assert!(!is_dark || light == 0.0, "case {number}, {at:?}: {light}");
            dark += usize::from(is_dark);
            lit += usize::from(light > 0.0);
        }
        println!("case {number}: {dark} px are dark, {lit} lit");
        assert!(dark > pixels.len() / 4 && lit > 0, "case {number}: {dark} dark, {lit} lit");
    }
}
