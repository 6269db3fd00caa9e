//! Stage 3: the files of a manifest line become sheets of radiance and inverse depth (or meshes), in metres.
//!
//! Everything here is pure: the caller reads the files, this module reads their bytes. A
//! photograph goes through these files, in this order:
//!
//! ```text
//! files (format by magic bytes) -> npy | openexr | raster -> depth, mask, color (transfer)
//!                                                      -> fill, center -> photograph (Sheet)
//! ```
//!
//! a panorama through `window` (what the film sees of it) and `equirect` to `panorama` (Sheet),
//! and a mesh through `ply_header`, `ply`, `transfer` to `mesh` (Polygons); `assemble` takes either. Who checks many files has
//! `look`, which reads little more than their headers.
//!
//! Hostile bytes end in a [`SceneError`], never in a panic, and sizes are checked before anything
//! of that size is allocated ([`limits`]). A sheet's bits are a function of the bytes and the
//! manifest line: one thread, a fixed order, and [`libm`] for powers and angles.

mod assemble;
mod center;
mod color;
mod depth;
mod equirect;
mod fill;
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
mod transfer;
mod window;

pub use assemble::{AssembleError, OrderFact, SceneFacts, Sides, assemble};
pub use load::{
    DecodedScene, InputDigests, LoadError, LoadedScene, SceneFiles, SideFiles, decode, load,
    read_files, read_files_by,
};
pub use look::{END_BYTES, FileEnds, FileRole, Look, START_BYTES, look, look_at_whole};
pub use mesh::{Polygons, decode_mesh};
pub use near::MAX_TOO_NEAR_SHARE;
pub use photograph::{Sheet, decode_linear_image, decode_photograph};
pub use place::{Decoded, MeshFacts, MeshSides};
pub use relative::{RelativeEnds, RelativeSides};
