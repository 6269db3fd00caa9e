//! `report RUN`

use crate::cli::args::{Global, StoreArgs};
use crate::cli::exit_code::{Exit, Failure};
use crate::cli::output::{Output, reasons_json};
use crate::cli::target;
use crate::report::{Report, write_report};
use crate::run::keys;
use clap::Args as ClapArgs;
use render::line::Roots;
use serde_json::json;
use std::path::PathBuf;

#[derive(Debug, ClapArgs)]
pub(super) struct ReportArgs {
    /// Folder of the run
    run: PathBuf,
    /// File to write [default: RUN/report/index.html]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    #[command(flatten)]
    store: StoreArgs,
}

/// Damaged tuples to name; the page and --json list all.
const SHOWN: usize = 10;

pub(super) fn run(args: &ReportArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let (run, store) = target::open(&args.run, args.store.store.as_deref(), &Roots::default())?;
    if global.dry_run {
        let report = args.out.clone().unwrap_or_else(|| run.path(keys::REPORT));
        let object = json!({ "report": report.to_string_lossy(), "dry_run": true });
        let text = format!("would write {}", report.display());
        output.say("glasshouse.report/1", object, text);
        return Ok(Exit::Done);
    }
    let report = write_report(&run, &store, args.out.as_deref())?;
    warn(&report, output);
    let Report { path, bytes, scenes, tuples, shown, noise_maps, logs, damaged } = &report;
    let object = json!({
        "report": path.to_string_lossy(), "dry_run": false, "bytes": bytes, "scenes": scenes,
        "tuples": tuples, "shown": shown, "noise_maps": noise_maps, "logs": logs,
        "damaged": reasons_json(damaged),
    });
    let text = format!(
        "wrote {} ({:.2} MB; {tuples} of {scenes} tuples, {shown} of them shown)",
        path.display(),
        *bytes as f64 * 1e-6
    );
    output.say("glasshouse.report/1", object, text);
    Ok(if damaged.is_empty() { Exit::Done } else { Exit::Incomplete })
}

/// Warns of damaged tuples.
pub(super) fn warn(report: &Report, output: &Output) {
    for (scene, reason) in report.damaged.iter().take(SHOWN) {
        output.warning(&format!(
            "the tuple of {scene} is damaged: {reason}; `glasshouse retry RUN {scene} --anew`, then `glasshouse work RUN` make it again"
        ));
    }
    if let Some(more @ 1..) = report.damaged.len().checked_sub(SHOWN) {
        output.warning(&format!("{more} more tuples are damaged; the page names them"));
    }
}
