//! A run's folder or bucket: what it holds, under which names, and what its records say.
//!
//! A run directory is the only state. Starting, resuming and recovering are the same thing: look at what is there, do what
//! is missing.

pub(crate) mod attempts;
pub(crate) mod audit;
pub(crate) mod compare;
pub(crate) mod control;
pub(crate) mod done;
pub(crate) mod error;
pub(crate) mod events;
pub(crate) mod explain;
pub mod keys;
pub(crate) mod made_by;
pub(crate) mod overview;
pub(crate) mod planning;
pub(crate) mod quarantine;
pub(crate) mod receipt;
pub(crate) mod retry;
pub(crate) mod run_dir;
pub(crate) mod seen;
pub(crate) mod status;
pub(crate) mod task;
#[cfg(feature = "train")]
pub(crate) mod tuple_files;
pub(crate) mod work_log;

pub use attempts::{
    ATTEMPT_SCHEMA, AttemptRecord, EndKind, Ending, MOST_LOST, WorkerName, attempts,
};
pub use audit::{AuditOptions, SceneAudit, Verdict, audit_scene, check_auditor, draw_scenes};
pub use compare::FileDifference;
pub use control::{CONTROL_SCHEMA, Changed, Control, ControlError, ControlState, set_control};
pub use done::Progress;
pub use error::AccessError;
pub use events::{Event, StageSeconds, process_cpu_s};
pub use explain::{ExplainError, Explanation, SceneState, ShardFacts, explain};
pub use overview::{FarmState, Observer, Overview, StandingAttempt, WorkerTuples};
pub use planning::{PlanError, PlanOptions, Planned, plan_run};
pub use quarantine::{QUARANTINE_SCHEMA, QuarantineRecord};
pub use receipt::Receipt;
pub use retry::{Retried, RetryError, RetryScenes, retry};
pub use run_dir::{Run, RunDir, RunError};
pub use seen::{SeenAttempt, SeenTuple, Watch};
pub use status::{Quarantined, RunStatus, run_status};
pub use task::Task;
pub use work_log::{SceneTrace, Stop, WORK_LOG_SCHEMA, WorkLog, read_logs};
