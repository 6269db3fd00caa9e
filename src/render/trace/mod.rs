//! Stage 4: rays. A pure function from a scene, a tile and a range of samples to the four layers' means.
//!
//! The estimator is written down in `bundle`, the glass in `slab`, the intersection in `walk`
//! and, for triangle meshes, in `mesh`. No file,
//! clock, environment or thread pool is used here, and every sum has a fixed order: a pixel's bits depend on the
//! scene and the sample range alone.

#![allow(
    clippy::needless_bitwise_bool,
    reason = "lane loops have no branches: `&` and `|` keep them vector code"
)]
#![allow(
    clippy::cast_possible_wrap,
    reason = "grid and texture sizes are checked to fit 31 bits"
)]

mod adaptive;
mod bundle;
mod camera;
mod fetch;
mod footprint;
mod grid;
mod lanes;
mod lines;
mod means;
mod mesh;
mod orders;
mod probe;
mod sampler;
mod scene;
mod shade;
mod slab;
mod texture;
mod tile;
mod walk;

pub use adaptive::CELL_PX;
pub use grid::Grid;
pub use means::{PixelMeans, square_error};
pub use mesh::{MAX_COORDINATE_M, Mesh, MeshCounts, NEAR_M};
pub use orders::{FollowedOrder, OrderPlan};
pub use probe::{BundleProbe, ProbeRay, WalkCount, sample_block};
pub use sampler::{BLOCK, PixelSeed, sample};
pub use scene::{FilmPlane, FilterTable, Lens, Pose, Sampling, Scene, Surface, View};
pub use slab::{Order, Slab};
pub use texture::Texture;
pub use tile::{Isa, LAYERS, Tile, TileResult, trace_tile};

/// Version of the tracer's results: raised whenever any pixel or stated error changes. A run refuses to continue with another.
pub const TRACER_VERSION: u32 = 3;

#[cfg(test)]
mod tests;
