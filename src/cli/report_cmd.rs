//! `report RUN`

use super::args::{Global, ReportArgs};
use super::exit_code::{Exit, Failure};
use super::output::Output;
use super::target;
use crate::report::{Report, write_report};
use render::line::Roots;
use serde_json::{Value, json};

/// Damaged tuples that are named; the page and --json have all.
const SHOWN: usize = 10;

pub(super) fn run(args: &ReportArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let (run, store) = target::open(&args.run, args.store.store.as_deref(), &Roots::default())?;
    if global.dry_run {
        let path = args.out.clone();
        let path = path.unwrap_or_else(|| run.dir.report().join("index.html"));
        output.result(
            "glasshouse.report/1",
            json!({ "report": path, "dry_run": true }),
            &format!("would write {}", path.display()),
        );
        return Ok(Exit::Done);
    }
    let report = write_report(&run, &store, args.out.as_deref())?;
    warn(&report, output);
    output.result("glasshouse.report/1", object(&report), &text(&report));
    Ok(if report.damaged.is_empty() {
        Exit::Done
    } else {
        Exit::Incomplete
    })
}

/// Names tuples that are of no use.
pub(super) fn warn(report: &Report, output: &Output) {
    for (scene, reason) in report.damaged.iter().take(SHOWN) {
        output.warning(&format!(
            "the tuple of {scene} is damaged: {reason}; `glasshouse retry RUN {scene} --anew`, then `glasshouse work RUN` make it again"
        ));
    }
    if let Some(more @ 1..) = report.damaged.len().checked_sub(SHOWN) {
        output.warning(&format!(
            "{more} more tuples are damaged; the page names them"
        ));
    }
}

fn object(report: &Report) -> Value {
    let damaged: Vec<Value> = report
        .damaged
        .iter()
        .map(|(scene, reason)| json!({ "scene": scene, "reason": reason }))
        .collect();
    json!({
        "report": report.path, "dry_run": false, "bytes": report.bytes, "scenes": report.scenes, "tuples": report.tuples,
        "shown": report.shown, "noise_maps": report.noise_maps, "logs": report.logs, "damaged": damaged,
    })
}

/// What was written, in a line.
pub(super) fn text(report: &Report) -> String {
    format!(
        "wrote {} ({:.2} MB; {} of {} tuples, {} of them shown)",
        report.path.display(),
        report.bytes as f64 * 1e-6,
        report.tuples,
        report.scenes,
        report.shown
    )
}
