//! Renders extreme depths, lights, tilts and sizes: pixels stay within limits, and rendering ends in time.

use crate::case::{Apex, CLEAN, Case, Photo, T, noise, whole_film};
use render::trace::Isa;
use std::sync::mpsc;
use std::time::Duration;

/// Renders a case; asserts that rendering takes at most ten seconds and that every value is in [0, `limit`].
fn survives(name: &str, case: &Case, limit: f32) -> Vec<render::trace::PixelMeans> {
    let (sender, receiver) = mpsc::channel();
    let moved = case.clone();
    std::thread::spawn(move || {
        // Sending fails if the receiver has timed out.
        let _ = sender.send(whole_film(&moved.scene(), Isa::detect()));
    });
    let result = receiver
        .recv_timeout(Duration::from_secs(10))
        .unwrap_or_else(|_| panic!("{name}: not done after ten seconds"));
    for pixel in &result.pixels {
        for value in pixel.values() {
            assert!(value.is_finite() && (0.0..=limit).contains(&value), "{name}: {value}");
        }
    }
    result.pixels
}

fn rough(key: u64, depth_m: impl Fn(f64) -> f64) -> Photo {
    let depth = |i: usize, j: usize| depth_m(noise(i / 2, j / 2, key));
    Photo::new([24, 18], [24, 18], [0.29; 2], depth, |i, j| [0, 1, 2].map(|c| noise(i, j, key + c)))
}

fn ordinary() -> Case {
    let mut case = Case::new(rough(1, |x| 0.8 + x), rough(2, |x| 0.8 + x));
    case.film = [16, 12];
    case.spp = 16;
    case
}

#[test]
fn depths_from_1_mm_to_100_km_render() {
    let extreme = |x: f64| {
        if x < 0.1 {
            1e-3
        } else if x < 0.5 {
            1.0
        } else {
            1e5
        }
    };
    for apex in [Apex::Mirror, Apex::Camera] {
        for tilt_deg in [[0.0, 0.0], [10.0, -20.0]] {
            for focus_m in [1e-2, 2.0, f64::INFINITY] {
                let mut case = ordinary();
                (case.front, case.back) = (rough(1, extreme), rough(2, extreme));
                case.film = [6, 4];
                (case.apex, case.tilt_deg, case.focus_m) = (apex, tilt_deg, focus_m);
                let name =
                    format!("depths 1e-3 to 1e5, {apex:?}, tilt {tilt_deg:?}, focus {focus_m}");
                survives(&name, &case, 1.001);
            }
        }
    }
}

#[test]
fn photographs_of_one_pixel_row_or_column_render() {
    for size in [[1, 1], [1, 7], [7, 1]] {
        for apex in [Apex::Mirror, Apex::Camera] {
            let photo = Photo::new(
                size,
                size,
                [0.3; 2],
                |i, j| 1.0 + 0.2 * (i + j) as f64,
                |i, j| [0.25 + 0.05 * (i + j) as f64; 3],
            );
            let mut case = ordinary();
            (case.front, case.back, case.apex) = (photo.clone(), photo, apex);
            for pixel in survives(&format!("photograph of {size:?}"), &case, 1.001) {
                if size == [1, 1] {
                    assert_eq!([pixel.mean[T], pixel.mean[CLEAN]], [[0.25; 3]; 2]);
                }
            }
        }
    }
}

#[test]
fn films_of_one_pixel_row_or_column_render() {
    for film in [[1, 1], [1, 9], [9, 1]] {
        let mut case = ordinary();
        case.film = film;
        let pixels = survives(&format!("film {film:?}"), &case, 1.001);
        assert_eq!(pixels.len() as u32, film[0] * film[1]);
    }
}

#[test]
fn a_light_with_a_radiance_of_two_million_renders() {
    let mut case = ordinary();
    for photo in [&mut case.front, &mut case.back] {
        photo.texels[200] = [1e6, 2e6, 1e6, 0.0];
    }
    let scene = case.scene();
    assert!(scene.orders.back.len() >= 5 && !scene.orders.thin_clean_reflection);
    assert!(scene.orders.back[..4].iter().all(|f| f.thinning(0) == 1));
    survives("radiance 2e6", &case, 4.1e6);
}

#[test]
fn steep_panes_render() {
    for (tilt_deg, focal_length_mm) in
        [([0.0, 80.0], 300.0), ([60.0, 0.0], 55.0), ([0.0, -60.0], 55.0), ([-40.0, 40.0], 55.0)]
    {
        let mut case = ordinary();
        (case.tilt_deg, case.focal_length_mm) = (tilt_deg, focal_length_mm);
        survives(&format!("mirror, tilt {tilt_deg:?}"), &case, 1.001);
    }
}

/// With apex `camera`, a pane at 45 degrees turns the view by 90 degrees: rays are parallel to the capture camera's
/// image plane, or point away from its photograph.
#[test]
fn panes_that_turn_the_view_away_from_the_photograph_render() {
    for tilt_deg in [[0.0, 45.0], [45.0, 0.0], [0.0, 38.0], [0.0, 60.0], [-40.0, 40.0], [0.0, 80.0]]
    {
        let mut case = ordinary();
        (case.tilt_deg, case.apex, case.film) = (tilt_deg, Apex::Camera, [7, 5]);
        if tilt_deg[1] == 80.0 {
            case.focal_length_mm = 300.0;
        }
        survives(&format!("camera, tilt {tilt_deg:?}"), &case, 1.001);
    }
}
