//! `run RECIPE`: everything, on this machine.

use super::args::{Global, RunArgs};
use super::exit_code::{Exit, Failure};
use super::output::Output;
use super::plan_cmd::{self, plan_with, run_folder};
use super::report_cmd;
use super::store_env;
use super::work_cmd::{How, outcome_json, summary, work_on};
use crate::report::write_report;
use crate::run::Run;
use crate::run::{check, table};
use crate::store::Store;
use plan::cases::{CaseFile, is_case_file};
use render::line::Roots;
use serde_json::json;
use std::path::Path;

pub(super) fn run(args: &RunArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let plan = &args.plan;
    if global.dry_run {
        return plan_cmd::run(plan, global, output);
    }
    // Before anything computes: the pool of threads is made once.
    #[cfg(feature = "train")]
    super::train_args::use_threads(global);
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
    let mut object = outcome_json(&outcome, &folder, wall);
    let mut text = summary(&outcome, wall);
    let mut exit = exit;
    #[cfg(feature = "train")]
    if matches!(exit, Exit::Done | Exit::Incomplete)
        && let Some(training) = super::run_training::training(&folder, &run, global, output)?
    {
        object["train"] = training.object;
        text = format!("{}\n{text}", training.text);
        if training.exit != Exit::Done {
            exit = training.exit;
        }
        // The same page, with the training.
        report = None;
    }
    let report = match report {
        Some(report) => report,
        None => write_report(&run, &store, None)?,
    };
    report_cmd::warn(&report, output);
    object["report"] = json!(report.path);
    text = format!("{text}\nlook at {}", report.path.display());
    // A run that was stopped has nothing to compare yet.
    if matches!(exit, Exit::Done | Exit::Incomplete)
        && let Some(file) = case_file(&plan.recipe)?
    {
        let rows = check(&file, &run).map_err(|e| Failure::new(Exit::Failed, e))?;
        let failed = rows.iter().filter(|row| !row.ok).count();
        object["checks"] = json!(rows);
        object["checks_failed"] = json!(failed);
        text = format!(
            "{}\n{} checks, {failed} failed\n{text}",
            table(&rows),
            rows.len()
        );
        exit = if failed == 0 {
            Exit::Done
        } else {
            Exit::Failed
        };
    }
    output.result("glasshouse.run/1", object, &text);
    Ok(exit)
}

/// The hard cases in `path`, if it holds such.
fn case_file(path: &Path) -> Result<Option<CaseFile>, Failure> {
    let wrong = |error: anyhow::Error| Failure::new(Exit::InvalidInput, error);
    if path.extension().is_none_or(|ending| ending != "toml") {
        return Ok(None);
    }
    let text = std::fs::read_to_string(path).map_err(|e| wrong(e.into()))?;
    if !is_case_file(&text) {
        return Ok(None);
    }
    CaseFile::parse(&text)
        .map(Some)
        .map_err(|e| wrong(e.into()))
}
