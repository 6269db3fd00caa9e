//! Compares the closed form of stacks with rays that are traced from face to face, and with a single slab.

use super::*;
use crate::trace::{Order, Slab};
use glam::DVec3;
use glasshouse_line::curve::Curve;

const CLEAR: [f64; 3] = [0.0; 3];

fn glass(thickness_m: f64, ior: f64, absorption_per_m: [f64; 3]) -> StackLayer {
    StackLayer { thickness_m, ior, absorption_per_m }
}

fn gap(thickness_m: f64) -> StackLayer {
    glass(thickness_m, 1.0, CLEAR)
}

fn bare(layers: Vec<StackLayer>) -> Stack {
    let faces = layers.len() + 1;
    Stack::new(layers, vec![None; faces])
}

/// Returns the weights at one cosine.
fn at(stack: &Stack, cos: f64, least: f64, most: usize) -> BTreeMap<StackOrder, [f64; 3]> {
    let weights = stack.weights(&[cos], least, most);
    weights.into_iter().map(|(order, weights)| (order, weights[0])).collect()
}

/// A coating whose sides and angles differ.
fn two_sided() -> Coating {
    let curve = |values: [f64; 4]| {
        let rows = values.map(|v| [v, 0.8 * v, 0.9 * v]);
        Curve::through(vec![0.0, 0.3, 0.7, 1.0], rows.to_vec())
    };
    Coating {
        reflectance: curve([1.0, 0.35, 0.12, 0.1]),
        reflectance_back: curve([0.9, 0.2, 0.08, 0.05]),
        transmittance: curve([0.0, 0.6, 0.85, 0.86]),
    }
}

/// Two panes, three unequal panes with absorption and two coatings, and a laminate.
fn stacks() -> Vec<Stack> {
    let low_e = Coating::constant([0.12, 0.06, 0.16], [0.80, 0.86, 0.78]);
    let pane = glass(0.004, 1.52, CLEAR);
    let three = vec![
        glass(0.004, 1.52, [6.0, 2.0, 4.0]),
        gap(0.012),
        glass(0.006, 1.52, [3.0, 1.0, 5.0]),
        gap(0.016),
        glass(0.004, 1.5, CLEAR),
    ];
    vec![
        bare(vec![pane, gap(0.016), pane]),
        Stack::new(three, vec![None, Some(low_e), Some(two_sided()), None, None, None]),
        bare(vec![pane, glass(0.00076, 1.48, [20.0, 10.0, 10.0]), pane]),
    ]
}

/// Bends a direction by Snell's law in vector form, from index `n1` to `n2`, at a face with the normal z.
fn refracted(direction: DVec3, n1: f64, n2: f64) -> DVec3 {
    let d = direction.normalize();
    let ratio = n1 / n2;
    let along = d.z.abs();
    let cos = (1.0 - ratio * ratio * (1.0 - along * along)).sqrt();
    DVec3::new(ratio * d.x, ratio * d.y, cos * d.z.signum())
}

/// Fresnel's reflectances by the angles of both media, as in the textbook.
fn reflectances(n1: f64, cos1: f64, n2: f64, cos2: f64) -> [f64; 2] {
    let square = |x: f64| x * x;
    [
        square((n1 * cos1 - n2 * cos2) / (n1 * cos1 + n2 * cos2)),
        square((n2 * cos1 - n1 * cos2) / (n2 * cos1 + n1 * cos2)),
    ]
}

/// Traces every path with up to `depth` faces one by one. Returns for each the side, the point on the plane z = 0 of the line
/// on which it leaves (in mirrored space, if reflected), and its power.
fn explicit(stack: &Stack, direction: DVec3, depth: usize) -> Vec<(Exit, DVec3, [f64; 3])> {
    let at_cos = direction.normalize().z;
    let mut planes = vec![0.0];
    for layer in &stack.layers {
        planes.push(planes.last().unwrap() + layer.thickness_m);
    }
    let ior =
        |l: isize| usize::try_from(l).ok().and_then(|l| stack.layers.get(l)).map_or(1.0, |l| l.ior);
    let mut left = vec![];
    // (point on a face, direction before it, the face, power)
    let mut rays = vec![(DVec3::ZERO, direction.normalize(), 0usize, [[1.0; 3]; 2])];
    for _ in 0..depth {
        let mut next = vec![];
        for (point, d, face, power) in rays {
            let inward = d.z > 0.0;
            let (from, to) = if inward {
                (face as isize - 1, face as isize)
            } else {
                (face as isize, face as isize - 1)
            };
            let bent = refracted(d, ior(from), ior(to));
            let r = match &stack.coatings[face] {
                Some(coating) => [coating.reflectance(inward).at(at_cos); 2],
                None => reflectances(ior(from), d.normalize().z.abs(), ior(to), bent.z.abs())
                    .map(|r| [r; 3]),
            };
            let t = match &stack.coatings[face] {
                Some(coating) => [coating.transmittance.at(at_cos); 2],
                None => r.map(|r| r.map(|r| 1.0 - r)),
            };
            let mirrored = DVec3::new(d.x, d.y, -d.z);
            for (d, layer, share) in [(bent, to, t), (mirrored, from, r)] {
                let mut power = product(&power, &share);
                let Some(layer) = usize::try_from(layer).ok().filter(|l| *l < stack.layers.len())
                else {
                    let exit = if d.z > 0.0 { Exit::Transmitted } else { Exit::Reflected };
                    // A reflected ray continues straight in mirrored space.
                    let out = DVec3::new(d.x, d.y, d.z.abs());
                    let line = point - out * (point.z / out.z);
                    left.push((exit, line, [0, 1, 2].map(|c| 0.5 * (power[0][c] + power[1][c]))));
                    continue;
                };
                let end = if d.z > 0.0 { layer + 1 } else { layer };
                let length = (planes[end] - point.z) / d.z;
                let absorbed =
                    stack.layers[layer].absorption_per_m.map(|a| (-a * length * d.length()).exp());
                power = product(&power, &[absorbed; 2]);
                next.push((point + d * length, d, end, power));
            }
        }
        rays = next;
    }
    left
}

/// Largest number of passages through single layers that light of an order can have taken.
fn most_passages(stack: &Stack, order: &StackOrder) -> f64 {
    let of = |(&fm, ior): (&i64, &f64)| {
        let layers = stack.layers.iter().filter(|layer| layer.ior == *ior);
        let thinnest_m = layers.map(|layer| layer.thickness_m).fold(f64::INFINITY, f64::min);
        fm as f64 / FM_PER_M / thinnest_m
    };
    order.lengths_fm.iter().zip(&stack.media).map(of).sum()
}

/// The lines and weights of orders equal those of an explicit trace, at angles up to 85 degrees.
#[test]
fn orders_equal_an_explicit_trace() {
    const DEPTH: usize = 13;
    for stack in stacks() {
        for angle_deg in [1.0f64, 20.0, 50.0, 75.0, 85.0] {
            let (sin, cos) = angle_deg.to_radians().sin_cos();
            let direction = DVec3::new(sin * 0.8, sin * 0.6, cos);
            let paths = explicit(&stack, direction, DEPTH);
            let (mut compared, mut met) = (0, 0);
            for (order, weight) in &at(&stack, cos, 1e-18, DEPTH) {
                // Both must contain all paths of the order.
                if most_passages(&stack, order) > DEPTH as f64 - 0.5 {
                    continue;
                }
                // A shift by kappa n moves the line's point in the plane z = 0 by -kappa d / d.z.
                let expected = -direction / direction.z * stack.kappa_m(order, cos);
                let mut sum = [0.0; 3];
                for (exit, line, power) in &paths {
                    if *exit == order.exit && (*line - expected).truncate().length() < 1e-12 {
                        (0..3).for_each(|c| sum[c] += power[c]);
                        met += 1;
                    }
                }
                for c in 0..3 {
                    assert!((sum[c] - weight[c]).abs() < 1e-9, "{order:?}: {sum:?}, {weight:?}");
                }
                compared += 1;
            }
            assert!(compared >= 8 && met > compared);
        }
    }
}

/// The orders share the totals of the closed form, and without losses all light leaves.
#[test]
fn energy_is_kept() {
    // The paths of three panes are too many to follow them all.
    let most = [200, 24, 200];
    for ((stack, most), is_clear) in stacks().into_iter().zip(most).zip([true, false, false]) {
        let tolerance = if most < 100 { 3e-3 } else { 1e-9 };
        for cos in [1.0, 0.8, 0.3] {
            let [reflected, transmitted] = stack.totals(cos);
            let mut sums = [[0.0; 3]; 2];
            for (order, weight) in at(&stack, cos, 1e-13, most) {
                let sum = &mut sums[usize::from(order.exit == Exit::Transmitted)];
                (0..3).for_each(|c| sum[c] += weight[c]);
            }
            for c in 0..3 {
                for (sum, total) in [(sums[0], reflected), (sums[1], transmitted)] {
                    assert!((total[c] - sum[c]).abs() < tolerance, "{cos}: {sum:?}, {total:?}");
                }
                let all = reflected[c] + transmitted[c];
                assert!(if is_clear { (all - 1.0).abs() < 1e-12 } else { all < 1.0 });
            }
        }
    }
}

/// A stack of one layer has the orders of a slab, and gaps of 0 m do not change a pane.
#[test]
fn one_layer_is_a_slab() {
    let absorption_per_m = [6.0, 2.0, 4.0];
    let slab = Slab {
        normal: DVec3::Z,
        plane_distance_m: 0.3,
        thickness_m: 0.008,
        ior: 1.52,
        absorption_per_m,
    };
    let one = bare(vec![glass(0.008, 1.52, absorption_per_m)]);
    for cos in [1.0, 0.7, 0.2] {
        let weights = at(&one, cos, 1e-14, 100);
        for order in
            [Order::Transmitted(0), Order::Reflected(0), Order::Transmitted(2), Order::Reflected(3)]
        {
            let exit = match order {
                Order::Transmitted(_) => Exit::Transmitted,
                Order::Reflected(_) => Exit::Reflected,
            };
            let lengths_fm = vec![i64::from(order.passages()) * 8_000_000_000_000];
            let same = StackOrder { exit, lengths_fm };
            let shift = one.kappa_m(&same, cos) - slab.kappa_m(order, slab.gamma(cos));
            assert!(shift.abs() < 1e-15);
            let expected = slab.weight(order, cos);
            (0..3).for_each(|c| assert!((weights[&same][c] - expected[c]).abs() < 1e-14));
        }
        assert_eq!(
            one.straight(),
            StackOrder { exit: Exit::Transmitted, lengths_fm: vec![8_000_000_000_000] }
        );
    }
}

/// The strong images of a double pane at normal incidence: one for each face, at the apparent depths of the faces.
#[test]
fn a_double_pane_has_four_images() {
    let double = &stacks()[0];
    let mut images: Vec<(f64, f64)> = at(double, 1.0, 1e-14, 20)
        .iter()
        .filter(|(order, weight)| order.exit == Exit::Reflected && weight[0] > 0.01)
        .map(|(order, weight)| (-double.kappa_m(order, 1.0), weight[0]))
        .collect();
    images.sort_by(|a, b| a.0.total_cmp(&b.0));
    let expected = [(0.0, 0.0426), (0.00526, 0.0390), (0.03726, 0.0358), (0.04253, 0.0328)];
    assert_eq!(images.len(), expected.len());
    for ((shift, weight), (of_shift, of_weight)) in images.into_iter().zip(expected) {
        assert!((shift - of_shift).abs() < 1e-5 && (weight - of_weight).abs() < 2e-4);
    }
    // N equal faces without absorption reflect N R / (1 + (N - 1) R) (Stokes, 1862).
    let face = (0.52f64 / 2.52).powi(2);
    let [reflected, _] = double.totals(1.0);
    assert!((reflected[0] - 4.0 * face / (1.0 + 3.0 * face)).abs() < 1e-12, "{reflected:?}");
}
