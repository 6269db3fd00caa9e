//! `run RECIPE`: everything, on this machine.

#[cfg(feature = "train")]
mod training;

use crate::cli::args::{CheckpointArgs, Global};
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
use render::line::Roots;
use serde::Serialize;
use std::fmt;
use std::path::PathBuf;

#[derive(Debug, ClapArgs)]
pub(super) struct RunArgs {
    #[command(flatten)]
    plan: PlanArgs,
    #[command(flatten)]
    checkpoint: CheckpointArgs,
}

pub(super) fn run(args: &RunArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let plan = &args.plan;
    if global.dry_run {
        return plan_command::run(plan, global, output);
    }
    // Before anything computes: the pool of threads is made once.
    #[cfg(feature = "train")]
    crate::cli::network::use_threads(global);
    plan_with(plan, global, output)?;
    let folder = run_folder(plan);
    let mut run = Run::open(&folder, &Roots::parse(&plan.roots.roots)?)?;
    run.inputs = store_env::inputs();
    let (outcome, exit, wall) = work_on(
        &run,
        &How::alone(&folder, &plan.roots.roots, args.checkpoint.checkpoint_s),
        global,
        output,
    )?;
    let store = Store::local(&folder)?;
    let mut report = None;
    if outcome.merged > 0 {
        // A training takes long: the tuples can be looked at meanwhile.
        report = Some(write_report(&run, &store, None)?);
    }
    let mut exit = exit;
    #[cfg(feature = "train")]
    let mut lesson = None;
    #[cfg(feature = "train")]
    if matches!(exit, Exit::Done | Exit::Incomplete)
        && let Some(training) = training::training(&folder, &run, global, output)?
    {
        if training.exit != Exit::Done {
            exit = training.exit;
        }
        lesson = Some(training);
        // The same page, with the training.
        report = None;
    }
    let report = match report {
        Some(report) => report,
        None => write_report(&run, &store, None)?,
    };
    report::warn(&report, output);
    let ran = Ran {
        worked: Worked::new(&outcome, &folder, wall),
        #[cfg(feature = "train")]
        train: lesson,
        report: report.path,
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
    train: Option<training::Lesson>,
    report: PathBuf,
}

impl fmt::Display for Ran<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        #[cfg(feature = "train")]
        if let Some(train) = &self.train {
            writeln!(f, "{train}")?;
        }
        write!(f, "{}\nlook at {}", self.worked, self.report.display())
    }
}
