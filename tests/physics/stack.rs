//! Scenes behind stacks: no light is missing, T and R do not change, and a single layer is the plain pane.

use crate::case::{CLEAN, Case, GLASS, I, T, bumpy};
use crate::furnace::assert_only_the_reflection_differs;
use glasshouse_line::curve::Curve;
use render::trace::{Coating, Stack, StackLayer};

fn glass(thickness_m: f64, absorption_per_m: [f64; 3]) -> StackLayer {
    StackLayer { thickness_m, ior: 1.52, absorption_per_m }
}

fn gap(thickness_m: f64) -> StackLayer {
    StackLayer { thickness_m, ior: 1.0, absorption_per_m: [0.0; 3] }
}

/// Two panes of 4 mm with a gap of 16 mm.
pub(crate) fn double_pane() -> Stack {
    let pane = glass(0.004, [0.0; 3]);
    Stack::new(vec![pane, gap(0.016), pane], vec![None; 4])
}

/// Unequal, absorbing panes, one with a coating of colour, the other with one whose shares depend on the angle and the side.
pub(crate) fn coated_double_pane() -> Stack {
    let colour = Coating::constant([0.12, 0.06, 0.16], [0.80, 0.86, 0.78]);
    let curve = |values: [f64; 4]| {
        let rows = values.map(|v| [v, 0.8 * v, 0.9 * v]);
        Curve::through(vec![0.0, 0.3, 0.7, 1.0], rows.to_vec())
    };
    let low_e = Coating {
        reflectance: curve([1.0, 0.35, 0.12, 0.1]),
        reflectance_back: curve([0.9, 0.2, 0.08, 0.05]),
        transmittance: curve([0.0, 0.6, 0.85, 0.86]),
    };
    Stack::new(
        vec![glass(0.004, [6.0, 2.0, 4.0]), gap(0.012), glass(0.006, [3.0, 1.0, 5.0])],
        vec![None, Some(colour), Some(low_e), None],
    )
}

/// Between white photographs, a pane without losses is white: the light of dropped orders is not missing.
#[test]
fn a_double_pane_loses_no_light() {
    let mut case = Case::new(bumpy(1, true), bumpy(2, true));
    case.film = [9, 6];
    case.stack = Some(double_pane());
    // With all samples of all orders, and with thinned orders, over whose samples the weights of these large pixels vary.
    for (tolerance, limit) in [(0.0, 1e-5), (7.6e-5, 4e-4)] {
        case.tolerance = tolerance;
        for (tilt_deg, gaussian) in
            [([0.0, 0.0], false), ([20.0, -35.0], true), ([0.0, 62.0], false)]
        {
            (case.tilt_deg, case.gaussian) = (tilt_deg, gaussian);
            let mut worst = 0f64;
            for pixel in case.render() {
                assert_eq!(pixel.mean[T], [1.0; 3]);
                assert_eq!(pixel.mean[CLEAN], [1.0; 3]);
                for v in pixel.mean[I] {
                    worst = worst.max((f64::from(v) - 1.0).abs());
                }
            }
            println!("tolerance {tolerance}, tilt {tilt_deg:?}: |I - 1| <= {worst:.1e}");
            assert!(worst <= limit);
        }
    }
}

/// I less R~ is the front through the glass, whatever the back is.
#[test]
fn input_minus_reflection_is_the_front_behind_a_stack() {
    let mut case = Case::new(bumpy(3, false), bumpy(4, false));
    (case.film, case.tilt_deg) = ([11, 8], [5.0, -15.0]);
    case.stack = Some(coated_double_pane());
    assert_only_the_reflection_differs(&case);
}

/// A stack of one layer is the plain pane, within the errors of the tables and of the dropped orders, and so is a pane with gaps of
/// 0 m, or with a coating that has Fresnel's shares.
#[test]
fn stacks_of_one_layer_are_the_plain_pane() {
    let mut plain = Case::new(bumpy(5, false), bumpy(6, false));
    (plain.film, plain.tolerance) = ([11, 8], 1e-7);
    (plain.ior, plain.thickness_m, plain.absorption_per_m) = (1.52, 0.008, [6.0, 2.0, 4.0]);
    let layer = glass(0.008, plain.absorption_per_m);
    // At normal incidence and through a pinhole, Fresnel's shares are almost constant.
    let r = (0.52f64 / 2.52).powi(2);
    let fresnel = Coating::constant([r; 3], [1.0 - r; 3]);
    let same = [
        (Stack::new(vec![layer], vec![None; 2]), 0.0),
        (Stack::new(vec![gap(0.0), layer, gap(0.0)], vec![None; 4]), 0.0),
        (Stack::new(vec![layer], vec![Some(fresnel), None]), 1e-3),
    ];
    for tilt_deg in [[0.0, 0.0], [0.0, 40.0]] {
        plain.tilt_deg = tilt_deg;
        let expected = plain.render();
        for (stack, more) in &same {
            if *more > 0.0 && tilt_deg != [0.0, 0.0] {
                continue;
            }
            let mut case = plain.clone();
            case.stack = Some(stack.clone());
            let mut worst = 0f32;
            for (pixel, expected) in case.render().iter().zip(&expected) {
                for layer in [I, T, GLASS, CLEAN] {
                    for c in 0..3 {
                        worst = worst.max((pixel.mean[layer][c] - expected.mean[layer][c]).abs());
                    }
                }
            }
            println!("tilt {tilt_deg:?}: within {worst:.1e}");
            assert!(f64::from(worst) <= 1e-5 + more, "{worst}");
        }
    }
}

/// Behind a mirror that lets no light through, T is the front as before, and I is R~: smooth, rough and with waves.
#[test]
fn an_opaque_pane_is_a_picture() {
    let mut case = Case::new(bumpy(1, true), bumpy(2, true));
    (case.film, case.tilt_deg) = ([9, 6], [5.0, -20.0]);
    let mirror = Coating::constant([0.9; 3], [0.0; 3]);
    let pane = glass(0.004, [0.0; 3]);
    for (coatings, layers) in [
        (vec![None, Some(mirror.clone())], vec![pane]),
        (vec![Some(mirror.clone()), None], vec![pane]),
        (vec![None, None], vec![glass(0.004, [1e9; 3])]),
        (vec![None, None, Some(mirror), None], vec![pane, gap(0.016), pane]),
    ] {
        for (alpha, wave) in [(None, None), (Some(0.01), None), (None, Some([1e-4, 0.2, 30.0]))] {
            case.roughness = alpha.map(|alpha| vec![alpha; coatings.len()]);
            case.wave = wave;
            case.stack = Some(Stack::new(layers.clone(), coatings.clone()));
            for pixel in case.render() {
                assert_eq!(pixel.mean[T], [1.0; 3]);
                assert_eq!(pixel.mean[I], pixel.mean[GLASS]);
                assert!(pixel.mean[I].iter().all(|v| (0.01..1.5).contains(v)), "{pixel:?}");
            }
        }
    }
}
