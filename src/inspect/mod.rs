//! `glasshouse inspect`: recognises files and checks whether they are intact.
//!
//! A path is a file or a folder. Each kind of file has a reader. Small files share the generic readers
//! `record` and `lists`, which check the type and show keys or columns; partials, tuples, scene lines, images, tensors,
//! archives and runs have special readers. Each group of modules uses only itself and groups above it.
//!
//! Readers take bytes (or a stream) and return facts; only `file` and `folder` access the disk. Hostile bytes become a
//! [`Problem`], never a panic, and the sizes in a header are checked before memory is allocated for them.

mod kind;

mod facts;
mod input;

mod digests;
mod record;

mod exr;
mod lists;
mod picture;
#[cfg(feature = "train")]
mod tensors;

mod archive;
mod manifest;
mod partial;
mod tuple;
mod tuple_shard;

mod bytes;
mod file;
mod folder;

pub use bytes::inspect_bytes;
pub use facts::{Facts, Inspection, Problem, Whole};
pub use folder::inspect_path;
pub use input::Input;
pub use kind::Kind;
