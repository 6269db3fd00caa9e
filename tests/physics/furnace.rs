//! Furnace tests (pixels of white photographs depend only on the weights of the glass), and a test of `I - R~`.

use crate::case::{CLEAN, Case, GLASS, I, T, bumpy};
use glam::DVec3;

#[test]
fn white_stays_white() {
    let mut case = Case::new(bumpy(1, true), bumpy(2, true));
    case.film = [9, 6];
    for (tilt, gaussian) in [([0.0, 0.0], false), ([20.0, -35.0], true)] {
        (case.tilt_deg, case.gaussian) = (tilt, gaussian);
        let mut worst = 0f64;
        for pixel in case.render() {
            assert_eq!(pixel.mean[T], [1.0; 3]);
            assert_eq!(pixel.mean[CLEAN], [1.0; 3]);
            for v in pixel.mean[I] {
                worst = worst.max((f64::from(v) - 1.0).abs());
            }
        }
        println!("tilt {tilt:?}: |I - 1| <= {worst:.1e}");
        // Thinned orders take their weights at fewer points of a pixel.
        assert!(worst <= 1e-4);
    }
}

/// I and R~ equal the closed-form totals averaged over the pixel: the light of dropped orders is in the last ones.
#[test]
fn absorbing_glass_passes_its_closed_totals() {
    let mut case = Case::new(bumpy(1, true), bumpy(2, true));
    case.film = [7, 5];
    case.absorption_per_m = [0.0, 5.0, 50.0];
    case.tilt_deg = [10.0, 25.0];
    case.aperture_m = 0.0;
    case.spp = 1024;
    let scene = case.scene();
    let slab = &scene.slab;
    let [tx, ty] = case.tan_half_fov();
    let (mut worst_input, mut worst_glass) = (0f64, 0f64);
    for (q, pixel) in case.render().iter().enumerate() {
        let (x, y) = (q as u32 % case.film[0], q as u32 / case.film[0]);
        const STEPS: u32 = 32;
        let mut expected = [[0.0; 3]; 2];
        for a in 0..STEPS {
            for b in 0..STEPS {
                let at = |k: u32, sub: u32, n: u32| {
                    2.0 * (f64::from(k) + (f64::from(sub) + 0.5) / f64::from(STEPS)) / f64::from(n)
                        - 1.0
                };
                let d = DVec3::new(at(x, a, case.film[0]) * tx, at(y, b, case.film[1]) * ty, 1.0);
                let cos_i = d.normalize().dot(slab.normal);
                let (t, r) = (slab.total_transmittance(cos_i), slab.total_reflectance(cos_i));
                for c in 0..3 {
                    expected[0][c] += (t[c] + r[c]) / f64::from(STEPS * STEPS);
                    expected[1][c] += r[c] / f64::from(STEPS * STEPS);
                }
            }
        }
        assert_eq!(pixel.mean[T], [1.0; 3]);
        for c in 0..3 {
            worst_input = worst_input.max((f64::from(pixel.mean[I][c]) - expected[0][c]).abs());
            worst_glass = worst_glass.max((f64::from(pixel.mean[GLASS][c]) - expected[1][c]).abs());
        }
    }
    println!("I {worst_input:.1e}, R~ {worst_glass:.1e}");
    assert!(worst_input <= 1e-5 && worst_glass <= 1e-5);
}

/// With a black back side, the input equals `input - glass_reflection` of the full scene: the front through the glass.
#[test]
fn input_minus_reflection_is_the_front_through_the_glass() {
    let mut case = Case::new(bumpy(3, false), bumpy(4, false));
    case.film = [11, 8];
    case.tilt_deg = [5.0, -15.0];
    let dark = with_dark_back(&case);
    let (scene, dark_scene) = (case.scene(), dark.scene());
    assert_eq!(scene.orders.front, dark_scene.orders.front);
    assert_only_the_reflection_differs(&case);
}

/// Returns the case with a black photograph and no cards in the back.
fn with_dark_back(case: &Case) -> Case {
    let mut dark = case.clone();
    dark.back.texels.fill([0.0; 4]);
    dark.covered.cards[1].clear();
    dark
}

/// Asserts that I less R~ is I of the same scene with a dark back, and that T is equal.
pub(crate) fn assert_only_the_reflection_differs(case: &Case) {
    let mut worst_ulp = 0.0f32;
    for (pixel, alone) in case.render().iter().zip(with_dark_back(case).render()) {
        assert_eq!(alone.mean[GLASS], [0.0; 3]);
        assert_eq!(pixel.mean[T], alone.mean[T]);
        for c in 0..3 {
            let input = pixel.mean[I][c];
            let difference = input - pixel.mean[GLASS][c] - alone.mean[I][c];
            worst_ulp = worst_ulp.max(difference.abs() / (input.next_up() - input));
        }
    }
    println!("input - glass_reflection: within {worst_ulp} ulp of I");
    // Rounding changes each of the three numbers by at most half an ulp of I.
    assert!(worst_ulp <= 1.0);
}
