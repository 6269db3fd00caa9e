//! `run RECIPE`: plans, traces, merges, trains, evaluates and reports on this machine.

#[cfg(feature = "train")]
mod training;

use crate::cli::args::{Global, MemoryArgs};
use crate::cli::commands::plan::{self as plan_command, PlanArgs, plan_with, run_folder};
use crate::cli::commands::report;
use crate::cli::commands::work::{How, Worked, work_on};
use crate::cli::exit_code::{Exit, Failure};
use crate::cli::output::Output;
use crate::cli::store_env;
use crate::report::write_report;
use crate::run::Run;
use crate::store::Store;
use clap::Args as ClapArgs;
use glasshouse_line::Roots;
use serde::Serialize;
use std::fmt;

#[derive(Debug, ClapArgs)]
pub(super) struct RunArgs {
    #[command(flatten)]
    plan: PlanArgs,
    #[command(flatten)]
    memory: MemoryArgs,
}

pub(super) fn run(args: &RunArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let (plan, _recipe) = plan_command::of_folder(&args.plan)?;
    let plan = &plan;
    if global.dry_run {
        return plan_command::run(plan, global, output);
    }
    // This call comes first, because the global thread pool can be built only once.
    #[cfg(feature = "train")]
    {
        crate::cli::network::use_threads(global);
        training::check_features(&plan.recipe)?;
    }
    plan_with(plan, global, output)?;
    let folder = run_folder(plan);
    let mut run = Run::open(&folder, &Roots::parse(&plan.roots.roots)?)?;
    run.inputs = store_env::inputs();
    let (outcome, exit, wall) = work_on(
        &run,
        &How::alone(&folder, &plan.roots.roots, args.memory, global),
        global,
        output,
    )?;
    let store = Store::local(&folder)?;
    let mut report = None;
    if outcome.merged > 0 {
        // Training takes a long time: an early report lets the user look at the tuples meanwhile.
        report = Some(write_report(&run, &store, None)?);
    }
    let mut exit = exit;
    #[cfg(feature = "train")]
    let mut trained = None;
    #[cfg(feature = "train")]
    if matches!(exit, Exit::Done | Exit::Incomplete)
        && let Some(training) = training::training(&folder, &run, global, output)?
    {
        if training.exit != Exit::Done {
            exit = training.exit;
        }
        trained = Some(training);
        // The final report includes the training.
        report = None;
    }
    let report = report.map_or_else(|| write_report(&run, &store, None), Ok)?;
    report::warn(&report, output);
    let ran = Ran {
        worked: Worked::new(&outcome, &folder, wall),
        #[cfg(feature = "train")]
        train: trained,
        report: report.path.to_string_lossy().into_owned(),
    };
    output.show("glasshouse.run/1", &ran);
    Ok(exit)
}

#[derive(Serialize)]
struct Ran<'a> {
    #[serde(flatten)]
    worked: Worked<'a>,
    #[cfg(feature = "train")]
    #[serde(skip_serializing_if = "Option::is_none")]
    train: Option<training::Trained>,
    report: String,
}

impl fmt::Display for Ran<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        #[cfg(feature = "train")]
        if let Some(trained) = &self.train {
            writeln!(f, "{trained}")?;
        }
        write!(f, "{}\nsee {}", self.worked, self.report)
    }
}
