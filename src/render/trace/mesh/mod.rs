//! Triangle meshes: the general path, for surfaces that are no depth image and for poses that no grid can take.
//!
//! ```text
//! project.rs   corners in the lens's projective space (x/z, y/z, w = 1/z); cut off behind it
//! tree.rs      a hierarchy of boxes around them, built by obvhs, walked by sixteen rays at once
//! woop.rs      sixteen rays against a triangle: no ray slips between two triangles that share an edge
//! bundle.rs    radiance at the hits into the estimator's sums
//! ```
//!
//! In this space triangles stay triangles, and a ray through point (x, y) of the plane z = 0 with direction
//! (dx, dy, 1) is (u, v) = (dx, dy) + w (x, y), w falling from the near plane's 1000/m to 0 at infinity. All rays
//! run down the same axis, so there is one order of the boxes from near to far, and no choice of axes in the
//! triangle test. The nearest hit is the one with the largest w.
//!
//! A hit depends on its ray and the triangles alone: boxes are tested with a margin that covers every rounding, and
//! of hits at equal w the first triangle's counts, so neither the tree's shape nor the fifteen other rays matter.

mod bundle;
mod project;
mod tree;
mod woop;

pub(super) use bundle::{Bundle, follow};
pub use project::{MAX_COORDINATE_M, Mesh, MeshCounts, NEAR_M};

#[cfg(test)]
mod tests;
