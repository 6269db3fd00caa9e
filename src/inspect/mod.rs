//! What a file is, which scene it belongs to, and whether it is whole: `glasshouse inspect`.
//!
//! A path is a file or a folder; a file's kind follows from its first bytes, and each kind has a reader. Small files have one
//! generic path (`record` and `lists`: checked by the type of their schema, shown as a table); partials, tuples, scene
//! lines, checkpoints, archives and runs have readers of their own. The groups of modules stand in the order in which each
//! uses those before it.
//!
//! Readers take bytes (or a stream) and give facts; only `file` and `folder` touch the disk. Hostile bytes become a
//! [`Problem`], never a panic, and no header's number is believed before it is checked against the file's length.

// What is known of a file.
mod kind;

mod facts;
mod input;

// Every record is read alike.
mod digests;
mod record;

mod exr;
mod lists;
mod picture;
#[cfg(feature = "train")]
mod tensors;

// Readers of their own.
mod archive;
mod checkpoint;
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
