//! Starts real NATS servers on the loopback interface.

use super::tools::{Daemon, free_port, listens, make_keys, wait_for};
use glasshouse::farm::queue::NatsOptions;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;
use tempfile::TempDir;

/// A nats-server with JetStream, killed when dropped.
pub(crate) struct Nats {
    server: Option<Daemon>,
    port: u16,
    folder: TempDir,
}

impl Nats {
    /// Starts a server; returns `None`, and prints a note, if nats-server is not installed.
    pub(crate) fn start() -> Option<Self> {
        let (folder, port) = (tempfile::tempdir().unwrap(), free_port());
        let server = Some(spawn(port, &folder.path().join("jetstream"))?);
        Some(Self { server, port, folder })
    }

    pub(crate) fn url(&self) -> String {
        format!("nats://127.0.0.1:{}", self.port)
    }

    /// Returns the options of a test's own client.
    pub(crate) fn options(&self) -> NatsOptions {
        NatsOptions { url: self.url(), name: "test".to_owned(), ..NatsOptions::default() }
    }

    fn store(&self) -> PathBuf {
        self.folder.path().join("jetstream")
    }

    /// Kills the server, waits, and starts a new one, without the stored data if `forget`.
    pub(crate) fn kill_and_restart(&mut self, forget: bool) {
        self.server = None;
        if forget {
            std::fs::remove_dir_all(self.store()).unwrap();
        }
        std::thread::sleep(Duration::from_millis(300));
        self.server = spawn(self.port, &self.store());
    }
}

fn spawn(port: u16, store: &Path) -> Option<Daemon> {
    let mut command = Command::new("nats-server");
    command.args(["-js", "-a", "127.0.0.1", "-p", &port.to_string(), "-sd"]);
    let server = Daemon::start(command.arg(store))?;
    wait_for("the start of the server", || listens(port));
    Some(server)
}

/// Starts a server with the settings of a file; returns it and its address.
pub(crate) fn spawn_configured(file: &Path) -> Option<(Daemon, String)> {
    let port = free_port();
    let mut command = Command::new("nats-server");
    command.args(["-a", "127.0.0.1", "-p", &port.to_string(), "-c"]);
    let server = Daemon::start(command.arg(file))?;
    wait_for("the start of the server", || listens(port));
    Some((server, format!("nats://127.0.0.1:{port}")))
}

/// A nats-server with `workers/nats/server.conf` and keys for `localhost`.
pub(crate) struct SecureNats {
    _server: Daemon,
    pub(crate) port: u16,
    folder: TempDir,
}

impl SecureNats {
    pub(crate) fn start() -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        make_keys(&folder.path().join("keys"), &["localhost"])?;
        let mut command = Command::new("nats-server");
        // Port -1 means any free port.
        command.args(["-a", "127.0.0.1", "-p", "-1", "-m", "-1", "-c"]);
        command.arg(folder.path().join("keys/server/server.conf"));
        let (server, said) = Daemon::start_and_hear(&mut command)?;
        let mut log = BufReader::new(said).lines();
        let port = log.by_ref().find_map(|line| {
            let line = line.unwrap();
            let (_, address) = line.split_once("client connections on ")?;
            address.trim().rsplit_once(':')?.1.parse().ok()
        });
        // Reads the log to its end, so that the server never blocks on a full pipe.
        std::thread::spawn(move || log.for_each(drop));
        let port = port.expect("nats-server logs its port");
        wait_for("the start of the server", || listens(port));
        Some(Self { _server: server, port, folder })
    }

    pub(crate) fn url(&self) -> String {
        format!("tls://localhost:{}", self.port)
    }

    pub(crate) fn key(&self, role: &str, file: &str) -> PathBuf {
        self.folder.path().join("keys").join(role).join(file)
    }
}
