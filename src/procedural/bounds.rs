//! A small bounding volume hierarchy for rays that test occlusion.

use super::camera::Ray;
use super::shape::{Solid, slabs};
use glam::Vec3;

const LEAF_COUNT: usize = 3;
/// Depth from which nodes split in the middle, so that no traversal exceeds its stack.
const MAX_DEPTH: usize = 48;

#[derive(Clone, Copy, Debug)]
struct Node {
    low: Vec3,
    high: Vec3,
    /// First solid of a leaf, or second child of an inner node (the first child follows the node).
    first: u32,
    /// Number of solids of a leaf; 0 for an inner node.
    count: u32,
}

/// The solids that cast shadows, in a hierarchy of boxes.
#[derive(Debug)]
pub(super) struct Bounds {
    nodes: Vec<Node>,
    solids: Vec<Solid>,
}

impl Bounds {
    pub(super) fn new(solids: &[Solid]) -> Self {
        let mut casting: Vec<Solid> =
            solids.iter().filter(|s| s.material.casts_shadow).copied().collect();
        let mut nodes = Vec::with_capacity(casting.len());
        if !casting.is_empty() {
            split(&mut casting, 0, 0, &mut nodes);
        }
        Self { nodes, solids: casting }
    }

    /// True if a solid occludes the ray before `t_max`.
    pub(super) fn occluded(&self, ray: &Ray, t_max: f32) -> bool {
        if self.nodes.is_empty() {
            return false;
        }
        let inverse = ray.direction.recip();
        let mut stack = [0_u32; MAX_DEPTH + 16];
        let mut depth = 0;
        let mut index = 0_usize;
        loop {
            let node = &self.nodes[index];
            let (enter, leave) = slabs(node.low - ray.origin, node.high - ray.origin, inverse);
            let near = if enter > 0.0 { enter } else { 0.0 };
            let far = if leave < t_max { leave } else { t_max };
            if near <= far {
                if node.count == 0 {
                    stack[depth] = node.first;
                    depth += 1;
                    index += 1;
                    continue;
                }
                let first = node.first as usize;
                let leaf = &self.solids[first..first + node.count as usize];
                if leaf.iter().any(|s| s.intersect(ray, t_max).is_some()) {
                    return true;
                }
            }
            if depth == 0 {
                return false;
            }
            depth -= 1;
            index = stack[depth] as usize;
        }
    }
}

fn split(solids: &mut [Solid], first: u32, depth: usize, nodes: &mut Vec<Node>) {
    let (low, high) = around(solids.iter());
    let index = nodes.len();
    nodes.push(Node { low, high, first, count: solids.len() as u32 });
    if solids.len() <= LEAF_COUNT {
        return;
    }
    let (axis, middle) = best_split(solids, depth);
    sort_along(solids, axis);
    let (left, right) = solids.split_at_mut(middle);
    nodes[index].count = 0;
    split(left, first, depth + 1, nodes);
    nodes[index].first = nodes.len() as u32;
    split(right, first + middle as u32, depth + 1, nodes);
}

/// Returns the axis and position of the split of least cost (sum of area times count), or the middle of a deep node.
fn best_split(solids: &mut [Solid], depth: usize) -> (usize, usize) {
    let count = solids.len();
    if depth >= MAX_DEPTH {
        return (depth % 3, count / 2);
    }
    let mut best = (f32::MAX, 0, count / 2);
    for axis in 0..3 {
        sort_along(solids, axis);
        let mut after = vec![0.0; count];
        let (mut low, mut high) = (Vec3::MAX, Vec3::MIN);
        for i in (1..count).rev() {
            (low, high) = joined(low, high, &solids[i]);
            after[i] = surface(low, high) * (count - i) as f32;
        }
        (low, high) = (Vec3::MAX, Vec3::MIN);
        for i in 1..count {
            (low, high) = joined(low, high, &solids[i - 1]);
            let cost = surface(low, high) * i as f32 + after[i];
            if cost < best.0 {
                best = (cost, axis, i);
            }
        }
    }
    (best.1, best.2)
}

fn sort_along(solids: &mut [Solid], axis: usize) {
    solids.sort_by(|a, b| a.centre[axis].total_cmp(&b.centre[axis]));
}

fn joined(low: Vec3, high: Vec3, solid: &Solid) -> (Vec3, Vec3) {
    let half = solid.world_half() + Vec3::splat(1e-4);
    (low.min(solid.centre - half), high.max(solid.centre + half))
}

fn around<'a>(solids: impl Iterator<Item = &'a Solid>) -> (Vec3, Vec3) {
    solids.fold((Vec3::MAX, Vec3::MIN), |(low, high), s| joined(low, high, s))
}

fn surface(low: Vec3, high: Vec3) -> f32 {
    let d = high - low;
    d.x * d.y + d.y * d.z + d.z * d.x
}
