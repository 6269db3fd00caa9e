//! Orders whose lines lie close together are one order.

use crate::case::{Case, I, bumpy, whole_film};
use crate::pixels::compare;
use render::trace::{Coating, Isa, OrderPlan, Scene, Stack, StackLayer};

fn layer(thickness_m: f64, ior: f64) -> StackLayer {
    StackLayer { thickness_m, ior, absorption_per_m: [0.0; 3] }
}

/// A double pane with waves, over which lines of the same length lie close together.
fn case(amplitude_m: f64) -> Case {
    let mut case = Case::new(bumpy(1, false), bumpy(2, false));
    (case.film, case.spp, case.tilt_deg) = ([24, 20], 64, [4.0, 30.0]);
    let layers = vec![layer(0.004, 1.52), layer(0.012, 1.0), layer(0.004, 1.52)];
    case.stack = Some(Stack::new(layers, vec![None; 4]));
    case.wave = Some([amplitude_m, 0.3, 20.0]);
    case
}

fn count(orders: &OrderPlan) -> usize {
    orders.front.len() + orders.back.len()
}

/// Returns the scene with all samples of each order.
fn scene(case: &Case) -> Scene {
    let mut scene = case.scene();
    let OrderPlan { front, back, .. } = &mut scene.orders;
    front.iter_mut().chain(back).for_each(|followed| followed.worth = f64::INFINITY);
    scene
}

/// Returns the largest difference of two scenes' pictures.
fn worst_difference(one: &Scene, other: &Scene) -> f64 {
    let [one, other] = [one, other].map(|scene| whole_film(scene, Isa::detect()).pixels);
    let mut worst = 0.0f64;
    for (a, b) in one.iter().zip(&other) {
        (0..3).for_each(|c| worst = worst.max(f64::from((a.mean[I][c] - b.mean[I][c]).abs())));
    }
    worst
}

/// Pictures of joined orders differ by at most what the plan adds to the misplaced light, and orders that waves separate stay apart.
#[test]
fn joined_orders_move_no_more_light_than_stated() {
    let mut saved = vec![];
    for amplitude_m in [1e-8, 1e-7, 1e-6, 1e-5] {
        let mut case = case(amplitude_m);
        let joined = scene(&case);
        case.joins = false;
        let apart = scene(&case);
        // The light of cuts joins the last order, which may have another line now.
        let [all, rest] = [&joined, &apart].map(|of| of.orders.dropped.iter().sum::<f64>());
        let worst = worst_difference(&joined, &apart);
        let counts = [&joined, &apart].map(|scene| count(&scene.orders));
        println!(
            "waves of {amplitude_m} m: {counts:?} orders, worst {worst:.1e}, stated {all:.1e}, {rest:.1e}"
        );
        assert!(worst <= all + rest + 1e-6, "waves of {amplitude_m} m: {worst}");
        assert!(all - rest < 20.0 * case.tolerance);
        saved.push(counts[1] - counts[0]);
    }
    assert!(saved[0] >= 8 && saved.is_sorted_by(|a, b| a >= b), "{saved:?}");
}

/// A thin pane has so few orders that hardly any light is dropped, so its pictures show what joining them moves.
#[test]
fn orders_of_a_thin_pane_move_no_more_light_than_stated() {
    let mut case = case(1e-7);
    case.stack = Some(Stack::new(vec![layer(5e-6, 1.52)], vec![None; 2]));
    case.tolerance = 1e-4;
    let joined = scene(&case);
    case.joins = false;
    let apart = scene(&case);
    let moved: f64 = (0..2).map(|k| joined.orders.dropped[k] - apart.orders.dropped[k]).sum();
    let rest: f64 = apart.orders.dropped.iter().sum();
    let worst = worst_difference(&joined, &apart);
    let counts = [&joined, &apart].map(|scene| count(&scene.orders));
    println!("{counts:?} orders, worst {worst:.1e}, stated {moved:.1e} and {rest:.1e}");
    assert!(counts[0] < counts[1]);
    assert!(worst <= moved + 2.0 * rest + 1e-6);
}

/// The line of a joined order is the mean of its paths' lines.
#[test]
fn joined_orders_match() {
    let mut case = case(3e-7);
    (case.film, case.tolerance) = ([13, 10], 1e-4);
    let paths = |scene: &Scene| {
        let pane = scene.rough.as_ref().expect("waves");
        let of = scene.orders.back.iter().enumerate();
        of.map(|(index, followed)| pane.paths(followed.order, index).len()).max()
    };
    assert!(paths(&case.scene()) >= Some(2));
    compare("bumpy, waves of 0.3 um, double pane", &case);
    case.roughness = Some(vec![1e-6; 4]);
    compare("bumpy, waves of 0.3 um, slightly rough double pane", &case);
}

/// A coating without red light joins no orders that one with little red light leaves apart.
#[test]
fn light_of_any_colour_has_a_line() {
    let mut case = case(1e-4);
    case.wave = Some([1e-4, 0.05, 20.0]);
    let mut orders_with = |red: f64| {
        let mut coatings = vec![None; 4];
        coatings[2] = Some(Coating::constant([0.1; 3], [red, 0.5, 0.5]));
        let layers = vec![layer(0.004, 1.52), layer(0.012, 1.0), layer(0.004, 1.52)];
        case.stack = Some(Stack::new(layers, coatings));
        count(&case.scene().orders)
    };
    assert_eq!(orders_with(0.0), orders_with(1e-3));
}

/// Orders do not depend on the seed.
#[test]
fn the_same_orders_join_with_every_seed() {
    let mut case = case(1e-6);
    let orders = case.scene().orders;
    case.seed = 8;
    assert_eq!(case.scene().orders, orders);
}
