//! A run's tuples as a data set in the forms that loaders know.
//!
//! ```text
//! request.rs   what is asked for: export.json          plan.rs      which scenes, in which order
//! folder.rs    whose folder it is, what is done        sample.rs    a tuple -> names and bytes
//! write.rs     all tuples, on all threads, in order    part.rs      some of them, durable: shard.rs, digest.rs
//! finish.rs    metadata.rs, card.rs, croissant.rs, SHA256SUMS
//! ```
//!
//! An export's bytes follow from the run's manifest and the request: no time, host, path or number of threads is in them.
//! It is made part by part; a process that is killed and started again goes on after the last part that is done, and ends
//! with the same bytes. `SHA256SUMS` is written last. Two batches of tuples are in memory, whatever the run's size.

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
mod write;

pub use error::ExportError;
pub use folder::{FolderState, look};
pub use plan::{ExportOptions, ExportPlan, LeftOut};
pub use request::{EXPORT_REQUEST_SCHEMA, ExportFormat, ExportRequest, PixelEncoding};
pub use write::{ExportWork, Exported, export, foretell_bytes};
