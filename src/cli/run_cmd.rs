//! `run RECIPE`: everything, on this machine.

use super::args::{Global, RunArgs};
use super::exit_code::{Exit, Failure};
use super::output::Output;
use super::plan_cmd::{self, plan_with, run_folder};
use super::work_cmd::{outcome_json, summary, work_on};
use crate::farm::Run;
use crate::manifest::Roots;
use crate::report::write_report;
use serde_json::json;

pub(super) fn run(args: &RunArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    if global.dry_run {
        let args = super::args::PlanArgs {
            run: clone_args(args),
        };
        return plan_cmd::run(&args, global, output);
    }
    plan_with(args, global, output)?;
    let folder = run_folder(args);
    let run = Run::open(&folder, &Roots::parse(&args.roots.roots)?)?;
    let (outcome, exit, wall) = work_on(&run, global, output, None)?;
    let report = write_report(&run)?;
    let mut object = outcome_json(&outcome, &folder, wall);
    object["report"] = json!(report);
    output.result(
        "glasshouse.run/1",
        object,
        &format!("{}\nlook at {}", summary(&outcome, wall), report.display()),
    );
    Ok(exit)
}

fn clone_args(args: &RunArgs) -> RunArgs {
    RunArgs {
        recipe: args.recipe.clone(),
        out: args.out.clone(),
        tile: args.tile,
        roots: args.roots.clone(),
    }
}
