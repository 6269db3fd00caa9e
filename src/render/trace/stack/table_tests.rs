//! Checks the selection and the tables of a stack's orders against the closed form.

use super::super::{Coating, StackLayer};
use super::*;

const CLEAR: [f64; 3] = [0.0; 3];

fn pane(thickness_m: f64) -> StackLayer {
    StackLayer { thickness_m, ior: 1.52, absorption_per_m: CLEAR }
}

fn gap(thickness_m: f64) -> StackLayer {
    StackLayer { thickness_m, ior: 1.0, absorption_per_m: CLEAR }
}

fn double() -> Stack {
    Stack::new(vec![pane(0.004), gap(0.016), pane(0.004)], vec![None; 4])
}

fn coated() -> Stack {
    let low_e = Coating::constant([0.12, 0.06, 0.16], [0.80, 0.86, 0.78]);
    let layers = vec![
        StackLayer { absorption_per_m: [6.0, 2.0, 4.0], ..pane(0.004) },
        gap(0.012),
        StackLayer { ior: 1.5, ..pane(0.006) },
    ];
    Stack::new(layers, vec![None, Some(low_e), None, None])
}

/// Shifts and weights from the tables equal the closed form, in f32, over any range of angles up to 85 degrees; the light of all
/// orders is the total.
#[test]
fn tables_equal_the_closed_form() {
    for stack in [double(), coated()] {
        for [from_deg, to_deg] in [[0.0f64, 25.0], [10.0, 60.0], [40.0, 85.0], [30.0, 30.0]] {
            let between = [to_deg, from_deg].map(|deg| deg.to_radians().cos());
            let (optics, plan) = StackOptics::new(&stack, between, [1.0, 1.0], 7.6e-5);
            let mut camera = CameraChunk::new();
            for step in 0..40 {
                let share = f64::from(step) / 39.0;
                let cos_i = between[0] + share * (between[1] - between[0]);
                (camera.cell[0], camera.within[0]) = optics.locate(&[cos_i as f32; LANES]);
                let exact = stack.weights(&[cos_i], 1e-12, MOST_PASSAGES);
                let totals = stack.totals(cos_i);
                for (side, followed) in [&plan.front, &plan.back].into_iter().enumerate() {
                    let mut sum = [0.0; 3];
                    for (index, table) in optics.tables[side].iter().enumerate() {
                        let shift = f64::from(table.shifts(&camera, 0)[3]);
                        assert!((shift - table.shift_m(cos_i)).abs() < 3e-8);
                        let exit = [Exit::Transmitted, Exit::Reflected][side];
                        let (_, weight) = exact
                            .iter()
                            .find(|(order, _)| {
                                order.exit == exit && stack.crossed(order) == table.crossed
                            })
                            .unwrap();
                        let found = table.colours(&camera, 0, 3).map(f64::from);
                        assert_eq!(f64::from(table.weights(&camera, 0)[3]), found[0]);
                        for c in 0..3 {
                            sum[c] += found[c];
                            // The last order has the light of the dropped ones, too.
                            if index + 1 < followed.len() {
                                assert!((found[c] - weight[0][c]).abs() < 1e-6);
                            }
                        }
                    }
                    for c in 0..3 {
                        assert!((sum[c] - totals[1 - side][c]).abs() < 2e-6);
                    }
                }
            }
        }
    }
}

/// The first orders are t_0 and r_0, and the others follow by length. What is dropped stays below the tolerance in sum.
#[test]
fn orders_are_kept_by_the_tolerance_of_their_sum() {
    let stack = double();
    let (_, plan) = StackOptics::new(&stack, [0.9, 1.0], [1.0, 1.0], 7.6e-5);
    assert_eq!(plan.front[0].order, Order::Transmitted(0));
    assert_eq!(plan.back[0].order, Order::Reflected(0));
    // One image for each face, and some of three reflections.
    assert!(plan.back.len() > 4 && plan.front.len() > 1);
    assert!(plan.front_tail < 7.6e-5 && plan.back_tail < 7.6e-5);
    // A tolerance of half the light of all orders of two reflections drops them.
    let (optics, plan) = StackOptics::new(&stack, [0.9, 1.0], [1.0, 1.0], 0.02);
    assert_eq!((plan.front.len(), plan.back.len()), (1, 4));
    assert!(plan.front_tail > 1e-3 && plan.front_tail < 0.02);
    let shifts: Vec<f64> = optics.tables[1].iter().map(|table| table.shift_m(1.0)).collect();
    assert!(shifts.is_sorted_by(|a, b| a > b) && shifts[0] == 0.0, "{shifts:?}");
    // Without light, nothing but t_0 is followed.
    let (_, plan) = StackOptics::new(&stack, [0.9, 1.0], [0.0, 0.0], 7.6e-5);
    assert_eq!((plan.front.len(), plan.back.len()), (1, 0));
}
