//! Who traces which shard, when, and what happens when something breaks.
//!
//! A run directory is the only state. Starting, resuming and recovering are the same thing: look at what is
//! there, do what is missing. A scene goes through `files -> shards -> partials -> tuple`; each arrow writes
//! whole files or nothing, so a process may be killed at any instruction.

mod coordinator;
mod error;
mod fault;
mod merge_run;
mod message;
pub mod queue;
mod round;
mod share;
pub mod simulate;
mod sweep;
mod tuples;
mod worker;

pub use coordinator::{CoordinateOptions, Coordinated, Watch, coordinate};
pub use error::FarmError;
pub use fault::Fault;
pub use merge_run::{MergeOutcome, merge_run};
pub use worker::{
    Outcome, Sandbox, SandboxEnd, SharedQueue, WorkOptions, work, work_shared, work_span,
};
