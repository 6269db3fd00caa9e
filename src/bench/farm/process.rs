//! Processes of a farm that is measured, gone when they are dropped.

use super::bench_farm_place::{Place, failed};
use super::exit_code::Failure;
use super::isolate::lines;
use super::progress::{BEGINS, LOADED};
use anyhow::{Context, anyhow};
use crossbeam::channel::Receiver;
use serde_json::Value;
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Nothing here takes so long unless it hangs.
const TOO_LONG: Duration = Duration::from_mins(10);
/// Between two looks at a process.
const LOOK: Duration = Duration::from_millis(5);

/// A process of this program.
pub(super) struct Process<'a> {
    place: &'a Place,
    child: Child,
    stdout: Receiver<String>,
    stderr: Receiver<String>,
    said: Vec<String>,
    since: Instant,
}

impl<'a> Process<'a> {
    pub(super) fn start(place: &'a Place, mut command: Command) -> Result<Self, Failure> {
        let since = Instant::now();
        let child = command.spawn().context("cannot start another process");
        let mut child = child.map_err(failed)?;
        Ok(Self {
            place,
            stdout: lines(child.stdout.take()),
            stderr: lines(child.stderr.take()),
            said: Vec::new(),
            child,
            since,
        })
    }

    /// Since it was started.
    pub(super) fn age(&self) -> Duration {
        self.since.elapsed()
    }

    /// Waits until it says something like this (with `-v`).
    fn wait_until_it_says(&mut self, what: &str) -> Result<(), Failure> {
        loop {
            self.place.go_on()?;
            match self.stderr.recv_timeout(LOOK) {
                Ok(line) => {
                    let found = line.contains(what);
                    self.said.push(line);
                    if found {
                        return Ok(());
                    }
                }
                Err(error) if error.is_disconnected() => return Err(self.went_wrong("ended")),
                Err(_) if self.age() > TOO_LONG => return Err(self.went_wrong("hangs")),
                Err(_) => {}
            }
        }
    }

    /// Waits until a worker takes spans.
    pub(super) fn wait_until_ready(&mut self) -> Result<(), Failure> {
        self.wait_until_it_says(BEGINS)
    }

    /// Waits until a worker begins to trace a scene.
    pub(super) fn wait_until_it_traces(&mut self) -> Result<(), Failure> {
        self.wait_until_it_says(LOADED)
    }

    fn went_wrong(&mut self, how: &str) -> Failure {
        self.said.extend(self.stderr.try_iter());
        let last = self.said.len().saturating_sub(5);
        let said = self.said[last..].join("; ");
        failed(anyhow!("a process of the measured farm {how}: {said}"))
    }

    /// SIGKILL.
    pub(super) fn kill(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }

    /// Scenes that it has loaded, as it said (with `-v`).
    pub(super) fn loads(&mut self) -> u64 {
        self.said.extend(self.stderr.try_iter());
        self.said.iter().filter(|l| l.ends_with(LOADED)).count() as u64
    }

    /// Asks it to end, and waits for that.
    pub(super) fn terminate(mut self) -> Result<(), Failure> {
        if let Some(pid) = rustix::process::Pid::from_raw(self.child.id() as i32) {
            let _ = rustix::process::kill_process(pid, rustix::process::Signal::TERM);
        }
        self.wait().map(|_| ())
    }

    fn wait(&mut self) -> Result<Option<i32>, Failure> {
        loop {
            match self.child.try_wait() {
                Ok(Some(status)) => return Ok(status.code()),
                Ok(None) if self.age() > TOO_LONG => return Err(self.went_wrong("hangs")),
                Ok(None) => {}
                Err(error) => return Err(failed(error)),
            }
            self.place.go_on()?;
            std::thread::sleep(LOOK);
        }
    }

    /// Its result, when it has ended in order, and how long it took.
    pub(super) fn result(mut self) -> Result<(Value, Duration), Failure> {
        let code = self.wait()?;
        let took = self.age();
        if code != Some(0) {
            return Err(self.went_wrong(&format!("ended with {code:?}")));
        }
        let text: Vec<String> = self.stdout.iter().collect();
        let value = serde_json::from_str(&text.join("\n"));
        Ok((value.map_err(failed)?, took))
    }
}

impl Drop for Process<'_> {
    fn drop(&mut self) {
        self.kill();
    }
}

/// A `nats-server` with JetStream on loopback.
pub(super) struct Server {
    child: Child,
    port: u16,
}

impl Server {
    /// None where the program is not installed.
    pub(super) fn start(folder: &Path) -> Result<Option<Self>, Failure> {
        let free = TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr());
        let port = free.map_err(failed)?.port();
        let child = Command::new("nats-server")
            .args(["-js", "-a", "127.0.0.1", "-p", &port.to_string(), "-sd"])
            .arg(folder)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn();
        let Ok(child) = child else { return Ok(None) };
        let server = Self { child, port };
        let since = Instant::now();
        while TcpStream::connect(("127.0.0.1", port)).is_err() {
            if since.elapsed() > Duration::from_secs(20) {
                return Err(failed(anyhow!("nats-server does not start")));
            }
            std::thread::sleep(LOOK);
        }
        Ok(Some(server))
    }

    pub(super) fn pid(&self) -> u32 {
        self.child.id()
    }

    pub(super) fn url(&self) -> String {
        format!("nats://127.0.0.1:{}", self.port)
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
