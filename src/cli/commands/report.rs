//! `report RUN`

use crate::cli::args::{Global, StoreArgs};
use crate::cli::exit_code::{Exit, Failure};
use crate::cli::output::{Output, reasons};
use crate::cli::target;
use crate::report::{Report, write_report};
use crate::run::keys;
use clap::Args as ClapArgs;
use render::ids::SceneId;
use render::line::Roots;
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};

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

/// Damaged tuples that are named; the page and --json have all.
const SHOWN: usize = 10;

pub(super) fn run(args: &ReportArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let (run, store) = target::open(&args.run, args.store.store.as_deref(), &Roots::default())?;
    if global.dry_run {
        let default = || run.path(keys::REPORT);
        let report = args.out.clone().unwrap_or_else(default);
        let planned = Planned { report, dry_run: true };
        output.show("glasshouse.report/1", &planned);
        return Ok(Exit::Done);
    }
    let report = write_report(&run, &store, args.out.as_deref())?;
    warn(&report, output);
    output.show("glasshouse.report/1", &Written::new(&report));
    Ok(if report.damaged.is_empty() { Exit::Done } else { Exit::Incomplete })
}

/// Names tuples that are of no use.
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

#[derive(Serialize)]
struct Planned {
    report: PathBuf,
    dry_run: bool,
}

impl fmt::Display for Planned {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "would write {}", self.report.display())
    }
}

#[derive(Serialize)]
struct Written<'a> {
    report: &'a Path,
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
        Self {
            report: &report.path,
            dry_run: false,
            bytes: report.bytes,
            scenes: report.scenes,
            tuples: report.tuples,
            shown: report.shown,
            noise_maps: report.noise_maps,
            logs: report.logs,
            damaged: &report.damaged,
        }
    }
}

impl fmt::Display for Written<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "wrote {} ({:.2} MB; {} of {} tuples, {} of them shown)",
            self.report.display(),
            self.bytes as f64 * 1e-6,
            self.tuples,
            self.scenes,
            self.shown
        )
    }
}
