//! `report RUN`: writes the report page.

use crate::cli::args::{Global, StoreArgs};
use crate::cli::exit_code::{Exit, Failure};
use crate::cli::output::{Output, reasons};
use crate::cli::target;
use crate::outputs::check_file;
use crate::report::{Report, is_report, write_report};
use crate::run::keys;
use clap::Args as ClapArgs;
use glasshouse_line::Roots;
use glasshouse_line::ids::SceneId;
use serde::Serialize;
use std::borrow::Cow;
use std::fmt;
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

/// Largest number of damaged tuples in messages; the page and --json list all.
const SHOWN: usize = 10;

pub(super) fn run(args: &ReportArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let (run, store) = target::open(&args.run, args.store.store.as_deref(), &Roots::default())?;
    if let Some(out) = &args.out {
        check_file(out, "report", &is_report)?;
    }
    if global.dry_run {
        let report = args.out.clone().unwrap_or_else(|| run.path(keys::REPORT));
        let planned = Planned { report: report.to_string_lossy(), dry_run: true };
        output.show("glasshouse.report/1", &planned);
        return Ok(Exit::Done);
    }
    let report = write_report(&run, &store, args.out.as_deref())?;
    warn(&report, output);
    output.show("glasshouse.report/1", &Written::new(&report));
    Ok(if report.damaged.is_empty() { Exit::Done } else { Exit::Incomplete })
}

/// Warns of damaged tuples.
pub(super) fn warn(report: &Report, output: &Output) {
    for (scene, reason) in report.damaged.iter().take(SHOWN) {
        output.warning(&format!(
            "the tuple of {scene} is damaged: {reason}; `glasshouse retry RUN {scene} --anew`, then `glasshouse work RUN` make it again"
        ));
    }
    if let Some(more @ 1..) = report.damaged.len().checked_sub(SHOWN) {
        output.warning(&format!("{more} more tuples are damaged; the page lists them"));
    }
}

#[derive(Serialize)]
struct Planned<'a> {
    report: Cow<'a, str>,
    dry_run: bool,
}

impl fmt::Display for Planned<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "would write {}", self.report)
    }
}

#[derive(Serialize)]
struct Written<'a> {
    report: Cow<'a, str>,
    dry_run: bool,
    bytes: u64,
    scenes: u64,
    tuples: u64,
    shown: u64,
    noise_maps: u64,
    logs: u64,
    #[serde(serialize_with = "reasons")]
    damaged: &'a [(SceneId, String)],
}

impl<'a> Written<'a> {
    fn new(report: &'a Report) -> Self {
        let Report { path, bytes, scenes, tuples, shown, noise_maps, logs, damaged } = report;
        Self {
            report: path.to_string_lossy(),
            dry_run: false,
            bytes: *bytes,
            scenes: *scenes,
            tuples: *tuples,
            shown: *shown,
            noise_maps: *noise_maps,
            logs: *logs,
            damaged,
        }
    }
}

impl fmt::Display for Written<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { report, tuples, scenes, shown, .. } = self;
        let megabytes = self.bytes as f64 * 1e-6;
        write!(
            f,
            "wrote {report} ({megabytes:.2} MB; {tuples} of {scenes} tuples, {shown} of them shown)"
        )
    }
}
