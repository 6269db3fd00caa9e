//! Exit codes, as scripts and schedulers rely on them.

use std::process::ExitCode;

/// How the program ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// 0: done.
    Done,
    /// 1: failed (disk full, no permission, ...).
    Failed,
    /// 2: the command line is wrong.
    Usage,
    /// 3: finished, with quarantined or missing work.
    Incomplete,
    /// 4: the recipe, manifest or scene is wrong.
    InvalidInput,
    /// 5: the run directory disagrees with the recipe, the program's version or the machine.
    Disagrees,
    /// 75: not finished, try again (time limit, run in use): `EX_TEMPFAIL`.
    TryAgain,
    /// 130: interrupted (SIGINT).
    Interrupted,
    /// 143: terminated (SIGTERM), after the shards in flight.
    Terminated,
}

impl Exit {
    pub fn code(self) -> u8 {
        match self {
            Self::Done => 0,
            Self::Failed => 1,
            Self::Usage => 2,
            Self::Incomplete => 3,
            Self::InvalidInput => 4,
            Self::Disagrees => 5,
            Self::TryAgain => 75,
            Self::Interrupted => 130,
            Self::Terminated => 143,
        }
    }
}

impl Exit {
    /// Ends the program here: for a thread that hangs and cannot be stopped otherwise.
    #[allow(clippy::exit, reason = "this is the place where it is decided")]
    pub(super) fn now(self) -> ! {
        std::process::exit(self.code().into())
    }
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit.code())
    }
}

/// An error with its exit code.
#[derive(Debug)]
pub(super) struct Failure {
    pub(super) exit: Exit,
    pub(super) error: anyhow::Error,
    /// More of it for the object of --json.
    pub(super) details: serde_json::Map<String, serde_json::Value>,
}

impl Failure {
    /// An error that ends the program with `exit`.
    pub(super) fn new(exit: Exit, error: impl Into<anyhow::Error>) -> Self {
        Self { exit, error: error.into(), details: serde_json::Map::new() }
    }
}

impl Failure {
    /// What happened, in one line: each cause once. The library's errors hold their causes in their own text.
    pub(super) fn text(&self) -> String {
        let mut text = String::new();
        for cause in self.error.chain().map(ToString::to_string) {
            if !text.contains(&cause) {
                if !text.is_empty() {
                    text += ": ";
                }
                text += &cause;
            }
        }
        text
    }
}

impl From<crate::run::RunError> for Failure {
    fn from(error: crate::run::RunError) -> Self {
        use crate::run::RunError as E;
        let exit = match error {
            E::Missing { .. } | E::Manifest { .. } | E::Root(_) => Exit::InvalidInput,
            E::Spec { .. } | E::Disagrees { .. } => Exit::Disagrees,
            E::Busy { .. } => Exit::TryAgain,
            E::Read { .. } => Exit::Failed,
        };
        Self::new(exit, error)
    }
}

impl From<crate::farm::FarmError> for Failure {
    fn from(error: crate::farm::FarmError) -> Self {
        use crate::farm::FarmError as E;
        match error {
            E::Access(error) => error.into(),
            E::Queue(_) | E::Sandbox(_) => Self::new(Exit::Failed, error),
        }
    }
}

impl From<crate::run::AccessError> for Failure {
    fn from(error: crate::run::AccessError) -> Self {
        use crate::run::AccessError as E;
        match error {
            E::Run(error) => error.into(),
            E::Golden { .. } => Self::new(Exit::Disagrees, error),
            E::Store(error) => error.into(),
            E::Write(_) | E::Tuple(_) => Self::new(Exit::Failed, error),
        }
    }
}

/// A [`StoreError`](crate::store::StoreError) that passed through a crate which does not know stores.
fn from_boxed(error: Box<dyn std::error::Error + Send + Sync>) -> Failure {
    match error.downcast::<crate::store::StoreError>() {
        Ok(error) => (*error).into(),
        Err(error) => Failure::new(Exit::Failed, anyhow::Error::from_boxed(error)),
    }
}

#[cfg(feature = "train")]
impl From<train::TupleFilesError> for Failure {
    fn from(error: train::TupleFilesError) -> Self {
        from_boxed(error.0)
    }
}

impl From<plan::DraftError> for Failure {
    fn from(error: plan::DraftError) -> Self {
        use plan::DraftError as E;
        match error {
            E::Store(error) => from_boxed(error.0),
            E::Invalid { ref invalid, .. } => {
                let invalid = serde_json::json!(invalid);
                let mut failure = Self::new(Exit::InvalidInput, error);
                failure.details.insert("invalid".to_owned(), invalid);
                failure
            }
            _ => Self::new(Exit::InvalidInput, error),
        }
    }
}

impl From<crate::run::ControlError> for Failure {
    fn from(error: crate::run::ControlError) -> Self {
        use crate::run::ControlError as E;
        match error {
            E::Store(error) => error.into(),
            E::Finished | E::Cancelled => Self::new(Exit::Failed, error),
        }
    }
}

impl From<crate::run::ExplainError> for Failure {
    fn from(error: crate::run::ExplainError) -> Self {
        use crate::run::ExplainError as E;
        match error {
            E::Access(error) => error.into(),
            E::Unknown(_) => Self::new(Exit::Usage, error),
        }
    }
}

impl From<crate::run::RetryError> for Failure {
    fn from(error: crate::run::RetryError) -> Self {
        use crate::run::RetryError as E;
        match error {
            E::Store(error) => error.into(),
            E::Refused(_) => Self::new(Exit::Usage, error),
        }
    }
}

impl From<crate::run::PlanError> for Failure {
    fn from(error: crate::run::PlanError) -> Self {
        use crate::run::PlanError as E;
        match error {
            E::Draft(error) => error.into(),
            E::Run(error) => error.into(),
            E::Mismatch(_) => Self::new(Exit::Disagrees, error),
            E::Write(_) | E::Sample(_) => Self::new(Exit::Failed, error),
        }
    }
}

impl From<crate::export::ExportError> for Failure {
    fn from(error: crate::export::ExportError) -> Self {
        use crate::export::ExportError as E;
        let exit = match error {
            E::Store(error) => return error.into(),
            E::Run(error) => return error.into(),
            E::Request(_) => Exit::Usage,
            E::Unfinished { .. } | E::Busy { .. } => Exit::TryAgain,
            E::Nothing(_) => Exit::InvalidInput,
            E::Foreign { .. } => Exit::Disagrees,
            E::Write(_) | E::Read { .. } | E::Damaged { .. } | E::Encode { .. } => Exit::Failed,
        };
        Self::new(exit, error)
    }
}

impl From<compose::EvaluateError> for Failure {
    fn from(error: compose::EvaluateError) -> Self {
        use compose::EvaluateError as E;
        match error {
            E::Subject(error) => from_boxed(error),
            error => Self::new(Exit::Failed, error),
        }
    }
}

#[cfg(feature = "train")]
impl From<train::TrainError> for Failure {
    fn from(error: train::TrainError) -> Self {
        use train::ExampleError as X;
        use train::TrainError as E;
        let error = match error {
            E::Tuples(error) => return from_boxed(error.0),
            error => error,
        };
        let exit = match &error {
            E::Busy { .. } => Exit::TryAgain,
            E::Setting(_) | E::NoRealPairs { .. } => Exit::Usage,
            E::Frozen { .. } | E::OtherOrigin { .. } => Exit::Disagrees,
            E::NoBacktrack { .. }
            | E::Features(_)
            | E::Example(X::Unusable { .. } | X::None(_)) => Exit::InvalidInput,
            E::Lock { .. }
            | E::Example(_)
            | E::Checkpoint(_)
            | E::Write(_)
            | E::Tensor(_)
            | E::Tuples(_)
            | E::NotFinite { .. } => Exit::Failed,
        };
        let differences = match &error {
            E::Frozen { differences, .. } => Some(serde_json::json!(differences)),
            _ => None,
        };
        let mut failure = Self::new(exit, error);
        let details = differences.map(|list| ("differences".to_owned(), list));
        failure.details.extend(details);
        failure
    }
}

impl From<render::atomic_file::WriteError> for Failure {
    fn from(error: render::atomic_file::WriteError) -> Self {
        Self::new(Exit::Failed, error)
    }
}

impl From<crate::report::ReportError> for Failure {
    fn from(error: crate::report::ReportError) -> Self {
        match error {
            crate::report::ReportError::Store(error) => error.into(),
            error @ crate::report::ReportError::Write(_) => Self::new(Exit::Failed, error),
        }
    }
}

impl From<crate::store::StoreError> for Failure {
    fn from(error: crate::store::StoreError) -> Self {
        let exit = match error {
            crate::store::StoreError::Address { .. } => Exit::Usage,
            ref error if error.is_passing() => Exit::TryAgain,
            _ => Exit::Failed,
        };
        Self::new(exit, error)
    }
}

impl From<crate::farm::queue::QueueError> for Failure {
    fn from(error: crate::farm::queue::QueueError) -> Self {
        Self::new(Exit::Usage, error)
    }
}

impl From<render::line::RootError> for Failure {
    fn from(error: render::line::RootError) -> Self {
        Self::new(Exit::Usage, error)
    }
}
