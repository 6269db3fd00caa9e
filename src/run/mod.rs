//! A run's folder or bucket: the keys of its objects, the records in them, and the run's progress.
//!
//! The store is the only state. Starting, resuming and recovering are the same operation: list the results and make
//! the missing ones. Modules import only modules above them.

mod error;
pub mod keys;
mod task;

// Records.
mod attempts;
mod control;
mod events;
mod open;
mod provenance;
mod quarantine;
mod stages;
mod work_log;

// Progress.
mod done;
mod snapshot;

// Commands.
mod compare;
mod explain;
mod planning;
mod retry;
#[cfg(feature = "train")]
mod tuples;

mod audit;

pub use attempts::{
    ATTEMPT_SCHEMA, AttemptRecord, EndKind, Ending, MOST_LOST, WorkerName, attempts,
};
pub(crate) use attempts::{
    PoisonCheck, SILENT_LEASES, Signed, are_presumed, attempts_with_times, evidence, forget,
    is_unreadable, mark_lost, poison_check, sign,
};
pub(crate) use audit::{
    AuditOptions, SceneAudit, Verdict, audit_scene, check_auditor, draw_scenes,
};
pub(crate) use compare::FileDifference;
pub(crate) use control::{CONTROL_SCHEMA, ControlError, ControlFlag, ControlPoll, set_control};
pub use control::{Control, ControlState};
pub(crate) use done::is_done;
pub use error::{AccessError, RunError};
pub use events::Event;
pub(crate) use explain::{ExplainError, Explanation, explain};
pub use open::Run;
pub use planning::PlanError;
pub(crate) use planning::{PlanOptions, Planned, plan_run};
pub use provenance::Provenance;
pub(crate) use provenance::{Makers, PartialsProvenance, other_workers};
pub use quarantine::{QUARANTINE_SCHEMA, QuarantineRecord};
pub use retry::{Retried, RetryError, RetryScenes, retry};
pub use snapshot::{
    Counts, Quarantined, RunState, SceneState, Scope, SeenAttempt, SeenTuple, SeenWorker, Snapshot,
    StandingAttempt, Status, WorkerTuples,
};
pub(crate) use stages::{Stage, Stopwatch};
pub use stages::{StageSeconds, process_cpu_s};
pub use task::Task;
pub use work_log::Stop;
pub(crate) use work_log::{LogTime, SceneSeconds, WORK_LOG_SCHEMA, WorkLog, read_logs};

/// Serializes a record as one line of JSON.
fn json_line(record: &impl serde::Serialize) -> Vec<u8> {
    let mut json = serde_json::to_vec(record).expect("strings and numbers are JSON");
    json.push(b'\n');
    json
}
