//! Decodes the files of a scene line to sheets of radiance and inverse depth, or meshes, in metres.
//!
//! Only `load` can read files; everything else works on their bytes. A photograph passes through these modules, in this
//! order:
//!
//! ```text
//! files (format by magic bytes) -> npy | exr_raster | pfm | raster -> depth, mask, color (transfer)
//!                                                            -> fill, center -> photograph (Sheet)
//! ```
//!
//! A panorama passes through `window` (the visible part) and `equirect` to `panorama` (Sheet), and a mesh through
//! `ply_header`, `ply` and `transfer` to `mesh` (Polygons). `assemble` takes sheets and meshes and uses `place`,
//! `check_geometry`, `negligible`, `near` and `surface`, with the coordinates of `geometry`. `look` checks files by their headers. `cache`
//! keeps decoded photographs, if asked to.
//!
//! Hostile bytes cause a [`SceneError`](crate::formats::SceneError), never a panic. Sizes are checked
//! ([`crate::formats::limits`]) before memory of that size is allocated. A sheet's bits depend only on the bytes and
//! the scene line: one thread, a fixed order, and [`libm`] for powers and angles.

mod aspect;
mod assemble;
mod cache;
mod card;
mod center;
mod check_geometry;
mod color;
mod depth;
mod equirect;
mod error;
mod facts;
mod far;
mod fill;
mod geometry;
mod highlights;
mod largest_code;
mod load;
mod loader;
mod look;
mod mask;
mod mesh;
mod near;
mod negligible;
mod panorama;
mod photograph;
mod place;
mod relative;
mod sketch;
mod smudges;
mod surface;
mod transfer;
mod turned;
mod view;
mod window;

pub use aspect::OtherAspect;
pub use assemble::{assemble, assemble_decoded};
pub use cache::PhotographCache;
pub use check_geometry::{GeometryError, MAX_INCIDENCE_DEG, check_geometry};
pub use error::{AssembleError, MAX_TOO_NEAR_SHARE};
pub use facts::{OrderFact, SceneFacts, Sides, SidesWith};
pub use far::{FAR_MEDIAN_M, depth_remarks};
pub(crate) use geometry::BackCamera;
pub use geometry::coating_of;
pub use load::{
    DecodedScene, InputDigests, LoadError, LoadedScene, SceneFiles, SideFiles, decode, load,
    load_with, read_files, read_files_by,
};
pub use loader::SceneLoader;
pub use look::{END_BYTES, FileEnds, FileRole, Look, START_BYTES, look, look_at_whole};
pub use mesh::{Polygons, decode_mesh};
pub use negligible::Negligible;
pub(crate) use photograph::decode_srgb_image;
pub use photograph::{Sheet, decode_linear_image, decode_photograph};
pub use place::{Decoded, DecodedSide, MeshFacts};
pub use relative::RelativeEnds;
pub use smudges::SmudgeMap;
pub use transfer::prepare;
pub use turned::{PhotographSizes, check_turned};
pub(crate) use view::MISSED_SHARE;
pub use view::OddView;
