//! The farm: workers, the queue, the coordinator, and recovery from failures.
//!
//! Only the run's store holds lasting state, so starting, resuming and recovering are the same operation: find the
//! missing results and make them. A scene goes through `files -> shards -> partials -> tuple`. Each step writes whole
//! files or none, so a process may be killed at any time.

mod coordinator;
mod error;
mod fault;
mod merge_run;
mod message;
pub mod queue;
mod round;
mod share;
pub mod simulate;
mod stall;
mod sweep;
mod tuples;
mod worker;

pub use coordinator::{CoordinateOptions, Coordinated, Watch, coordinate};
pub use error::FarmError;
pub use fault::Fault;
pub use merge_run::{MergeOutcome, merge_run};
pub use worker::{Outcome, Sandbox, SandboxEnd, SharedQueue, WorkOptions, work, work_shared};
