//! Traces rays: a pure function from a scene, a tile and a range of samples to the means of the four layers.
//!
//! `tracer` documents the estimator, `slab` the glass, `walk` the intersection with depth images and `mesh` the
//! intersection with triangle meshes. The module uses no file, clock, environment variable or thread pool, and every
//! sum has a fixed order, so the bits of a pixel depend only on the scene and the sample range.
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
//! // At normal incidence, a face reflects ((n - 1) / (n + 1))^2. Without absorption, the pane loses no light.
//! assert!((pane.weight(Order::Reflected(0), 1.0)[0] - 0.04).abs() < 1e-15);
//! let all = pane.total_transmittance(1.0)[0] + pane.total_reflectance(1.0)[0];
//! assert!((all - 1.0).abs() < 1e-15);
//! ```

#![allow(
    clippy::needless_bitwise_bool,
    reason = "`&` and `|` keep lane loops free of branches, so that they become vector code"
)]
#![allow(clippy::cast_possible_wrap, reason = "grids and textures have fewer than 2^31 elements")]

mod adaptive;
mod balance;
mod bent;
mod bow;
mod bundle;
mod camera;
mod closed;
mod cover;
mod fetch;
mod footprint;
mod grid;
mod groups;
mod isa;
mod labels;
mod lanes;
mod lines;
mod means;
mod mesh;
mod orders;
mod overlay;
mod patch;
mod probe;
mod rough;
mod sampler;
mod scene;
mod shade;
mod slab;
mod smudges;
mod spans;
mod stack;
mod texture;
mod tile;
mod tracer;
mod walk;
mod wave;
mod zones;

pub use adaptive::CELL_PX;
pub use balance::LARGEST_BALANCE;
pub use bow::Bow;
pub use cover::{Card, Cover, Outline};
pub use grid::Grid;
pub use isa::Isa;
pub use means::{PixelMeans, square_error};
pub use mesh::{MAX_COORDINATE_M, Mesh, MeshCounts, NEAR_M};
pub use orders::{FollowedOrder, OrderPlan};
pub use probe::{BundleProbe, ProbeRay, WalkCount, sample_patch};
pub use rough::{Cut, Forms, Meeting, RoughPane, RoughShape, visible_share, visible_shift};
pub use sampler::{BLOCK, PixelSeed, sample};
pub use scene::{FilmPlane, FilterTable, Lens, Pose, Sampling, Scene, Surface, View};
pub use slab::{Order, Slab};
pub use smudges::{Smear, SmearedPane, Smudges};
pub use stack::{Coating, Exit, Stack, StackLayer, StackOptics, StackOrder, StackTable};
pub use texture::Texture;
pub use tile::{Tile, TileResult, trace_tile};
pub use wave::Wave;
pub use zones::{ZONE_PX, Zones};

/// Version of the tracer's results; a change of a pixel or stated error must raise it. A run rejects other versions.
pub const TRACER_VERSION: u32 = 7;

#[cfg(test)]
mod tests;
