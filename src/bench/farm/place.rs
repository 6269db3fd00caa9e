//! The environment of a measurement: a temporary folder, and a NATS server if one is installed or given.

use super::error::FarmBenchError;
use super::process::Process;
use super::recipe::Recipe;
use super::server::Server;
use super::setup::{Conditions, Setup, Watcher};
use crate::run::{PlanOptions, Run, keys, plan_run};
use crate::store::Inputs;
use glasshouse_line::Roots;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::Ordering;
use std::time::SystemTime;
use tempfile::TempDir;

/// Name of the queue in the results of a measurement without a shared queue.
pub(super) const NO_QUEUE: &str = "none";

pub(super) struct Place<'a> {
    setup: &'a Setup<'a>,
    folder: TempDir,
    server: Option<Server>,
    pub(super) url: Option<String>,
}

impl<'a> Place<'a> {
    /// Creates the folder, and uses the queue of `setup` or starts `nats-server` if it is installed.
    pub(super) fn new(setup: &'a Setup<'a>) -> Result<Self, FarmBenchError> {
        let folder = tempfile::Builder::new().prefix("glasshouse-").tempdir();
        let folder = folder.map_err(FarmBenchError::system("create a temporary folder"))?;
        let server = match setup.queue {
            Some(_) => None,
            None => Server::start(&folder.path().join("jetstream"))?,
        };
        let given = setup.queue.map(str::to_owned);
        let url = given.or_else(|| server.as_ref().map(Server::url));
        Ok(Self { setup, folder, server, url })
    }

    pub(super) fn watcher(&self) -> &dyn Watcher {
        self.setup.watcher
    }

    pub(super) fn conditions(&self, mode: &'static str) -> Conditions {
        let queue = match (&self.server, &self.url) {
            (Some(_), _) => "a temporary nats-server",
            (None, Some(_)) => "the given server",
            (None, None) => NO_QUEUE,
        };
        Conditions::new(mode, queue, self.setup.cpu.clone())
    }

    /// Returns the queue's address. Fails without a queue.
    pub(super) fn need_queue(&self) -> Result<&str, FarmBenchError> {
        self.url.as_deref().ok_or(FarmBenchError::NoQueue)
    }

    /// Fails if a signal has stopped the measurement.
    pub(super) fn go_on(&self) -> Result<(), FarmBenchError> {
        if self.setup.stop.load(Ordering::Relaxed) {
            return Err(FarmBenchError::Stopped);
        }
        Ok(())
    }

    pub(super) fn name(&self, what: &str) -> String {
        let name = self.folder.path().file_name();
        let name = name.map_or_else(String::new, |n| n.to_string_lossy().into_owned());
        let own: String = name.chars().filter(char::is_ascii_alphanumeric).collect();
        format!("{what}-{own}")
    }

    pub(super) fn plan(&self, recipe: &Recipe) -> Result<PathBuf, FarmBenchError> {
        let path = self.folder.path().join(format!("{}.toml", recipe.name));
        render::atomic_file::write_relaxed(&path, recipe.text().as_bytes())?;
        let run = self.folder.path().join(&recipe.name);
        let options = PlanOptions {
            only: None,
            golden: None,
            roots: &Roots::default(),
            inputs: &Inputs::default(),
            tile_px: Some(recipe.tile_px),
            dry_run: false,
            skip_invalid: false,
            training: None,
            threads: 2,
        };
        plan_run(&path, &run, &options, &|_, _, _| {})?;
        Ok(run)
    }

    /// Starts this program without a shared queue.
    pub(super) fn start(&self, arguments: &[&str]) -> Result<Process<'_>, FarmBenchError> {
        Process::start(self, self.command(arguments))
    }

    /// Starts this program with the NATS server as its queue.
    pub(super) fn start_on_queue(&self, arguments: &[&str]) -> Result<Process<'_>, FarmBenchError> {
        let mut command = self.command(arguments);
        // The command line would expose a password in the URL.
        command.env("GLASSHOUSE_QUEUE", self.need_queue()?);
        Process::start(self, command)
    }

    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(self.setup.program);
        command
            .args(arguments)
            .env_remove("GLASSHOUSE_STORE")
            .env_remove("GLASSHOUSE_QUEUE")
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        command
    }

    /// Returns the CPU seconds of the server if this process started it and they are known.
    pub(super) fn server_cpu_s(&self) -> Option<f64> {
        self.server.as_ref().and_then(Server::cpu_s)
    }
}

/// Returns the time at which the last tuple was written, and a digest of all tuples. Fails if a tuple is missing.
pub(super) fn tuples(run: &Path) -> Result<(SystemTime, String), FarmBenchError> {
    let open = Run::open(run, &Roots::default())?;
    let mut last = SystemTime::UNIX_EPOCH;
    let mut digest = blake3::Hasher::new();
    for line in &open.lines {
        let folder = open.path(&keys::tuple_folder(&line.id));
        for name in render::merge::tuple_files(line) {
            let path = folder.join(name);
            let bytes = std::fs::read(&path);
            let bytes = bytes.map_err(|source| FarmBenchError::Read { path, source })?;
            digest.update(blake3::hash(&bytes).as_bytes());
        }
        let path = folder.join("tuple.json");
        let modified = std::fs::metadata(&path).and_then(|meta| meta.modified());
        last = last.max(modified.map_err(|source| FarmBenchError::Read { path, source })?);
    }
    Ok((last, digest.finalize().to_hex().to_string()))
}

/// Returns the seconds from `begun` to `last`.
pub(super) fn seconds_between(begun: SystemTime, last: SystemTime) -> Result<f64, FarmBenchError> {
    let between = last.duration_since(begun).map_err(std::io::Error::other);
    let between = between.map_err(FarmBenchError::system("measure: the clock went backwards"))?;
    Ok(between.as_secs_f64())
}
