//! A bounding volume hierarchy in projective space. Sixteen rays traverse it at once, without a stack.
//!
//! The crate obvhs builds the tree (PLOC with reinsertion, one thread, single precision). Every ray runs along the w
//! axis, so all rays have the same order of nodes from near to far. The nodes are in this order, depth first, and an
//! inner node links to the node after its subtree, for rays that miss it. Trees of any depth need no stack.

use super::woop::{Corners, Hits, Rays};
use core::time::Duration;
use glam::Vec3A;
use obvhs::{BvhBuildParams, aabb::Aabb, bvh2::builder::build_bvh2};

/// Relative margin of the boxes and the rays: eight roundings of f32.
pub(super) const MARGIN: f32 = 4.768_371_6e-7;

/// A box with its triangles, or with a link past its subtree.
struct Node {
    low: [f32; 3],
    high: [f32; 3],
    /// Number of triangles of a leaf; 0 for an inner node.
    count: u32,
    /// First triangle of a leaf, or next node after the subtree of an inner node.
    link: u32,
}

/// Triangles and the boxes around them.
pub(super) struct Tree {
    nodes: Vec<Node>,
    triangles: Vec<Corners>,
    /// Index of each triangle in the caller's order; the lowest index wins among hits at equal w.
    ranks: Vec<u32>,
    top: f32,
}

/// Step of the depth-first layout.
enum Step {
    Enter(u32),
    Leave(usize),
}

impl Tree {
    /// Builds a tree over `triangles`. Also returns its order of the triangles (indices into `triangles`).
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
        // Over 1/m of w, a ray moves sideways by `lateral_m`. With w in this scale, the surface area of a box, on which
        // the builder's choices depend, is roughly proportional to the probability that such a ray hits the box. The
        // scale is a power of two, so it adds no rounding.
        let exponent = libm::round(libm::log2(lateral_m.clamp(1.0e-4, 1.0)));
        let scale = libm::exp2(exponent) as f32;
        let boxes: Vec<Aabb> = triangles
            .iter()
            .map(|corners| {
                let points = corners.map(|[u, v, w]| Vec3A::new(u, v, w * scale));
                Aabb::from_points(&points)
            })
            .collect();
        // The builder stores its duration, which is unused here.
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

    /// Returns the largest w of all corners.
    pub(super) fn top(&self) -> f32 {
        self.top
    }

    /// Returns the corners of a triangle by its index in the tree.
    #[inline(always)]
    pub(super) fn corners(&self, triangle: usize) -> &Corners {
        &self.triangles[triangle]
    }

    /// Finds the first hits of the first `count` rays.
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

/// Returns the bounds of a node, with a lateral margin for the rounding of the shear.
fn bounds(built: &Aabb, scale: f32) -> [[f32; 3]; 2] {
    let (low, high) = (built.min, built.max);
    let margin = low.abs().max(high.abs()) * MARGIN;
    [
        [low.x - margin.x, low.y - margin.y, low.z / scale],
        [high.x + margin.x, high.y + margin.y, high.z / scale],
    ]
}
