//! The examples of every training step, as a function of the settings, the seed and the step.
//!
//! ```text
//! source (tuples, photographs, pairs), shards -> example_sampler (order, crops) -> loader (reads ahead)
//!                                         `-> composing (composed in linear light), mixture (mixed in image space)
//! ```
//!
//! This crate contains no networks, so that trainers of other programs can use it.

mod composing;
mod digest;
mod example;
mod example_sampler;
mod loader;
pub mod mixture;
mod picture;
mod shards;
mod source;
mod srgb_planes;
mod subject;

pub use digest::{digest_of, scenes_digest};
pub use example::{Example, Planes};
pub use example_sampler::{ExampleSampler, SceneSource};
pub use loader::Loader;
pub use picture::Picture;
pub use shards::ShardSource;
pub use source::{
    Base, ExampleError, PairSource, PhotographSource, TupleFiles, TupleFilesError, TupleSource,
};
pub use srgb_planes::{bytes_of_planes, planes_of_bytes, planes_of_linear};
