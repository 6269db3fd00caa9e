//! `pause RUN`, `resume RUN`, `cancel RUN`

use super::args::Global;
use super::exit_code::{Exit, Failure};
use super::farm_args::{HoldArgs, ResumeArgs};
use super::output::Output;
use super::target;
use crate::run::{ControlState, set_control};
use render::line::Roots;
use serde_json::json;
use std::path::Path;

pub(super) fn pause(args: &HoldArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let (store, reason) = (args.store.store.as_deref(), args.reason.as_deref());
    tell(
        &args.run,
        store,
        ControlState::Paused,
        reason,
        global,
        output,
    )
}

pub(super) fn cancel(args: &HoldArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let (store, reason) = (args.store.store.as_deref(), args.reason.as_deref());
    tell(
        &args.run,
        store,
        ControlState::Cancelled,
        reason,
        global,
        output,
    )
}

pub(super) fn resume(args: &ResumeArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let store = args.store.store.as_deref();
    tell(
        &args.run,
        store,
        ControlState::Running,
        None,
        global,
        output,
    )
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
    let changed = set_control(&store, state, reason, global.dry_run)?;
    let name = &run.spec.name;
    let would = if global.dry_run { "would be" } else { "is" };
    let text = match (changed.before, state) {
        (ControlState::Running, ControlState::Running) => {
            format!("{name} was neither paused nor cancelled: nothing to resume")
        }
        (ControlState::Cancelled, ControlState::Running) => format!(
            "{name} {would} no longer cancelled: start `glasshouse work` (and `coordinate`) again, they go on where it ended"
        ),
        (_, ControlState::Running) => {
            format!("{name} {would} resumed: workers notice within seconds")
        }
        (_, ControlState::Paused) => format!(
            "{name} {would} paused: workers notice within seconds, finish what they have opened and wait; `glasshouse resume` goes on"
        ),
        (_, ControlState::Cancelled) => format!(
            "{name} {would} cancelled: workers end after the shards in flight, with exit code {}; what is done stays, and \
             `glasshouse resume` takes it back",
            Exit::Incomplete.code()
        ),
    };
    let command = match state {
        ControlState::Running => "resume",
        ControlState::Paused => "pause",
        ControlState::Cancelled => "cancel",
    };
    output.result(
        &format!("glasshouse.{command}/1"),
        json!({
            "run": folder, "dry_run": global.dry_run, "before": changed.before, "state": changed.now, "reason": reason,
        }),
        &text,
    );
    Ok(Exit::Done)
}
