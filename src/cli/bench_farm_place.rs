//! Where a farm is measured: a folder, and a queue's server, all gone when they are dropped.

use super::bench_farm_process::{Process, Server};
use super::bench_farm_recipe::Recipe;
use super::exit_code::{Exit, Failure};
use super::signals::Signals;
use crate::run::{PlanOptions, Run, plan_run};
use crate::store::Inputs;
use anyhow::{Context, anyhow};
use render::line::Roots;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::SystemTime;
use tempfile::TempDir;

/// A folder, and a queue if there is one.
pub(super) struct Place {
    folder: TempDir,
    server: Option<Server>,
    /// Of the queue.
    pub(super) url: Option<String>,
    signals: Signals,
}

impl Place {
    /// Uses the queue at `url`, or starts a `nats-server` if there is one.
    pub(super) fn new(url: Option<&str>) -> Result<Self, Failure> {
        let signals = Signals::catch();
        let folder = tempfile::Builder::new().prefix("glasshouse-").tempdir();
        let folder = folder.map_err(|e| failed(anyhow!("cannot make a folder to work in: {e}")))?;
        let server = match url {
            Some(_) => None,
            None => Server::start(&folder.path().join("jetstream"))?,
        };
        let url = url
            .map(str::to_owned)
            .or_else(|| server.as_ref().map(Server::url));
        Ok(Self {
            folder,
            server,
            url,
            signals,
        })
    }

    /// What the results were measured with.
    pub(super) fn queue_name(&self) -> &'static str {
        match (&self.server, &self.url) {
            (Some(_), _) => "a nats-server started for this",
            (None, Some(_)) => "the given server",
            (None, None) => "none",
        }
    }

    /// The queue's address, or why there is none.
    pub(super) fn need_queue(&self) -> Result<&str, Failure> {
        self.url.as_deref().ok_or_else(|| {
            let what = "this needs a NATS server: install nats-server, or say where one is (--queue nats://host:4222)";
            Failure::new(Exit::Usage, anyhow!(what))
        })
    }

    /// Ends with the exit code of a signal if one came.
    pub(super) fn go_on(&self) -> Result<(), Failure> {
        if self
            .signals
            .stop()
            .load(std::sync::atomic::Ordering::Relaxed)
        {
            let what = anyhow!("stopped by a signal; nothing was measured to the end");
            return Err(Failure::new(self.signals.exit(), what));
        }
        Ok(())
    }

    /// A name that no other measurement uses.
    pub(super) fn name(&self, what: &str) -> String {
        let name = self.folder.path().file_name();
        let name = name.map_or_else(String::new, |n| n.to_string_lossy().into_owned());
        let own: String = name.chars().filter(char::is_ascii_alphanumeric).collect();
        format!("{what}-{own}")
    }

    /// Plans a run.
    pub(super) fn plan(&self, recipe: &Recipe) -> Result<PathBuf, Failure> {
        let path = self.folder.path().join(format!("{}.toml", recipe.name));
        render::atomic_file::write_relaxed(&path, recipe.text().as_bytes())?;
        let run = self.folder.path().join(&recipe.name);
        let options = PlanOptions {
            roots: &Roots::default(),
            inputs: &Inputs::default(),
            tile_px: Some(recipe.tile_px),
            dry_run: false,
            skip_invalid: false,
            threads: 2,
        };
        plan_run(&path, &run, &options, &|_, _, _| {})?;
        Ok(run)
    }

    /// Starts this program.
    pub(super) fn start(&self, arguments: &[&str]) -> Result<Process<'_>, Failure> {
        Process::start(self, command(arguments)?)
    }

    /// Starts this program beside the queue.
    pub(super) fn start_on_queue(&self, arguments: &[&str]) -> Result<Process<'_>, Failure> {
        let mut command = command(arguments)?;
        // Not on the command line, where others would see what may be in a URL.
        command.env("GLASSHOUSE_QUEUE", self.need_queue()?);
        Process::start(self, command)
    }

    /// CPU seconds of the server, if it is ours and the system tells.
    pub(super) fn server_cpu_s(&self) -> Option<f64> {
        let pid = self.server.as_ref()?.pid();
        let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
        // The name before it, in brackets, may hold anything.
        let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
        let ticks = |k: usize| fields.get(k)?.parse::<f64>().ok();
        Some((ticks(11)? + ticks(12)?) / rustix::param::clock_ticks_per_second() as f64)
    }
}

/// This program, alone.
fn command(arguments: &[&str]) -> Result<Command, Failure> {
    let mut command = Command::new(std::env::current_exe().map_err(failed)?);
    command.args(arguments);
    command
        .env_remove("GLASSHOUSE_STORE")
        .env_remove("GLASSHOUSE_QUEUE");
    command
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    Ok(command)
}

pub(super) fn failed(error: impl Into<anyhow::Error>) -> Failure {
    Failure::new(Exit::Failed, error)
}

/// When the last tuple of a run was written, and a digest of all tuples' bytes; an error if one is missing.
pub(super) fn tuples(run: &Path) -> Result<(SystemTime, String), Failure> {
    let open = Run::open(run, &Roots::default())?;
    let mut last = SystemTime::UNIX_EPOCH;
    let mut digest = blake3::Hasher::new();
    for line in &open.lines {
        let folder = open.dir.tuple(&line.id);
        for name in render::merge::tuple_files(line) {
            let path = folder.join(name);
            let bytes = std::fs::read(&path);
            let bytes = bytes
                .with_context(|| format!("{} is not there", path.display()))
                .map_err(failed)?;
            digest.update(blake3::hash(&bytes).as_bytes());
        }
        let meta = std::fs::metadata(folder.join("tuple.json"));
        last = last.max(meta.and_then(|m| m.modified()).map_err(failed)?);
    }
    Ok((last, digest.finalize().to_hex().to_string()))
}

/// The middle one, or the mean of the two in the middle.
pub(super) fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    match sorted.len() {
        0 => f64::NAN,
        n => f64::midpoint(sorted[(n - 1) / 2], sorted[n / 2]),
    }
}
