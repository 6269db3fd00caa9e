//! Follows the light through a stack, breadth first, within bounds.
//!
//! A generation holds the states of light that has crossed the same number of layers. If a generation has too many states, the search
//! keeps the strongest of them. This is safe, because the totals of all light are known in closed form: what is not followed joins the
//! last order of its side, as the light of weak orders does. The bounds count states, not time, so that every machine finds the same orders.

use super::paths::{Parent, Paths};
use super::{Exit, Optics, Power, Stack, StackLayer, StackOrder, product};
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

/// Where a search ends.
pub(super) struct Bounds {
    /// Share of the incident light below which, at all cosines, a state is dropped.
    pub(super) least: f64,
    /// Largest number of layers that a path crosses.
    pub(super) most_passages: usize,
    /// Largest number of states of a generation.
    pub(super) most_states: usize,
}

/// What a search found.
pub(super) struct Search {
    /// Weights of the orders at each cosine.
    pub(super) weights: BTreeMap<StackOrder, Vec<[f64; 3]>>,
    /// The states and the ways between them.
    pub(super) paths: Paths,
    /// True if a generation had too many states.
    pub(super) was_cut: bool,
}

/// A state: the next face, true for light that travels away from the camera, and the lengths crossed so far.
type State = (usize, bool, Vec<i64>);

/// The light of a state at each cosine, and the states before it.
struct Light {
    powers: Vec<Power>,
    parents: [Option<Parent>; 2],
}

type Generation = BTreeMap<State, Light>;

/// Follows the light that enters `stack` at face 0, at each of `cosines` of incidence.
pub(super) fn search(stack: &Stack, cosines: &[f64], bounds: &Bounds) -> Search {
    let optics: Vec<Optics> = cosines.iter().map(|&cos_i| stack.optics(cos_i)).collect();
    let mut found = Search { weights: BTreeMap::new(), paths: Paths::default(), was_cut: false };
    let incident = Light { powers: vec![[[1.0; 3]; 2]; cosines.len()], parents: [None; 2] };
    let mut states: Generation =
        BTreeMap::from([((0, true, vec![0; stack.media.len()]), incident)]);
    for _ in 0..=bounds.most_passages {
        let mut next = Generation::new();
        for (state, light) in states {
            let index = found.paths.add(state.0, state.1, light.parents);
            for is_reflected in [false, true] {
                let parent = Parent { index, is_reflected };
                found.follow(stack, &optics, bounds.least, (&state, &light, parent), &mut next);
            }
        }
        found.was_cut |= keep_strongest(&mut next, bounds.most_states);
        states = next;
    }
    found
}

impl Search {
    /// Follows the light of a state that its face transmits or reflects: out of the stack, or into `next`.
    fn follow(
        &mut self,
        stack: &Stack,
        optics: &[Optics],
        least: f64,
        ((face, inward, lengths_fm), before, parent): (&State, &Light, Parent),
        next: &mut Generation,
    ) {
        let (face, inward) = (*face, *inward);
        let of = |(power, optics): (&Power, &Optics)| {
            let face = &optics.faces[face];
            product(power, if parent.is_reflected { face.reflected(inward) } else { &face.t })
        };
        let mut powers: Vec<Power> = before.powers.iter().zip(optics).map(of).collect();
        if powers.as_flattened().as_flattened().iter().all(|p| *p < least) {
            return;
        }
        let inward = inward != parent.is_reflected;
        let exit = match () {
            () if face == 0 && !inward => Exit::Reflected,
            () if face == stack.layers.len() && inward => Exit::Transmitted,
            () => {
                // The layer that the light enters, and the face at its other end.
                let (layer, end) = if inward { (face, face + 1) } else { (face - 1, face - 1) };
                for (power, optics) in powers.iter_mut().zip(optics) {
                    *power = product(power, &[optics.tau[layer]; 2]);
                }
                let lengths_fm = crossed(stack, &stack.layers[layer], lengths_fm);
                add(next, (end, inward, lengths_fm), powers, parent);
                return;
            }
        };
        let order = StackOrder { exit, lengths_fm: lengths_fm.clone() };
        self.paths.leave(&order, parent);
        let sums = self.weights.entry(order).or_insert_with(|| vec![[0.0; 3]; optics.len()]);
        for (sum, power) in sums.iter_mut().zip(&powers) {
            add_unpolarised(sum, power);
        }
    }
}

/// Adds half of the light of s and of p.
pub(super) fn add_unpolarised(sum: &mut [f64; 3], power: &Power) {
    (0..3).for_each(|c| sum[c] += 0.5 * (power[0][c] + power[1][c]));
}

fn crossed(stack: &Stack, layer: &StackLayer, lengths_fm: &[i64]) -> Vec<i64> {
    let mut lengths_fm = lengths_fm.to_vec();
    stack.cross(layer, &mut lengths_fm);
    lengths_fm
}

/// Adds light to a state. At most two states precede one: that before the layer which the light crossed last, in either direction.
fn add(next: &mut Generation, state: State, powers: Vec<Power>, parent: Parent) {
    match next.entry(state) {
        Entry::Vacant(entry) => {
            entry.insert(Light { powers, parents: [Some(parent), None] });
        }
        Entry::Occupied(mut entry) => {
            let light = entry.get_mut();
            let sums = light.powers.as_flattened_mut().as_flattened_mut();
            let powers = powers.as_flattened().as_flattened();
            sums.iter_mut().zip(powers).for_each(|(sum, power)| *sum += power);
            light.parents[1] = Some(parent);
        }
    }
}

/// Reduces a generation to its `most` strongest states; of equal ones, it keeps the first. Returns true if it dropped any.
fn keep_strongest(states: &mut Generation, most: usize) -> bool {
    if states.len() <= most {
        return false;
    }
    let strength = |light: &Light| {
        light.powers.as_flattened().as_flattened().iter().copied().fold(0.0, f64::max)
    };
    let mut ranks: Vec<(f64, usize)> =
        states.values().enumerate().map(|(i, light)| (strength(light), i)).collect();
    ranks.select_nth_unstable_by(most, |a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut is_kept = vec![false; ranks.len()];
    ranks[..most].iter().for_each(|&(_, i)| is_kept[i] = true);
    let mut is_kept = is_kept.into_iter();
    states.retain(|_, _| is_kept.next().expect("each state has a rank"));
    true
}
