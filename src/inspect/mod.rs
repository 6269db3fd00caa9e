//! What a file is, which scene it belongs to, and whether it is whole: `glasshouse inspect`.
//!
//! ```text
//! open (a path: file or folder) -> kind (by the first bytes) -> look (one reader a kind) -> facts
//!
//! exr, partial, tuple        images of the farm          spec, manifest, recipe, records   what a run is made of
//! checkpoint, tensors, events, table                      what a training leaves
//! archive, sums, page, picture, listing                   exports, reports, input files
//! folder                                                  a run, a tuple, a checkpoint as a whole
//! ```
//!
//! Readers take bytes (or a stream) and give facts; only `open` and `folder` touch the disk. Hostile bytes become a
//! [`Problem`], never a panic, and no header's number is believed before it is held against the file's length.

mod archive;
mod checkpoint;
#[cfg(feature = "train")]
mod events;
mod exr;
mod facts;
mod folder;
mod kind;
mod listing;
mod look;
mod manifest;
mod open;
mod page;
mod partial;
mod picture;
mod recipe;
mod records;
mod spec;
mod sums;
mod table;
#[cfg(feature = "train")]
mod tensors;
mod tuple;

pub use facts::{Facts, Inspection, Problem, Whole};
pub use kind::Kind;
pub use look::{Input, inspect_bytes};
pub use open::{MAX_WHOLE_BYTES, inspect_path};
