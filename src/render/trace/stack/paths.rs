//! The ways of light through a stack that a search has found, to compute the weights of some orders at other cosines.

use super::search::add_unpolarised;
use super::{Optics, Power, Stack, StackOrder, product};
use std::collections::BTreeMap;

/// Cosines that are computed together, to bound the memory.
const COSINES: usize = 16;

/// A state and what its face does with the light.
#[derive(Clone, Copy)]
pub(super) struct Parent {
    pub(super) index: u32,
    pub(super) is_reflected: bool,
}

/// A state of the search.
#[derive(Clone, Copy)]
struct Node {
    face: u32,
    /// True for light that travels away from the camera.
    inward: bool,
    /// The states before it; none for the light that enters the stack.
    parents: [Option<Parent>; 2],
}

/// States of light, each behind those before it.
#[derive(Default)]
pub(super) struct Paths {
    nodes: Vec<Node>,
    /// States from which light leaves on the line of an order.
    exits: BTreeMap<StackOrder, Vec<Parent>>,
}

impl Paths {
    /// Adds a state, and returns its index.
    pub(super) fn add(&mut self, face: usize, inward: bool, parents: [Option<Parent>; 2]) -> u32 {
        self.nodes.push(Node { face: face as u32, inward, parents });
        self.nodes.len() as u32 - 1
    }

    /// Notes that light leaves on the line of an order.
    pub(super) fn leave(&mut self, order: &StackOrder, from: Parent) {
        self.exits.entry(order.clone()).or_default().push(from);
    }

    /// Returns the number of states.
    pub(super) fn states(&self) -> usize {
        self.nodes.len()
    }

    /// Returns the states through which the light of `orders` passes.
    pub(super) fn of_orders<'a>(&self, orders: impl Iterator<Item = &'a StackOrder>) -> Self {
        let exits: BTreeMap<_, _> = orders
            .map(|order| (order.clone(), self.exits.get(order).cloned().unwrap_or_default()))
            .collect();
        let mut is_needed = vec![false; self.nodes.len()];
        exits.values().flatten().for_each(|from| is_needed[from.index as usize] = true);
        for index in (0..self.nodes.len()).rev() {
            if is_needed[index] {
                let parents = self.nodes[index].parents.iter().flatten();
                parents.for_each(|parent| is_needed[parent.index as usize] = true);
            }
        }
        // The new index of each needed state.
        let mut moved = vec![0; self.nodes.len()];
        let mut paths = Self { nodes: vec![], exits };
        for (index, node) in self.nodes.iter().enumerate().filter(|(index, _)| is_needed[*index]) {
            moved[index] = paths.nodes.len() as u32;
            paths.nodes.push(*node);
        }
        let parents = paths.nodes.iter_mut().flat_map(|node| node.parents.iter_mut().flatten());
        for parent in parents.chain(paths.exits.values_mut().flatten()) {
            parent.index = moved[parent.index as usize];
        }
        paths
    }

    /// Computes the weights of all orders of the paths at other cosines.
    pub(super) fn weights(
        &self,
        stack: &Stack,
        cosines: &[f64],
    ) -> BTreeMap<StackOrder, Vec<[f64; 3]>> {
        let mut weights: BTreeMap<StackOrder, Vec<[f64; 3]>> =
            self.exits.keys().map(|order| (order.clone(), vec![])).collect();
        let mut powers: Vec<[Power; COSINES]> = vec![[[[0.0; 3]; 2]; COSINES]; self.nodes.len()];
        for cosines in cosines.chunks(COSINES) {
            let optics: Vec<Optics> = cosines.iter().map(|&cos_i| stack.optics(cos_i)).collect();
            for (index, node) in self.nodes.iter().enumerate() {
                let (before, after) = powers.split_at_mut(index);
                self.compute(node, &optics, before, &mut after[0]);
            }
            for (order, exits) in &self.exits {
                let sums = (0..cosines.len()).map(|at| {
                    let mut sum = [0.0; 3];
                    for from in exits {
                        let power = &powers[from.index as usize][at];
                        add_unpolarised(&mut sum, &self.left(*from, &optics[at], power));
                    }
                    sum
                });
                weights.get_mut(order).expect("each order has weights").extend(sums);
            }
        }
        weights
    }

    /// Computes the light of a state from that of the states `before` it.
    fn compute(
        &self,
        node: &Node,
        optics: &[Optics],
        before: &[[Power; COSINES]],
        powers: &mut [Power; COSINES],
    ) {
        if node.parents[0].is_none() {
            *powers = [[[1.0; 3]; 2]; COSINES];
            return;
        }
        // The layer that the light crossed last.
        let layer = if node.inward { node.face - 1 } else { node.face } as usize;
        *powers = [[[0.0; 3]; 2]; COSINES];
        for parent in node.parents.iter().flatten() {
            let light = &before[parent.index as usize];
            for ((power, light), optics) in powers.iter_mut().zip(light).zip(optics) {
                let entered = self.left(*parent, optics, light);
                let crossed = product(&entered, &[optics.tau[layer]; 2]);
                let sums = power.as_flattened_mut().iter_mut();
                sums.zip(crossed.as_flattened()).for_each(|(sum, power)| *sum += power);
            }
        }
    }

    /// Returns the part of the `light` of a state that its face transmits or reflects.
    fn left(&self, from: Parent, optics: &Optics, light: &Power) -> Power {
        let node = &self.nodes[from.index as usize];
        let face = &optics.faces[node.face as usize];
        product(light, if from.is_reflected { face.reflected(node.inward) } else { &face.t })
    }
}
