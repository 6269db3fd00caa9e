//! Exports a run's tuples as a data set in formats of common loaders.
//!
//! ```text
//! request.rs   the request: export.json                plan.rs      selection and order of scenes
//! folder.rs    owner and state of the folder           sample.rs    a tuple -> names and bytes
//! write.rs     all tuples, on all threads, in order    part.rs      a durable part: shard.rs, digest.rs
//! tensors.rs   a tuple -> tensors               tensor_shard.rs   a part of tensors
//! finish.rs    metadata.rs, card.rs, croissant.rs, SHA256SUMS
//! ```
//!
//! The bytes of an export depend on the run's manifest and the request, not on time, host, paths or threads. An export
//! is written part by part; after a kill, the same command resumes after the last complete part and makes the same
//! bytes. It makes parts again whose tuples or files changed since (`stale.rs`). `SHA256SUMS` is written last. Memory holds two batches of tuples for a run of any size.

mod card;
mod card_numbers;
mod croissant;
mod digest;
mod error;
mod finish;
mod folder;
mod metadata;
mod part;
mod plan;
mod request;
mod sample;
mod shard;
mod stale;
mod tensor_shard;
mod tensors;
mod write;

pub use error::ExportError;
pub use folder::{FolderState, look};
pub use plan::{ExportOptions, ExportPlan, LeftOut};
pub use request::{EXPORT_REQUEST_SCHEMA, ExportFormat, ExportRequest, PixelEncoding};
pub use tensor_shard::TUPLES_SCHEMA;
pub use write::{ExportWork, Exported, estimate_bytes, export, look_again};
