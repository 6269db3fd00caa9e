//! `pause RUN`, `resume RUN`, `cancel RUN`: set or remove the run's control object.

use crate::cli::args::{Global, StoreArgs};
use crate::cli::exit_code::{Exit, Failure};
use crate::cli::output::Output;
use crate::cli::target;
use crate::run::{ControlState, set_control};
use clap::Args as ClapArgs;
use glasshouse_line::Roots;
use serde::Serialize;
use std::borrow::Cow;
use std::fmt;
use std::path::{Path, PathBuf};

/// Arguments of `pause` and `cancel`.
#[derive(Debug, ClapArgs)]
pub(super) struct HoldArgs {
    /// Folder of the run
    run: PathBuf,
    /// Reason to show in workers, coordinator and status
    #[arg(long, value_name = "TEXT")]
    reason: Option<String>,
    #[command(flatten)]
    store: StoreArgs,
}

#[derive(Debug, ClapArgs)]
pub(super) struct ResumeArgs {
    /// Folder of the run
    run: PathBuf,
    #[command(flatten)]
    store: StoreArgs,
}

pub(super) fn pause(args: &HoldArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let (store, reason) = (args.store.store.as_deref(), args.reason.as_deref());
    tell(&args.run, store, ControlState::Paused, reason, global, output)
}

pub(super) fn cancel(args: &HoldArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let (store, reason) = (args.store.store.as_deref(), args.reason.as_deref());
    tell(&args.run, store, ControlState::Cancelled, reason, global, output)
}

pub(super) fn resume(args: &ResumeArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let store = args.store.store.as_deref();
    tell(&args.run, store, ControlState::Running, None, global, output)
}

fn tell(
    folder: &Path,
    store: Option<&str>,
    state: ControlState,
    reason: Option<&str>,
    global: &Global,
    output: &Output,
) -> Result<Exit, Failure> {
    let (run, store) = target::open(folder, store, &Roots::default())?;
    let before = set_control(&store, state, reason, global.dry_run)?;
    let command = match state {
        ControlState::Running => "resume",
        ControlState::Paused => "pause",
        ControlState::Cancelled => "cancel",
    };
    let told = Told {
        run: folder.to_string_lossy(),
        dry_run: global.dry_run,
        before,
        state,
        reason,
        name: &run.spec.name,
    };
    output.show(&format!("glasshouse.{command}/1"), &told);
    Ok(Exit::Done)
}

#[derive(Serialize)]
struct Told<'a> {
    run: Cow<'a, str>,
    dry_run: bool,
    before: ControlState,
    state: ControlState,
    reason: Option<&'a str>,
    #[serde(skip)]
    name: &'a str,
}

impl fmt::Display for Told<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = self.name;
        let would = if self.dry_run { "would be" } else { "is" };
        match (self.before, self.state) {
            (ControlState::Running, ControlState::Running) => {
                write!(f, "{name} was neither paused nor cancelled: nothing to resume")
            }
            (ControlState::Cancelled, ControlState::Running) => write!(
                f,
                "{name} {would} no longer cancelled: start `glasshouse work` (and `coordinate`) again to continue it"
            ),
            (_, ControlState::Running) => {
                write!(f, "{name} {would} resumed: workers notice within seconds")
            }
            (_, ControlState::Paused) => write!(
                f,
                "{name} {would} paused: workers notice within seconds, finish the scenes they have opened and wait; \
                 `glasshouse resume` continues the run"
            ),
            (_, ControlState::Cancelled) => write!(
                f,
                "{name} {would} cancelled: workers end after the shards in flight, with exit code {}; finished tuples stay, and \
                 `glasshouse resume` undoes the cancel",
                Exit::Incomplete.code()
            ),
        }
    }
}
