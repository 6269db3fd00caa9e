//! Selects the orders of a stack that the tracer follows.
//!
//! A stack has many orders, each below the film's tolerance, whose sum is not. Each side's orders are therefore taken from the
//! strongest on until the sum of the others is below the tolerance, and the light of the others, known in closed form, joins the
//! longest order that is followed.

use super::super::orders::MOST_PATHS;
use super::paths::Paths;
use super::search::{Bounds, search};
use super::{Exit, Stack, StackOrder};
use std::collections::BTreeMap;

/// Largest number of layers that a path crosses. The light of longer paths joins the last order, too.
pub(super) const MOST_PASSAGES: usize = 64;
/// Largest number of states of a search that have crossed the same number of layers.
pub(super) const MOST_STATES: usize = 2048;

/// Samples of an order's weights over the cosines.
pub(super) struct Candidate {
    pub(super) order: StackOrder,
    pub(super) weights: Vec<[f64; 3]>,
}

/// The followed orders of the front and of the back, from the shortest to the longest; the last one takes the light of the dropped
/// orders.
pub(super) struct Selection {
    pub(super) kept: [Vec<Candidate>; 2],
    /// Bounds of the light of the dropped orders, as shares.
    pub(super) dropped: [f64; 2],
}

/// A selection with the paths that its search found.
pub(super) struct Searched {
    pub(super) selection: Selection,
    pub(super) paths: Paths,
    /// True if the search left out paths because there were too many.
    pub(super) was_cut: bool,
}

/// Searches and selects the orders for the largest radiances of the front and the back scene and the film's tolerance.
pub(super) fn select(
    stack: &Stack,
    cosines: &[f64],
    max_radiance: [f64; 2],
    tolerance: f64,
) -> Searched {
    let brightest = max_radiance[0].max(max_radiance[1]);
    let least = (1e-3 * tolerance / brightest.max(f64::MIN_POSITIVE)).clamp(1.0e-9, 1.0e-6);
    let bounds = Bounds { least, most_passages: MOST_PASSAGES, most_states: MOST_STATES };
    let found = search(stack, cosines, &bounds);
    let mut sides = [vec![], vec![]];
    for (order, weights) in found.weights {
        sides[usize::from(order.exit == Exit::Reflected)].push(Candidate { order, weights });
    }
    let straight = stack.straight();
    if sides[0].iter().all(|candidate| candidate.order != straight) {
        // T needs the line of t_0, even if no light takes it.
        let weights = vec![[0.0; 3]; cosines.len()];
        sides[0].push(Candidate { order: straight.clone(), weights });
    }
    let rests = totals(stack, cosines);
    let mut dropped = [0.0; 2];
    let mut side = 0;
    let kept = sides.map(|candidates| {
        let (mut rest, radiance) = (rests[side].clone(), max_radiance[side]);
        let mut kept = keep(candidates, &mut rest, (&straight, radiance, tolerance));
        kept.sort_by(|a, b| {
            let shift_m = |c: &Candidate| stack.kappa_m(&c.order, 1.0);
            shift_m(b).total_cmp(&shift_m(a)).then_with(|| a.order.cmp(&b.order))
        });
        dropped[side] = join(&mut kept, &rest);
        side += 1;
        kept
    });
    let selection = Selection { kept, dropped };
    Searched { selection, paths: found.paths, was_cut: found.was_cut }
}

impl Selection {
    /// Returns the selected orders with their weights at other cosines, along the `paths` of a search.
    pub(super) fn at(&self, stack: &Stack, paths: &Paths, cosines: &[f64]) -> Self {
        let mut weights: BTreeMap<_, _> = paths.weights(stack, cosines);
        let rests = totals(stack, cosines);
        let mut dropped = [0.0; 2];
        let kept = [0, 1].map(|side: usize| {
            let mut rest = rests[side].clone();
            let weighed = |candidate: &Candidate| {
                let order = candidate.order.clone();
                let weights = weights.remove(&order).expect("the paths hold the selected orders");
                subtract(&mut rest, &weights);
                Candidate { order, weights }
            };
            let mut kept = self.kept[side].iter().map(weighed).collect::<Vec<_>>();
            dropped[side] = join(&mut kept, &rest);
            kept
        });
        Self { kept, dropped }
    }

    /// Returns the selected orders of both sides.
    pub(super) fn orders(&self) -> impl Iterator<Item = &StackOrder> {
        self.kept.iter().flatten().map(|candidate| &candidate.order)
    }
}

/// Returns the light of all orders of the front, and of the back.
fn totals(stack: &Stack, cosines: &[f64]) -> [Vec<[f64; 3]>; 2] {
    let totals: Vec<_> = cosines.iter().map(|&cos_i| stack.totals(cos_i)).collect();
    [1, 0].map(|of: usize| totals.iter().map(|total| total[of]).collect())
}

/// Keeps the orders whose light, with that of t_0 or r_0, leaves less than the tolerance of the total light `rest`.
fn keep(
    mut candidates: Vec<Candidate>,
    rest: &mut [[f64; 3]],
    (straight, radiance, tolerance): (&StackOrder, f64, f64),
) -> Vec<Candidate> {
    let is_first = |order: &StackOrder| {
        order == straight
            || order.exit == Exit::Reflected && order.lengths_fm.iter().all(|l| *l == 0)
    };
    candidates.sort_by(|a, b| {
        let key = |c: &Candidate| (is_first(&c.order), largest(&c.weights));
        let ((first_a, a), (first_b, b)) = (key(a), key(b));
        first_b.cmp(&first_a).then(b.total_cmp(&a))
    });
    let mut kept: Vec<Candidate> = vec![];
    for candidate in candidates {
        let is_needed = MOST_PATHS.needs_more(kept.len(), largest(rest), radiance, tolerance);
        let is_t_0 = candidate.order == *straight;
        // The first order of a side receives the light of the others.
        let is_only = kept.is_empty() && largest(rest) * radiance > 0.0;
        if !is_t_0 && !is_only && !is_needed {
            break;
        }
        subtract(rest, &candidate.weights);
        kept.push(candidate);
    }
    kept
}

/// Gives the `rest` of the light to the last order. Returns its largest share.
fn join(kept: &mut [Candidate], rest: &[[f64; 3]]) -> f64 {
    if let Some(last) = kept.last_mut() {
        for (weight, rest) in last.weights.iter_mut().zip(rest) {
            (0..3).for_each(|c| weight[c] += rest[c].max(0.0));
        }
    }
    largest(rest).max(0.0)
}

fn subtract(rest: &mut [[f64; 3]], weights: &[[f64; 3]]) {
    for (rest, weight) in rest.iter_mut().zip(weights) {
        (0..3).for_each(|c| rest[c] -= weight[c]);
    }
}

pub(super) fn largest(weights: &[[f64; 3]]) -> f64 {
    weights.as_flattened().iter().copied().fold(f64::NEG_INFINITY, f64::max)
}
