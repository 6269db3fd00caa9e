//! A scene line and its files become four exact images: everything from decoding photographs to writing tuples.
//!
//! ```text
//! line -> formats -> scene -> trace -> shard, partial -> merge        job: all of it for one scene, in memory
//! (what)  (bytes)    (sheets) (rays)   (work, on disk)   (tuples)
//! ```
//!
//! No clock, no environment variable, no asynchronous runtime and no command line: a pixel follows from the line and the bytes
//! of its files.

pub mod atomic_file;
mod bands;
pub mod formats;
pub mod ids;
pub mod job;
pub mod line;
pub mod merge;
pub mod partial;
pub mod scene;
pub mod shard;
pub mod trace;
