//! A hierarchy of boxes in projective space, walked without a stack by sixteen rays at once.
//!
//! obvhs builds it (PLOC with reinsertion, one thread, single precision). Because every ray runs down the w axis,
//! one order from near to far serves them all: the nodes are laid out in that order, depth first, and a node that no
//! ray touches names the node after its subtree. So there is no stack to overflow, however deep the tree.

use super::woop::{Corners, Hits, Rays};
use core::time::Duration;
use glam::Vec3A;
use obvhs::{BvhBuildParams, aabb::Aabb, bvh2::builder::build_bvh2};

/// Margin of the boxes and the rays, relative: eight roundings of f32.
pub(super) const MARGIN: f32 = 4.768_371_6e-7;

/// A box and its successor.
struct Node {
    low: [f32; 3],
    high: [f32; 3],
    /// Triangles of a leaf; 0 for an inner node.
    count: u32,
    /// A leaf's first triangle; of an inner node, the node after its subtree.
    link: u32,
}

/// Triangles and the boxes around them.
pub(super) struct Tree {
    nodes: Vec<Node>,
    triangles: Vec<Corners>,
    /// Place of each triangle in the caller's order: it decides between hits at equal w.
    ranks: Vec<u32>,
    top: f32,
}

/// Steps of the layout.
enum Step {
    Enter(u32),
    Leave(usize),
}

impl Tree {
    /// A tree over `triangles`, and the order in which it keeps them (indices into `triangles`).
    pub(super) fn new(triangles: &[Corners], lateral_m: f64) -> (Self, Vec<u32>) {
        let mut tree = Self {
            nodes: Vec::new(),
            triangles: Vec::with_capacity(triangles.len()),
            ranks: Vec::new(),
            top: 0.0,
        };
        if triangles.is_empty() {
            return (tree, Vec::new());
        }
        // Over a height of 1/m a ray moves sideways by `lateral_m`: in this scale the builder's areas are the boxes' areas
        // as such rays see them. A power of two: nothing is rounded.
        let exponent = libm::round(libm::log2(lateral_m.clamp(1.0e-4, 1.0)));
        let scale = libm::exp2(exponent) as f32;
        let boxes: Vec<Aabb> = triangles
            .iter()
            .map(|corners| {
                let points = corners.map(|[u, v, w]| Vec3A::new(u, v, w * scale));
                Aabb::from_points(&points)
            })
            .collect();
        // The builder measures its own time; it is not used here.
        let built = build_bvh2(&boxes, BvhBuildParams::medium_build(), &mut Duration::default());
        drop(boxes);
        let mut steps = vec![Step::Enter(0)];
        while let Some(step) = steps.pop() {
            let index = match step {
                Step::Enter(index) => index,
                Step::Leave(index) => {
                    tree.nodes[index].link = tree.nodes.len() as u32;
                    continue;
                }
            };
            let node = &built.nodes[index as usize];
            let first = tree.triangles.len() as u32;
            if node.is_leaf() {
                let range =
                    node.first_index as usize..(node.first_index + node.prim_count) as usize;
                for &i in &built.primitive_indices[range] {
                    tree.triangles.push(triangles[i as usize]);
                    tree.ranks.push(i);
                }
            } else {
                steps.push(Step::Leave(tree.nodes.len()));
                let children = [node.first_index, node.first_index + 1];
                let [left, right] = children.map(|child| {
                    let bounds = built.nodes[child as usize].aabb();
                    bounds.min.z + bounds.max.z
                });
                let [near, far] = if left >= right { children } else { [children[1], children[0]] };
                steps.push(Step::Enter(far));
                steps.push(Step::Enter(near));
            }
            let [low, high] = bounds(node.aabb(), scale);
            tree.top = tree.top.max(high[2]);
            tree.nodes.push(Node { low, high, count: node.prim_count, link: first });
        }
        let order = tree.ranks.clone();
        (tree, order)
    }

    /// Largest w of all corners.
    pub(super) fn top(&self) -> f32 {
        self.top
    }

    /// Corners of a triangle by its place in the tree.
    #[inline(always)]
    pub(super) fn corners(&self, triangle: usize) -> &Corners {
        &self.triangles[triangle]
    }

    /// First hits of the first `count` rays.
    #[inline(always)]
    pub(super) fn first_hits(&self, rays: &Rays, count: usize) -> Hits {
        let mut hits = Hits::none(count);
        let mut at = 0;
        while let Some(node) = self.nodes.get(at) {
            let touched = rays.touch(node.low, node.high, &hits);
            at = if node.count > 0 || touched { at + 1 } else { node.link as usize };
            if touched {
                for triangle in node.link..node.link + node.count {
                    let corners = &self.triangles[triangle as usize];
                    rays.meet(corners, triangle, &self.ranks, &mut hits);
                }
            }
        }
        for l in count..super::super::lanes::LANES {
            hits.w[l] = 0.0;
        }
        hits
    }
}

/// Bounds of a node with a margin sideways, for the shear of the triangles in it.
fn bounds(built: &Aabb, scale: f32) -> [[f32; 3]; 2] {
    let (low, high) = (built.min, built.max);
    let margin = low.abs().max(high.abs()) * MARGIN;
    [
        [low.x - margin.x, low.y - margin.y, low.z / scale],
        [high.x + margin.x, high.y + margin.y, high.z / scale],
    ]
}
