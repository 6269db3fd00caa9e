//! A real NATS server on loopback.

use std::net::{TcpListener, TcpStream};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// A nats-server with JetStream, killed when it is dropped.
pub(crate) struct Server {
    child: Child,
    port: u16,
    folder: TempDir,
}

impl Server {
    /// Starts one; none, with a line that says so, where the program is not installed.
    pub(crate) fn start() -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let port = TcpListener::bind("127.0.0.1:0")
            .unwrap()
            .local_addr()
            .unwrap()
            .port();
        let store = folder.path().join("jetstream");
        let Some(child) = spawn(port, &store) else {
            eprintln!("skipped: nats-server is not installed");
            return None;
        };
        let server = Self {
            child,
            port,
            folder,
        };
        server.wait();
        Some(server)
    }

    pub(crate) fn url(&self) -> String {
        format!("nats://127.0.0.1:{}", self.port)
    }

    fn store(&self) -> PathBuf {
        self.folder.path().join("jetstream")
    }

    fn wait(&self) {
        let start = Instant::now();
        while TcpStream::connect(("127.0.0.1", self.port)).is_err() {
            assert!(
                start.elapsed() < Duration::from_secs(20),
                "the server does not start"
            );
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// SIGKILL, some time without a server, and a new one: with what the old one kept, or without.
    pub(crate) fn kill_and_restart(&mut self, forget: bool) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
        if forget {
            std::fs::remove_dir_all(self.store()).unwrap();
        }
        std::thread::sleep(Duration::from_millis(300));
        self.child = spawn(self.port, &self.store()).unwrap();
        self.wait();
    }
}

fn spawn(port: u16, store: &std::path::Path) -> Option<Child> {
    let child = Command::new("nats-server")
        .args(["-js", "-a", "127.0.0.1", "-p", &port.to_string(), "-sd"])
        .arg(store)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn();
    child.ok()
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
