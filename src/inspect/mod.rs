//! `glasshouse inspect`: recognises files and checks whether they are intact.
//!
//! A path is a file or a folder. A file's first bytes decide its kind, and each kind has a reader. Small files share a
//! generic reader (`record` and `lists`: checked by the type of their schema, shown as a table); partials, tuples,
//! scene lines, tensors, archives and runs have special readers. Each group of modules uses only groups above it.
//!
//! Readers take bytes (or a stream) and return facts; only `file` and `folder` access the disk. Hostile bytes become a
//! [`Problem`], never a panic, and every number in a header is checked against the file's length before it is used.

// Findings.
mod kind;

mod facts;
mod input;

// Generic readers.
mod digests;
mod record;

mod exr;
mod lists;
mod picture;
#[cfg(feature = "train")]
mod tensors;

// Special readers.
mod archive;
mod manifest;
mod partial;
mod tuple;

mod bytes;
mod file;
mod folder;

pub use bytes::inspect_bytes;
pub use facts::{Facts, Inspection, Problem, Whole};
pub use folder::inspect_path;
pub use input::Input;
pub use kind::Kind;
