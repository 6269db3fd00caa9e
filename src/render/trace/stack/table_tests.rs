//! Checks the selection and the tables of a stack's orders against the closed form.

use super::super::select::{MOST_PASSAGES, MOST_STATES};
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
                        let same = |order: &StackOrder| {
                            order.exit == exit && stack.crossed(order) == table.crossed
                        };
                        // A faint order may have no light at this angle.
                        let weight = exact.iter().find(|(order, _)| same(order));
                        let weight = weight.map_or([0.0; 3], |(_, weight)| weight[0]);
                        let found = table.colours(&camera, 0, 3).map(f64::from);
                        assert_eq!(f64::from(table.weights(&camera, 0)[3]), found[0]);
                        for c in 0..3 {
                            sum[c] += found[c];
                            // The last order has the light of the dropped ones, too.
                            if index + 1 < followed.len() {
                                assert!((found[c] - weight[c]).abs() < 1e-6);
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
    assert!(plan.dropped[0] < 7.6e-5 && plan.dropped[1] < 7.6e-5);
    // A tolerance of half the light of all orders of two reflections drops them.
    let (optics, plan) = StackOptics::new(&stack, [0.9, 1.0], [1.0, 1.0], 0.02);
    assert_eq!((plan.front.len(), plan.back.len()), (1, 4));
    assert!(plan.dropped[0] > 1e-3 && plan.dropped[0] < 0.02);
    let shifts: Vec<f64> = optics.tables[1].iter().map(|table| table.shift_m(1.0)).collect();
    assert!(shifts.is_sorted_by(|a, b| a > b) && shifts[0] == 0.0, "{shifts:?}");
    // Without light, nothing but t_0 is followed.
    let (_, plan) = StackOptics::new(&stack, [0.9, 1.0], [0.0, 0.0], 7.6e-5);
    assert_eq!((plan.front.len(), plan.back.len()), (1, 0));
}

/// A pane that lets no light through keeps t_0, which T needs, and has finite tables with the closed form's light.
#[test]
fn opaque_panes_keep_the_straight_order() {
    let mirror = Coating::constant([0.9; 3], CLEAR);
    let dark = |layer: StackLayer| StackLayer { absorption_per_m: [1e9; 3], ..layer };
    let layers = vec![pane(0.004), gap(0.016), pane(0.004)];
    let mut stacks = vec![
        Stack::new(vec![dark(pane(0.004))], vec![None; 2]),
        Stack::new(vec![dark(pane(0.004)), gap(0.01), pane(0.003)], vec![None; 4]),
        Stack::new(layers.clone(), vec![Some(mirror.clone()); 4]),
        // Weaker than a state that the search follows, but not dark.
        Stack::new(vec![pane(0.004)], vec![Some(Coating::constant([0.5; 3], [1e-5; 3])); 2]),
    ];
    for face in 0..4 {
        let coatings = |count: usize| {
            (0..count).map(|i| (i == face).then(|| mirror.clone())).collect::<Vec<_>>()
        };
        stacks.push(Stack::new(layers.clone(), coatings(4)));
        stacks.push(Stack::new(vec![pane(0.004)], coatings(2)));
    }
    for stack in &stacks {
        for tolerance in [0.0, 7.6e-5] {
            let (optics, plan) = StackOptics::new(stack, [0.5, 1.0], [1.0; 2], tolerance);
            assert_eq!(plan.front[0].order, Order::Transmitted(0));
            assert_eq!(optics.orders(0)[0], &stack.straight());
            assert_eq!(plan.front.len(), optics.tables[0].len());
            assert_energy(stack, &optics, 0.7);
        }
    }
}

/// Asserts that the tables of each side share the light of all its orders.
fn assert_energy(stack: &Stack, optics: &StackOptics, cos_i: f64) {
    let mut camera = CameraChunk::new();
    (camera.cell[0], camera.within[0]) = optics.locate(&[cos_i as f32; LANES]);
    let totals = stack.totals(cos_i);
    for (side, tables) in optics.tables.iter().enumerate() {
        let mut sum = [0.0; 3];
        for table in tables {
            let colours = table.colours(&camera, 0, 0);
            assert!(colours.iter().all(|v| v.is_finite()), "{colours:?}");
            (0..3).for_each(|c| sum[c] += f64::from(colours[c]));
        }
        for c in 0..3 {
            let total = totals[1 - side][c];
            assert!((sum[c] - total).abs() < 1e-5, "{side}: {sum:?} {total} {stack:?}");
        }
    }
}

/// Returns `count` layers of any kind, with or without coatings. `seed` selects them.
fn any_stack(count: usize, seed: u64) -> Stack {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let mut random = || {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let mut layers = vec![];
    for _ in 0..count {
        let absorption_per_m =
            [0, 1, 2].map(|_| if seed.is_multiple_of(2) { 0.0 } else { 20.0 * random() });
        layers.push(match random() {
            x if x < 0.3 => gap(0.001 + random()),
            _ => StackLayer {
                thickness_m: 0.01 * random(),
                ior: 1.0 + 9.0 * random() * random(),
                absorption_per_m,
            },
        });
    }
    let coatings = (0..=count).map(|_| {
        let reflectance = random();
        (random() < 0.2)
            .then(|| Coating::constant([reflectance; 3], [0.95 * (1.0 - reflectance); 3]))
    });
    let coatings = coatings.collect();
    Stack::new(layers, coatings)
}

/// Random stacks of up to 16 layers are set up with a bounded number of states, and no light is missing.
#[test]
fn searches_of_any_stack_are_bounded() {
    let mut bounded = 0;
    for seed in 0..10 {
        let count = 12 + seed as usize % 5;
        let stack = any_stack(count, seed);
        let cosines: Vec<f64> = (0..=48).map(|i| 0.2 + f64::from(i) / 60.0).collect();
        let Searched { paths, was_cut, .. } = select(&stack, &cosines, [1.0, 30.0], 7.6e-5);
        assert!(paths.states() <= MOST_STATES * MOST_PASSAGES, "{} states", paths.states());
        let (optics, plan) = StackOptics::new(&stack, [0.2, 1.0], [1.0, 30.0], 7.6e-5);
        assert!(plan.search_was_bounded || !was_cut);
        bounded += u32::from(was_cut);
        assert!(!plan.front.is_empty() && !plan.back.is_empty());
        for cos_i in [0.21, 0.5, 0.83, 0.99] {
            assert_energy(&stack, &optics, cos_i);
        }
    }
    assert!(bounded > 0);
    for stack in [double(), coated()] {
        let (_, plan) = StackOptics::new(&stack, [0.1, 1.0], [50.0; 2], 7.6e-5);
        assert!(!plan.search_was_bounded);
    }
}

/// The light of recorded paths is that of the search, bit for bit, and a search without a bound has the same strongest orders.
#[test]
fn recorded_paths_carry_the_light_of_the_search() {
    let stack = coated();
    let cosines: Vec<f64> = (0..=48).map(|i| 0.2 + f64::from(i) / 60.0).collect();
    let Searched { selection, paths, .. } = select(&stack, &cosines, [1.0; 2], 7.6e-5);
    let of_orders = paths.of_orders(selection.orders());
    assert!(of_orders.states() < paths.states());
    let found = of_orders.weights(&stack, &cosines);
    let exact = stack.weights(&cosines, 7.6e-8, MOST_PASSAGES);
    assert_eq!(found.len(), selection.orders().count());
    for (order, weights) in &found {
        let exact = exact.get(order).into_iter().flatten();
        for (found, exact) in weights.iter().zip(exact) {
            assert!((0..3).all(|c| (found[c] - exact[c]).abs() < 1e-6), "{found:?} {exact:?}");
        }
    }
    // The orders and tails stay, if the paths are followed at the same cosines.
    let again = selection.at(&stack, &of_orders, &cosines);
    for side in 0..2 {
        for (a, b) in again.kept[side].iter().zip(&selection.kept[side]) {
            let pairs = a.weights.as_flattened().iter().zip(b.weights.as_flattened());
            assert!(a.order == b.order && pairs.into_iter().all(|(a, b)| (a - b).abs() < 1e-12));
        }
        assert!((again.dropped[side] - selection.dropped[side]).abs() < 1e-12);
    }
}
