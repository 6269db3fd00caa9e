//! Who traces which shard, when, and what happens when something breaks.
//!
//! A run directory is the only state. Starting, resuming and recovering are the same thing: look at what is
//! there, do what is missing. A scene goes through `files -> shards -> partials -> tuple`; each arrow writes
//! whole files or nothing, so a process may be killed at any instruction.

mod conflict;
mod control;
mod coordinate;
mod error;
mod fault;
mod finished;
mod hand;
mod held;
mod intake;
mod leases;
mod merge_run;
mod message;
mod open_span;
pub mod queue;
mod share;
mod shared;
pub mod sim;
mod span;
mod suspect;
mod sweep;
mod work;
mod work_log;
mod worker;
mod writer;

pub use coordinate::{CoordinateOptions, Coordinated, coordinate};
pub use error::FarmError;
pub use fault::Fault;
pub use merge_run::{MergeOutcome, merge_run};
pub use span::{HeldSpan, uncovered, what_to_give};
pub use suspect::{Isolate, IsolatedEnd};
pub use work::{Outcome, SharedQueue, WorkOptions, work, work_shared, work_span};
