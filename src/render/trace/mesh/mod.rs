//! Triangle meshes: the general path, for surfaces other than depth images and for poses that a grid does not support.
//!
//! ```text
//! project.rs   corners in the lens's projective space (x/z, y/z, w = 1/z); clipped at the near plane
//! tree.rs      a bounding volume hierarchy from obvhs; sixteen rays traverse it at once
//! woop.rs      watertight intersection of sixteen rays with a triangle
//! bundle.rs    adds the radiance at the hits to the estimator's sums
//! ```
//!
//! In this space triangles stay triangles. A ray through point (x, y) of the plane z = 0 with direction (dx, dy, 1)
//! becomes (u, v) = (dx, dy) + w (x, y), and w decreases from 1000/m at the near plane to 0 at infinity. All rays run
//! along the w axis, so all share one order of the boxes from near to far, and the triangle test needs no choice of
//! axes. The nearest hit is the hit with the largest w.
//!
//! A hit depends only on its ray and the triangles, not on the shape of the tree or the fifteen other rays: the box
//! test has a margin that covers every rounding, and the first triangle of the mesh wins among hits at equal w.

mod bundle;
mod project;
mod tree;
mod woop;

pub(super) use bundle::follow;
pub use project::{MAX_COORDINATE_M, Mesh, MeshCounts, NEAR_M};

#[cfg(test)]
mod tests;
