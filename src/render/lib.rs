//! Renders a scene line and its files to up to four images, from the decoding of photographs to the writing of tuples.
//!
//! ```text
//! formats -> scene -> trace -> shard, partial -> merge        job, Loaded: all steps for one scene, in memory
//! (files)    (sheets) (rays)   (units of work)   (tuples)     a scene line: the crate glasshouse_line
//! ```
//!
//! Uses no clock, environment variable, asynchronous runtime or command line: a pixel depends only on the line and the
//! bytes of its files.

pub mod atomic_file;
mod bands;
pub mod disk;
pub mod file_tree;
pub mod folder_lock;
pub mod formats;
pub mod input_file;
pub mod job;
mod loaded;
pub mod merge;
pub mod partial;
pub mod path_text;
pub mod scene;
pub mod shard;
mod threads;
pub mod trace;

pub use loaded::Loaded;
pub use scene::prepare;
