//! `report RUN`

use super::args::{Global, RunFolder};
use super::exit_code::{Exit, Failure};
use super::output::Output;
use crate::farm::Run;
use crate::manifest::Roots;
use crate::report::write_report;
use serde_json::json;

pub(super) fn run(args: &RunFolder, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let run = Run::open(&args.run, &Roots::default())?;
    let path = if global.dry_run {
        run.dir.report().join("index.html")
    } else {
        write_report(&run)?
    };
    let verb = if global.dry_run {
        "would write"
    } else {
        "wrote"
    };
    output.result(
        "glasshouse.report/1",
        json!({ "report": path, "dry_run": global.dry_run }),
        &format!("{verb} {}", path.display()),
    );
    Ok(Exit::Done)
}
