//! A run's folder or bucket: what it holds, under which names, and what its records say.
//!
//! A run directory is the only state. Starting, resuming and recovering are the same thing: look at what is there, do what
//! is missing.

// What is stored, under which names.
pub mod keys;

mod span;

mod open;

mod error;

// Records of the run and of its workers.
mod control;

mod attempts;
mod events;
mod provenance;
mod quarantine;
mod work_log;

// What is done.
mod done;
mod snapshot;

// What users ask.
mod explain;
mod retry;

mod compare;

mod audit;
mod planning;
#[cfg(feature = "train")]
mod tuples;

pub use attempts::{
    ATTEMPT_SCHEMA, AttemptRecord, EndKind, Ending, MOST_LOST, WorkerName, attempts,
};
pub(crate) use attempts::{PoisonCheck, is_unreadable, mark_lost, poison_check};
pub use audit::{AuditOptions, SceneAudit, Verdict, audit_scene, check_auditor, draw_scenes};
pub use compare::FileDifference;
pub use control::{CONTROL_SCHEMA, Changed, Control, ControlError, ControlState, set_control};
pub(crate) use control::{ControlFlag, ControlLook};
pub(crate) use done::is_done;
pub use error::AccessError;
pub(crate) use events::Stopwatch;
pub use events::{Event, StageSeconds, process_cpu_s};
pub use explain::{ExplainError, Explanation, ShardFacts, explain};
pub use open::{Run, RunError};
pub use planning::{PlanError, PlanOptions, Planned, plan_run};
pub use provenance::Provenance;
pub(crate) use provenance::{PartialsProvenance, other_workers};
pub use quarantine::{QUARANTINE_SCHEMA, QuarantineRecord};
pub use retry::{Retried, RetryError, RetryScenes, retry};
pub use snapshot::{
    Counts, Quarantined, RunState, SceneState, Scope, SeenAttempt, SeenTuple, Snapshot,
    StandingAttempt, Status, WorkerTuples,
};
pub use span::Span;
pub(crate) use work_log::{LogTime, SceneSeconds};
pub use work_log::{SceneTrace, Stop, WORK_LOG_SCHEMA, WorkLog, read_logs};
