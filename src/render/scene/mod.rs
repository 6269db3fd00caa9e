//! The files of a scene line become sheets of radiance and inverse depth (or meshes), in metres.
//!
//! Everything here is pure: the caller reads the files, this module reads their bytes. A
//! photograph goes through these files, in this order:
//!
//! ```text
//! files (format by magic bytes) -> npy | exr_raster | raster -> depth, mask, color (transfer)
//!                                                      -> fill, center -> photograph (Sheet)
//! ```
//!
//! a panorama through `window` (the part that the film sees) and `equirect` to `panorama` (Sheet),
//! and a mesh through `ply_header`, `ply`, `transfer` to `mesh` (Polygons). `assemble` takes either: `place`, `check_geometry`,
//! `near`, `surface`, with the coordinates of `geometry`. `look` checks files by their headers.
//!
//! Hostile bytes end in a [`SceneError`](crate::formats::SceneError), never in a panic, and sizes are checked before anything
//! of that size is allocated ([`crate::formats::limits`]). A sheet's bits are a function of the bytes and the
//! manifest line: one thread, a fixed order, and [`libm`] for powers and angles.

mod assemble;
mod center;
mod check_geometry;
mod color;
mod depth;
mod equirect;
mod error;
mod facts;
mod fill;
mod geometry;
mod highlights;
mod load;
mod look;
mod mask;
mod mesh;
mod near;
mod panorama;
mod photograph;
mod place;
mod relative;
mod surface;
mod transfer;
mod window;

pub use assemble::assemble;
pub use check_geometry::{GeometryError, MAX_INCIDENCE_DEG, check_geometry};
pub use error::{AssembleError, MAX_TOO_NEAR_SHARE};
pub use facts::{OrderFact, SceneFacts, Sides, SidesWith};
pub(crate) use geometry::BackCamera;
pub use load::{
    DecodedScene, InputDigests, LoadError, LoadedScene, SceneFiles, SideFiles, decode, load,
    read_files, read_files_by,
};
pub use look::{END_BYTES, FileEnds, FileRole, Look, START_BYTES, look, look_at_whole};
pub use mesh::{Polygons, decode_mesh};
pub use photograph::{Sheet, decode_linear_image, decode_photograph};
pub use place::{Decoded, MeshFacts};
pub use relative::RelativeEnds;
