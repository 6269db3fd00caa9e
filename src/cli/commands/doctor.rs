//! `doctor [RUN]`

use crate::cli::args::{FARM, Global, isa, threads};
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
use clap::Args as ClapArgs;
use render::line::Roots;
use render::shard::{Golden, Spec};
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Duration;

#[derive(Debug, ClapArgs)]
pub(super) struct DoctorArgs {
    /// Folder of a run, or where one shall be [default: where you are]
    run: Option<PathBuf>,
    /// A store to try: a folder, file:///FOLDER, or s3://BUCKET/PREFIX; one small object is put and removed
    #[arg(long, value_name = "URL", env = "GLASSHOUSE_STORE", help_heading = FARM)]
    store: Option<String>,
    /// A NATS server to try: nats://host:4222, tls://host:4222, several with commas
    #[arg(long, value_name = "URL", env = "GLASSHOUSE_QUEUE", hide_env_values = true, help_heading = FARM)]
    queue: Option<String>,
    /// File with the seed of an nkey
    #[arg(long, value_name = "FILE", env = "GLASSHOUSE_QUEUE_NKEY", requires = "queue", help_heading = FARM)]
    queue_nkey: Option<PathBuf>,
    /// File with NATS credentials, as nsc writes it
    #[arg(long, value_name = "FILE", env = "GLASSHOUSE_QUEUE_CREDS", requires = "queue", help_heading = FARM)]
    queue_creds: Option<PathBuf>,
    /// File with certificates (PEM) to trust besides the system's
    #[arg(long, value_name = "FILE", env = "GLASSHOUSE_QUEUE_CA", requires = "queue", help_heading = FARM)]
    queue_ca: Option<PathBuf>,
}

/// A store that is away is said to be away after this time.
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
        output.note("-n writes nothing: disk, store and queue are not tried");
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
    run: PathBuf,
    dry_run: bool,
    ok: usize,
    warn: usize,
    fail: usize,
    findings: Vec<Finding>,
}

/// A line of marks and words for each check; what is to be done below it.
impl fmt::Display for Found {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let verdict = match (self.warn, self.fail) {
            (0, 0) => "all is well",
            (_, 0) => "it will work",
            _ => "something must be done",
        };
        let plural = |count: usize, what: &str| match count {
            0 => format!("no {what}s"),
            1 => format!("1 {what}"),
            n => format!("{n} {what}s"),
        };
        write!(
            f,
            "{verdict}: {}, {}, {}",
            plural(self.findings.len(), "check"),
            plural(self.warn, "warning"),
            plural(self.fail, "failure")
        )?;
        let width = self.findings.iter().map(|f| f.check.len()).max();
        let width = width.unwrap_or(0);
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

/// The golden shard of the run, if one is there, and whether it can be worked on.
fn planned(folder: &Path) -> (Option<Golden>, Option<Finding>) {
    let spec = std::fs::read(folder.join(keys::SPEC)).ok();
    let golden =
        spec.and_then(|bytes| serde_json::from_slice::<Spec>(&bytes).ok()).map(|spec| spec.golden);
    let to_do = format!("`glasshouse inspect {}` tells more", folder.display());
    let finding = match Run::open(folder, &Roots::default()) {
        Ok(run) => Finding::ok(
            "run",
            format!("{}, {} scenes, can be worked on", run.spec.name, run.lines.len()),
        ),
        // No run yet: there is nothing to say of it.
        Err(RunError::Missing { .. }) => return (None, None),
        Err(error) => Finding::fail("run", error.to_string(), to_do),
    };
    (golden, Some(finding))
}

/// The folder, or the one above it in which it would be made.
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
        // Opening it would make it.
        return vec![Finding::fail(
            "store",
            format!("there is no folder {folder}"),
            "make it, or correct the address",
        )];
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
    crate::doctor::check_queue(&crate::farm::queue::NatsOptions {
        url,
        nkey: args.queue_nkey.clone(),
        creds: args.queue_creds.clone(),
        ca: args.queue_ca.clone(),
        name: format!("doctor-{}", queue::worker_name()),
    })
}

#[cfg(not(feature = "nats"))]
fn queue(args: &DoctorArgs) -> Vec<Finding> {
    let missing = args.queue.iter();
    missing
        .map(|_| {
            Finding::fail(
                "queue",
                "this program was built without the feature `nats`",
                "use one that was built with it",
            )
        })
        .collect()
}
