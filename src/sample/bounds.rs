//! A small bounding volume hierarchy for shadow and ambient rays.

use super::camera::Ray;
use super::shape::Solid;
use glam::Vec3;

const LEAF_COUNT: usize = 3;

#[derive(Clone, Copy, Debug)]
struct Node {
    low: Vec3,
    high: Vec3,
    /// Leaf: first solid of the range. Inner node: the second child (the first one follows it).
    first: u32,
    /// Solids of a leaf; 0 for an inner node.
    count: u32,
}

/// The solids that cast shadows, sorted for queries.
#[derive(Debug)]
pub(super) struct Bounds {
    nodes: Vec<Node>,
    solids: Vec<Solid>,
}

impl Bounds {
    pub(super) fn new(solids: &[Solid]) -> Self {
        let mut casting: Vec<Solid> = solids
            .iter()
            .filter(|s| s.material.casts_shadow)
            .copied()
            .collect();
        let mut nodes = Vec::with_capacity(casting.len());
        if !casting.is_empty() {
            split(&mut casting, 0, &mut nodes);
        }
        Self {
            nodes,
            solids: casting,
        }
    }

    /// Whether anything stands in the way of the ray before `t_max`.
    pub(super) fn occluded(&self, ray: &Ray, t_max: f32) -> bool {
        if self.nodes.is_empty() {
            return false;
        }
        let inverse = ray.direction.recip();
        let mut stack = [0_u32; 32];
        let mut depth = 0;
        let mut index = 0_usize;
        loop {
            let node = &self.nodes[index];
            let a = (node.low - ray.origin) * inverse;
            let b = (node.high - ray.origin) * inverse;
            let (low, high) = (a.min(b), a.max(b));
            let near = low.x.max(low.y).max(low.z).max(0.0);
            let far = high.x.min(high.y).min(high.z).min(t_max);
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

fn split(solids: &mut [Solid], first: u32, nodes: &mut Vec<Node>) {
    let mut low = Vec3::MAX;
    let mut high = Vec3::MIN;
    let (mut centre_low, mut centre_high) = (Vec3::MAX, Vec3::MIN);
    for s in solids.iter() {
        let half = s.world_half() + Vec3::splat(1e-4);
        low = low.min(s.centre - half);
        high = high.max(s.centre + half);
        centre_low = centre_low.min(s.centre);
        centre_high = centre_high.max(s.centre);
    }
    let index = nodes.len();
    nodes.push(Node {
        low,
        high,
        first,
        count: solids.len() as u32,
    });
    if solids.len() <= LEAF_COUNT {
        return;
    }
    let extent = centre_high - centre_low;
    let axis = if extent.x >= extent.y && extent.x >= extent.z {
        0
    } else if extent.y >= extent.z {
        1
    } else {
        2
    };
    solids.sort_by(|a, b| a.centre[axis].total_cmp(&b.centre[axis]));
    // Large solids (walls, ground) would blow up both halves: the middle is by count, which keeps
    // the tree no deeper than the stack.
    let middle = solids.len() / 2;
    let (left, right) = solids.split_at_mut(middle);
    nodes[index].count = 0;
    split(left, first, nodes);
    nodes[index].first = nodes.len() as u32;
    split(right, first + middle as u32, nodes);
}
