//! Rays: a pure function from a scene, a tile and a range of samples to the four layers' means.
//!
//! The estimator is written down in `bundle`, the glass in `slab`, the intersection in `walk`
//! and, for triangle meshes, in `mesh`. No file,
//! clock, environment or thread pool is used here, and every sum has a fixed order: a pixel's bits depend on the
//! scene and the sample range alone.
//!
//! ```
//! use render::trace::{Order, Slab};
//!
//! let pane = Slab {
//!     normal: glam::DVec3::Z,
//!     plane_distance_m: 0.3,
//!     thickness_m: 0.01,
//!     ior: 1.5,
//!     absorption_per_m: [0.0; 3],
//! };
//! // At normal incidence a face reflects ((n - 1) / (n + 1))^2, and glass that absorbs nothing loses nothing.
//! assert!((pane.weight(Order::Reflected(0), 1.0)[0] - 0.04).abs() < 1e-15);
//! let all = pane.total_transmittance(1.0)[0] + pane.total_reflectance(1.0)[0];
//! assert!((all - 1.0).abs() < 1e-15);
//! ```

#![allow(
    clippy::needless_bitwise_bool,
    reason = "lane loops have no branches: `&` and `|` keep them vector code"
)]
#![allow(clippy::cast_possible_wrap, reason = "grid and texture sizes are checked to fit 31 bits")]

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
pub use tile::{Isa, Tile, TileResult, trace_tile};

/// Version of the tracer's results: raised whenever any pixel or stated error changes. A run refuses to continue with another.
pub const TRACER_VERSION: u32 = 3;

#[cfg(test)]
mod tests;
