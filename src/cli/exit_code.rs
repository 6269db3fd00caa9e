//! Exit codes, on which scripts and schedulers rely.

use std::process::ExitCode;

/// Result of the program, with its exit code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// 0: success.
    Done,
    /// 1: failure (disk full, no permission, ...).
    Failed,
    /// 2: the command line is invalid.
    Usage,
    /// 3: finished with scenes in quarantine or missing results, or cancelled.
    Incomplete,
    /// 4: an input (recipe, manifest, scene, picture, ...) is missing or invalid.
    InvalidInput,
    /// 5: an existing run, export or checkpoint disagrees with the command, the program's version or the machine.
    Disagrees,
    /// 75 (`EX_TEMPFAIL`): not finished; a later attempt may succeed (time limit, run in use, store unavailable, ...).
    TryAgain,
    /// 130: interrupted (SIGINT).
    Interrupted,
    /// 143: terminated (SIGTERM).
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

    /// Ends the program at once, because nothing else stops a thread that hangs.
    #[allow(clippy::exit, reason = "the only place that exits")]
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
    /// Further fields of the error object that --json prints.
    pub(super) details: serde_json::Map<String, serde_json::Value>,
}

impl Failure {
    /// Returns an error that ends the program with `exit`.
    pub(super) fn new(exit: Exit, error: impl Into<anyhow::Error>) -> Self {
        Self { exit, error: error.into(), details: serde_json::Map::new() }
    }

    /// Joins the messages of the error and its causes, except for causes that an earlier message already contains.
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

/// Makes a [`Failure`] with an exit code and a formatted message: `failure!(exit, "format", ...)`.
macro_rules! failure {
    ($exit:expr, $($text:tt)+) => {
        $crate::cli::exit_code::Failure::new($exit, anyhow::anyhow!($($text)+))
    };
}
pub(super) use failure;

/// Maps an error's variants to exit codes. A variant that only wraps another error has that error's code.
macro_rules! exit_codes {
    ($($error:ty {
        $(($($wrapper:ident)|+) => its_own,)?
        $($($variant:ident)|+ => $exit:ident,)*
        $(_ => $other:ident,)?
    })+) => {$(
        impl From<$error> for $crate::cli::exit_code::Failure {
            #[allow(clippy::match_single_binding, dead_code, reason = "some errors have one code")]
            fn from(error: $error) -> Self {
                type E = $error;
                let exit = match error {
                    $($(E::$wrapper(error) => return error.into(),)+)?
                    $($(E::$variant { .. })|+ => $crate::cli::exit_code::Exit::$exit,)*
                    $(_ => $crate::cli::exit_code::Exit::$other,)?
                };
                Self::new(exit, error)
            }
        }
    )+};
}
pub(super) use exit_codes;

exit_codes! {
    crate::run::RunError {
        Missing | Manifest | Root => InvalidInput,
        Spec | Disagrees => Disagrees,
        Busy => TryAgain,
        Changed | Read | Disk => Failed,
    }
    crate::run::AccessError {
        (Run | Store) => its_own,
        Golden => Disagrees,
        Write | Tuple => Failed,
    }
    crate::run::ControlError {
        (Store) => its_own,
        Finished | Cancelled => Failed,
    }
    crate::run::ExplainError {
        (Access) => its_own,
        Unknown => Usage,
    }
    crate::run::RetryError {
        (Store) => its_own,
        Refused => Usage,
    }
    crate::run::PlanError {
        (Draft | Run) => its_own,
        Mismatch => Disagrees,
        Foreign | Tile => Usage,
        Write | Sample => Failed,
    }
    crate::farm::FarmError {
        (Access) => its_own,
        NoInputs => InvalidInput,
        Queue | Sandbox | Threads => Failed,
    }
    crate::farm::queue::QueueError {
        _ => Usage,
    }
    crate::made::MadeError {
        (Store) => its_own,
        Read => Failed,
    }
    crate::export::ExportError {
        (Store | Run | Made) => its_own,
        Request => Usage,
        Unfinished | Busy => TryAgain,
        Nothing => InvalidInput,
        Foreign => Disagrees,
        Moved | Write | Read | Damaged | Encode => Failed,
    }
    crate::develop::DevelopError {
        (Store | Run | Made) => its_own,
        Foreign => Disagrees,
        Threads | Write | Read | Damaged | NoInput | Encode | Link => Failed,
    }
    crate::outputs::OutputsError {
        (Write) => its_own,
        _ => Usage,
    }
    crate::report::ReportError {
        (Store) => its_own,
        Write => Failed,
    }
    render::atomic_file::WriteError {
        _ => Failed,
    }
    glasshouse_line::RootError {
        _ => Usage,
    }
}

/// Converts the error of a callback: a [`StoreError`](crate::store::StoreError) if the store failed, or a
/// `train::SeparatorError`.
fn from_boxed(error: Box<dyn std::error::Error + Send + Sync>) -> Failure {
    let error = match error.downcast::<crate::store::StoreError>() {
        Ok(error) => return (*error).into(),
        Err(error) => error,
    };
    #[cfg(feature = "train")]
    let error = match error.downcast::<train::SeparatorError>() {
        Ok(error) => return (*error).into(),
        Err(error) => error,
    };
    Failure::new(Exit::Failed, anyhow::Error::from_boxed(error))
}

#[cfg(feature = "train")]
impl From<train::SeparatorError> for Failure {
    fn from(error: train::SeparatorError) -> Self {
        let exit = match error {
            train::SeparatorError::OtherFeatures { .. } => Exit::Disagrees,
            _ => Exit::InvalidInput,
        };
        Self::new(exit, error)
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

impl From<compose::EvaluateError> for Failure {
    fn from(error: compose::EvaluateError) -> Self {
        use compose::EvaluateError as E;
        match error {
            E::Subject(error) | E::Method(error) => from_boxed(error),
            error => Self::new(Exit::InvalidInput, error),
        }
    }
}

#[cfg(feature = "train")]
impl From<train::TrainError> for Failure {
    fn from(error: train::TrainError) -> Self {
        use train::CheckpointError as C;
        use train::ExampleError as X;
        use train::TrainError as E;
        let error = match error {
            E::Tuples(error) => return from_boxed(error.0),
            error => error,
        };
        let exit = match &error {
            E::Busy { .. } => Exit::TryAgain,
            E::Setting(_) | E::NoRealPairs { .. } | E::NoBacktrackStage { .. } => Exit::Usage,
            E::Frozen { .. }
            | E::OtherOrigin { .. }
            | E::OtherTuples { .. }
            | E::ScheduleEnds { .. }
            | E::Example(X::Damaged { .. } | X::Export { .. }) => Exit::Disagrees,
            E::NoBacktrack { .. }
            | E::From { .. }
            | E::NothingToSelect { .. }
            | E::Features(_)
            | E::Checkpoint(C::Damaged { .. })
            | E::Example(X::Unusable { .. } | X::None(_)) => Exit::InvalidInput,
            E::Lock { .. }
            | E::Read { .. }
            | E::Moved { .. }
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
        failure.details.extend(differences.map(|list| ("differences".to_owned(), list)));
        failure
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
