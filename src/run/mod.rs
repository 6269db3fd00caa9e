//! A run's folder or bucket: what it holds, under which names, and what its records say.
//!
//! A run directory is the only state. Starting, resuming and recovering are the same thing: look at what is there, do what
//! is missing.

pub mod keys;

mod attempts;
mod audit;
mod compare;
mod control;
mod done;
mod error;
mod events;
mod explain;
mod made_by;
mod open;
mod overview;
mod planning;
mod provenance;
mod quarantine;
mod retry;
mod seen;
mod span;
mod status;
#[cfg(feature = "train")]
mod tuples;
mod work_log;

pub use attempts::{
    ATTEMPT_SCHEMA, AttemptRecord, EndKind, Ending, MOST_LOST, WorkerName, attempts,
};
pub(crate) use attempts::{PoisonCheck, is_unreadable, mark_lost, poison_check};
pub use audit::{AuditOptions, SceneAudit, Verdict, audit_scene, check_auditor, draw_scenes};
pub use compare::FileDifference;
pub use control::{CONTROL_SCHEMA, Changed, Control, ControlError, ControlState, set_control};
pub(crate) use control::{ControlFlag, ControlLook};
pub use done::Progress;
pub(crate) use done::is_done;
pub use error::AccessError;
pub(crate) use events::Stopwatch;
pub use events::{Event, StageSeconds, process_cpu_s};
pub use explain::{ExplainError, Explanation, SceneState, ShardFacts, explain};
pub(crate) use made_by::{MadeBy, who_else};
pub use open::{Run, RunDir, RunError};
pub use overview::{FarmState, Observer, Overview, StandingAttempt, WorkerTuples};
pub use planning::{PlanError, PlanOptions, Planned, plan_run};
pub use provenance::Receipt;
pub use quarantine::{QUARANTINE_SCHEMA, QuarantineRecord};
pub use retry::{Retried, RetryError, RetryScenes, retry};
pub use seen::{SeenAttempt, SeenTuple, Watch};
pub(crate) use seen::{see_attempts, see_tuples};
pub use span::Span;
pub use status::{Quarantined, RunStatus, run_status};
pub(crate) use work_log::{LogTime, SceneSeconds};
pub use work_log::{SceneTrace, Stop, WORK_LOG_SCHEMA, WorkLog, read_logs};
