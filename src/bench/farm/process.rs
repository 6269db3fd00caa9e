//! A process of the measured farm, killed on drop.

use super::error::FarmBenchError;
use super::place::Place;
use crate::pipe::lines;
use crossbeam::channel::Receiver;
use serde_json::Value;
use std::process::{Child, Command, ExitStatus};
use std::time::{Duration, Instant};

/// Start of the message of `work -v` that reports a ready worker; measurements wait for it.
pub const WORK_BEGINS: &str = "work begins on ";
/// End of the message of `work -v` about a loaded scene; measurements wait for such messages and count them.
pub const SCENE_LOADED: &str = " is loaded";

/// Duration after which a process counts as hung.
const TOO_LONG: Duration = Duration::from_mins(10);
/// Interval between polls of a process.
const POLL: Duration = Duration::from_millis(5);

pub(super) struct Process<'a> {
    place: &'a Place<'a>,
    child: Child,
    stdout: Receiver<String>,
    stderr: Receiver<String>,
    said: Vec<String>,
    since: Instant,
}

impl<'a> Process<'a> {
    pub(super) fn start(
        place: &'a Place<'a>,
        mut command: Command,
    ) -> Result<Self, FarmBenchError> {
        let since = Instant::now();
        let child = command.spawn();
        let mut child = child.map_err(FarmBenchError::system("start another process"))?;
        Ok(Self {
            place,
            stdout: lines(child.stdout.take()),
            stderr: lines(child.stderr.take()),
            said: Vec::new(),
            child,
            since,
        })
    }

    /// Returns the time since the start.
    pub(super) fn age(&self) -> Duration {
        self.since.elapsed()
    }

    /// Waits for a line of `-v` that contains `what`. Fails if the process ends or hangs before.
    pub(super) fn wait_until_it_says(&mut self, what: &str) -> Result<(), FarmBenchError> {
        loop {
            self.place.go_on()?;
            match self.stderr.recv_timeout(POLL) {
                Ok(line) => {
                    let found = line.contains(what);
                    self.said.push(line);
                    if found {
                        return Ok(());
                    }
                }
                Err(error) if error.is_disconnected() => return Err(self.failed("ended")),
                Err(_) if self.age() > TOO_LONG => return Err(self.failed("hangs")),
                Err(_) => {}
            }
        }
    }

    fn failed(&mut self, how: &str) -> FarmBenchError {
        self.said.extend(self.stderr.try_iter());
        let last = self.said.len().saturating_sub(5);
        FarmBenchError::Process { how: how.to_owned(), said: self.said[last..].join("; ") }
    }

    /// Kills the process with SIGKILL.
    pub(super) fn kill(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }

    /// Counts the loaded scenes in the messages of `-v`.
    pub(super) fn loads(&mut self) -> u64 {
        self.said.extend(self.stderr.try_iter());
        let is_load = |line: &&String| line.ends_with(SCENE_LOADED);
        self.said.iter().filter(is_load).count() as u64
    }

    pub(super) fn terminate(mut self) -> Result<(), FarmBenchError> {
        if let Some(pid) = rustix::process::Pid::from_raw(self.child.id() as i32) {
            let _ = rustix::process::kill_process(pid, rustix::process::Signal::TERM);
        }
        self.wait().map(|_| ())
    }

    fn wait(&mut self) -> Result<ExitStatus, FarmBenchError> {
        loop {
            let status = self.child.try_wait();
            let status = status.map_err(FarmBenchError::system("wait for a process"))?;
            match status {
                Some(status) => return Ok(status),
                None if self.age() > TOO_LONG => return Err(self.failed("hangs")),
                None => {}
            }
            self.place.go_on()?;
            std::thread::sleep(POLL);
        }
    }

    /// Waits for exit code 0; returns the printed JSON and the duration.
    pub(super) fn result(mut self) -> Result<(Value, Duration), FarmBenchError> {
        let status = self.wait()?;
        let took = self.age();
        if !status.success() {
            return Err(self.failed(&format!("ended with {status}")));
        }
        let text: Vec<String> = self.stdout.iter().collect();
        match serde_json::from_str(&text.join("\n")) {
            Ok(value) => Ok((value, took)),
            Err(error) => Err(self.failed(&format!("printed no JSON ({error})"))),
        }
    }
}

impl Drop for Process<'_> {
    fn drop(&mut self) {
        self.kill();
    }
}
