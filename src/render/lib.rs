//! A scene line and its files become four exact images: everything from decoding photographs to writing tuples.
//!
//! ```text
//! line -> formats -> scene -> trace -> shard, partial -> merge        job, Loaded: all of it for one scene, in memory
//! (what)  (bytes)    (sheets) (rays)   (work, on disk)   (tuples)     layer, color, hash: shared by all
//! ```
//!
//! No clock, no environment variable, no asynchronous runtime and no command line: a pixel follows from the line and the bytes
//! of its files.

pub mod atomic_file;
mod bands;
pub mod color;
pub mod formats;
pub mod hash;
pub mod ids;
pub mod job;
pub mod layer;
pub mod line;
mod loaded;
pub mod merge;
pub mod partial;
pub mod scene;
pub mod shard;
pub mod trace;

pub use loaded::Loaded;
