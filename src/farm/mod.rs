//! Who traces which shard, when, and what happens when something breaks.
//!
//! A run directory is the only state. Starting, resuming and recovering are the same thing: look at what is
//! there, do what is missing. A scene goes through `files -> shards -> partials -> tuple`; each arrow writes
//! whole files or nothing, so a process may be killed at any instruction.

mod bands;
mod events;
mod finished;
mod job;
mod local;
mod merge_run;
mod message;
mod plan;
mod quarantine;
pub mod queue;
mod run_dir;
mod span;
mod status;
mod sweep;
mod writer;

pub use events::{Event, StageSeconds};
pub use job::{SceneJob, render_partials};
pub use local::{FarmError, Outcome, Stop, WorkOptions, work};
pub use merge_run::{MergeOutcome, merge_run};
pub use plan::{PlanError, PlanOptions, Planned, plan};
pub use quarantine::{QUARANTINE_SCHEMA, QuarantineRecord};
pub use run_dir::{Run, RunDir, RunError};
pub use span::{HeldSpan, Span, what_to_give};
pub use status::{RunStatus, run_status};
