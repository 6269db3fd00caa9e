//! `doctor [RUN]`: checks this machine, a run, a store and a queue.

use crate::cli::args::{FARM, Global, NatsKeys, isa, threads};
use crate::cli::exit_code::{Exit, Failure};
use crate::cli::output::Output;
use crate::cli::queue;
use crate::cli::rows::rows;
use crate::cli::store_env::store_options;
use crate::doctor::{
    Finding, Level, check_clock, check_cpu, check_disk, check_golden, check_memory,
    check_open_files, check_store,
};
use crate::run::{Run, RunError, keys};
use crate::store::{Store, StoreOptions};
use crate::text::many;
use clap::Args as ClapArgs;
use glasshouse_line::Roots;
use render::shard::{Golden, Spec};
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Duration;

#[derive(Debug, ClapArgs)]
pub(super) struct DoctorArgs {
    /// Folder of a run, or of a future run [default: the current folder]
    run: Option<PathBuf>,
    /// Store to check: a folder, file:///FOLDER, or s3://BUCKET/PREFIX; the check puts and removes one small object
    #[arg(long, value_name = "URL", env = "GLASSHOUSE_STORE", help_heading = FARM)]
    store: Option<String>,
    /// NATS server to check: nats://host:4222 or tls://host:4222; commas separate several
    #[arg(long, value_name = "URL", env = "GLASSHOUSE_QUEUE", hide_env_values = true, help_heading = FARM)]
    queue: Option<String>,
    #[command(flatten)]
    keys: NatsKeys,
}

/// Time after which `doctor` reports that a store does not answer.
const PATIENCE: Duration = Duration::from_secs(2);

pub(super) fn run(args: &DoctorArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let (isa, threads) = (isa(global)?, threads(global));
    let run = args.run.clone().unwrap_or_else(|| PathBuf::from("."));
    let mut findings = Vec::new();
    findings.extend(check_cpu(isa, threads));
    findings.push(check_memory(threads));
    findings.push(check_open_files());
    findings.push(check_clock());
    let (golden, run_finding) = planned(&run);
    findings.push(check_golden(isa, threads, golden.as_ref()));
    findings.extend(run_finding);
    if global.dry_run {
        output.note("-n writes nothing: disk, store and queue are not checked");
    } else {
        findings.extend(check_disk(existing(&run)));
        if let Some(address) = &args.store {
            findings.extend(store(address));
        }
        findings.extend(queue(args));
    }
    let found = Found {
        run,
        dry_run: global.dry_run,
        ok: count(&findings, Level::Ok),
        warn: count(&findings, Level::Warn),
        fail: count(&findings, Level::Fail),
        findings,
    };
    output.show("glasshouse.doctor/1", &found);
    Ok(if found.fail == 0 { Exit::Done } else { Exit::Failed })
}

fn count(findings: &[Finding], level: Level) -> usize {
    findings.iter().filter(|finding| finding.level == level).count()
}

#[derive(Serialize)]
struct Found {
    #[serde(serialize_with = "render::path_text::one")]
    run: PathBuf,
    dry_run: bool,
    ok: usize,
    warn: usize,
    fail: usize,
    findings: Vec<Finding>,
}

/// Writes a summary, and then the result of each check with the advice below it.
impl fmt::Display for Found {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let verdict = match (self.warn, self.fail) {
            (0, 0) => "everything works",
            (_, 0) => "everything works, with warnings",
            _ => "some checks failed",
        };
        let plural = |count: usize, what: &str| match count {
            0 => format!("no {what}s"),
            n => many(n as u64, what),
        };
        write!(
            f,
            "{verdict}: {}, {}, {}",
            plural(self.findings.len(), "check"),
            plural(self.warn, "warning"),
            plural(self.fail, "failure")
        )?;
        let width = self.findings.iter().map(|f| f.check.len()).max().unwrap_or(0);
        let mut lines: Vec<(String, String)> = Vec::new();
        for finding in &self.findings {
            let label = format!("{:<4}  {:<width$}", finding.level.name(), finding.check);
            lines.push((label, finding.value.clone()));
            let to_do = finding.to_do.iter();
            lines.extend(to_do.map(|to_do| (String::new(), format!("-> {to_do}"))));
        }
        let lines = lines.iter().map(|(label, value)| (label.as_str(), value.as_str()));
        f.write_str(&rows(lines))
    }
}

/// Returns the golden shard of a readable spec and, for an existing run, a finding on whether the run is usable.
fn planned(folder: &Path) -> (Option<Golden>, Option<Finding>) {
    let spec = render::input_file::read(&folder.join(keys::SPEC)).ok();
    let golden =
        spec.and_then(|bytes| serde_json::from_slice::<Spec>(&bytes).ok()).map(|spec| spec.golden);
    let to_do = format!("`glasshouse inspect {}` has details", folder.display());
    let finding = match Run::open(folder, &Roots::default()) {
        Ok(run) => Finding::ok(
            "run",
            format!("{}, {} scenes, ready for workers", run.spec.name, run.lines.len()),
        ),
        Err(RunError::Missing { .. }) => return (None, None),
        Err(error) => Finding::fail("run", error.to_string(), to_do),
    };
    (golden, Some(finding))
}

/// Returns the folder itself or its nearest existing ancestor, or `.` if no ancestor of a relative path exists.
fn existing(folder: &Path) -> &Path {
    let mut above = folder.ancestors();
    let found = above.find(|folder| folder.is_dir() || folder.as_os_str().is_empty());
    match found {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

fn store(address: &str) -> Vec<Finding> {
    let local = match address.split_once("://") {
        None => Some(address),
        Some(("file", path)) => Some(path),
        Some(_) => None,
    };
    if let Some(folder) = local
        && !Path::new(folder).is_dir()
    {
        // Opening the store would create the folder.
        let text = format!("the folder {folder} does not exist");
        return vec![Finding::fail("store", text, "create it, or correct the address")];
    }
    let options = StoreOptions { patience: PATIENCE, ..store_options() };
    match Store::open(address, &options) {
        Ok(store) => check_store(&store, &queue::worker_name()),
        Err(error) => vec![Finding::fail("store", error.to_string(), "correct the address")],
    }
}

#[cfg(feature = "nats")]
fn queue(args: &DoctorArgs) -> Vec<Finding> {
    let Some(url) = args.queue.clone() else {
        return Vec::new();
    };
    let name = format!("doctor-{}", queue::worker_name());
    crate::doctor::check_queue(&args.keys.options(url, name))
}

#[cfg(not(feature = "nats"))]
fn queue(args: &DoctorArgs) -> Vec<Finding> {
    let missing = |_| {
        let text = "this program was built without the feature `nats`";
        Finding::fail("queue", text, "use a build with this feature")
    };
    args.queue.iter().map(missing).collect()
}
