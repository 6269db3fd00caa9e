//! Who traces which shard, when, and what happens when something breaks.
//!
//! A run directory is the only state. Starting, resuming and recovering are the same thing: look at what is
//! there, do what is missing. A scene goes through `files -> shards -> partials -> tuple`; each arrow writes
//! whole files or nothing, so a process may be killed at any instruction.

mod attempts;
mod audit;
mod bands;
mod check;
mod compare;
mod conflict;
mod content;
mod control;
mod coordinate;
mod done;
mod error;
mod events;
mod explain;
mod fault;
mod finished;
mod hand;
mod held;
mod intake;
mod job;
pub mod keys;
mod leases;
mod look;
mod made_by;
mod make;
mod merge_run;
mod message;
mod open_span;
mod overview;
mod plan;
mod quarantine;
pub mod queue;
mod receipt;
mod retry;
mod run_dir;
mod sample_bytes;
mod seen;
mod share;
mod shared;
pub mod sim;
mod span;
mod status;
mod suspect;
mod sweep;
mod watch;
mod work;
mod work_log;
mod worker;
mod writer;

pub use attempts::{
    ATTEMPT_SCHEMA, AttemptRecord, EndKind, Ending, MOST_LOST, WorkerName, attempts,
};
pub use audit::{AuditOptions, SceneAudit, Verdict, audit_scene, check_auditor, draw_scenes};
pub use check::InvalidInput;
pub use compare::FileDifference;
pub use control::{CONTROL_SCHEMA, Changed, Control, ControlError, ControlState, set_control};
pub use coordinate::{CoordinateOptions, Coordinated, coordinate};
pub use done::Progress;
pub use error::FarmError;
pub use events::{Event, StageSeconds, process_cpu_s};
pub use explain::{ExplainError, Explanation, SceneState, ShardFacts, explain};
pub use fault::Fault;
pub use job::{SceneJob, render_partials};
pub use look::{RejectedScene, read_rejected};
pub use merge_run::{MergeOutcome, merge_run};
pub use overview::{Observer, Overview, StandingAttempt, WorkerTuples};
pub use plan::{PlanError, PlanOptions, Planned, plan};
pub use quarantine::{QUARANTINE_SCHEMA, QuarantineRecord};
pub use receipt::Receipt;
pub use retry::{Retried, RetryError, RetryScenes, retry};
pub use run_dir::{Run, RunDir, RunError};
pub use seen::{SeenAttempt, SeenTuple, Watch};
pub use span::{HeldSpan, Span, uncovered, what_to_give};
pub use status::{Quarantined, RunStatus, run_status};
pub use suspect::{Isolate, IsolatedEnd};
pub use watch::WatchedRun;
pub use work::{Outcome, SharedQueue, Stop, WorkOptions, work, work_shared, work_span};
pub use work_log::{SceneTrace, WORK_LOG_SCHEMA, WorkLog, read_logs};
