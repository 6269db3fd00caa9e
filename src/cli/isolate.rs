//! A worker's child process, which traces a task that was lost with an earlier process.
//!
//! The child is `work --only SCENE:A-B` on the same run and store. It prints a line when it renews its lease, a line
//! with `hung` if it makes no progress, and finally its outcome as JSON.

use super::args::{CacheArgs, QueueArgs};
use crate::farm::{Fault, Sandbox, SandboxEnd};
use crate::pipe::lines;
use crate::run::{EndKind, Ending, Task};
use crossbeam::channel::{Receiver, RecvTimeoutError};
use glasshouse_line::ids::SceneId;
use serde_json::Value;
use std::collections::VecDeque;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// Line that the child prints as a sign of life.
pub(super) const SIGN: &str = "alive";
/// Prefix of the line that the child prints before it exits because it hangs.
pub(super) const HUNG: &str = "hung: ";
/// Number of lines to keep from the end of a child's messages.
const TAIL_LINES: usize = 20;

/// Shards A to B - 1 of a scene, from the argument `SCENE:A-B`.
#[derive(Clone, Debug)]
pub(super) struct Only {
    pub(super) scene: String,
    pub(super) shards: std::ops::Range<u32>,
}

impl std::str::FromStr for Only {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.split_once(':');
        let parts = parts.and_then(|(scene, shards)| Some((scene, shards.split_once('-')?)));
        match parts.map(|(scene, (a, b))| (scene, a.parse(), b.parse())) {
            Some((scene, Ok(start), Ok(end))) if start < end => {
                Ok(Self { scene: scene.to_owned(), shards: start..end })
            }
            _ => Err(format!("{text:?} is not SCENE:A-B with A below B")),
        }
    }
}

pub(super) struct Children<'a> {
    pub(super) run: &'a Path,
    pub(super) roots: &'a [String],
    pub(super) cache: Option<&'a CacheArgs>,
    pub(super) queue: Option<&'a QueueArgs>,
    pub(super) threads: usize,
    pub(super) isa: String,
    pub(super) hang: Duration,
    pub(super) name: &'a str,
    pub(super) faults: &'a [Fault],
}

impl Children<'_> {
    fn command(&self, only: &Only) -> std::io::Result<Command> {
        let program: PathBuf = std::env::current_exe()?;
        let mut command = Command::new(program);
        command.arg("work").arg(self.run);
        let Only { scene, shards } = only;
        command.args(["--only", &format!("{scene}:{}-{}", shards.start, shards.end)]);
        command.args(["--json", "--progress", "none", "--isa", &self.isa]);
        command.args(["-j", &self.threads.to_string(), "--name", self.name]);
        command.args(["--hang-s", &self.hang.as_secs_f64().to_string()]);
        // The child writes each finished shard at once, because it may die.
        command.args(["--checkpoint-s", "0"]);
        for root in self.roots {
            command.args(["--root", root]);
        }
        for fault in self.faults {
            command.args(["--fault", &fault.to_string()]);
        }
        if let Some(cache) = self.cache {
            if let Some(folder) = &cache.cache {
                command.arg("--cache").arg(folder);
            }
            command.args(["--cache-gb", &cache.cache_gb.to_string()]);
        }
        // A backtrace would displace the messages that name the cause.
        command.env("RUST_BACKTRACE", "0");
        // A URL may contain a password, and other users can see command lines but not the environment.
        command.env_remove("GLASSHOUSE_QUEUE").env_remove("GLASSHOUSE_STORE");
        if let Some(QueueArgs { queue: Some(url), store, store_patience_s, .. }) = self.queue {
            let patience = store_patience_s.as_secs_f64().to_string();
            command.args(["--store-patience-s", &patience]);
            command.env("GLASSHOUSE_QUEUE", url);
            if let Some(store) = store {
                command.env("GLASSHOUSE_STORE", store);
            }
        }
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        Ok(command)
    }
}

impl Sandbox for Children<'_> {
    fn trace(
        &self,
        scene: &SceneId,
        task: &Task,
        on_sign: &dyn Fn(),
        must_stop: &dyn Fn() -> bool,
    ) -> SandboxEnd {
        let only = Only { scene: scene.to_string(), shards: task.shards.clone() };
        let started = self.command(&only).and_then(|mut command| command.spawn());
        let mut child = match started {
            Ok(child) => child,
            Err(error) => return SandboxEnd::Failed(format!("it cannot be started: {error}")),
        };
        let messages = lines(child.stderr.take());
        let lines = lines(child.stdout.take());
        let mut last = String::new();
        let mut hung = None;
        let mut heard = Instant::now();
        loop {
            match lines.recv_timeout(Duration::from_millis(50)) {
                Ok(line) => {
                    heard = Instant::now();
                    if let Some(reason) = line.strip_prefix(HUNG) {
                        hung = Some(reason.to_owned());
                    } else if line != SIGN {
                        last.push_str(&line);
                    }
                    on_sign();
                }
                Err(RecvTimeoutError::Disconnected) => break,
                Err(RecvTimeoutError::Timeout) if must_stop() => {
                    end(&mut child);
                    return SandboxEnd::Stopped;
                }
                Err(RecvTimeoutError::Timeout) if heard.elapsed() > self.hang => {
                    let reason =
                        format!("it printed no sign of life for {} s", self.hang.as_secs_f64());
                    hung = Some(reason);
                    end(&mut child);
                    break;
                }
                Err(RecvTimeoutError::Timeout) => {}
            }
        }
        let status = match child.wait() {
            Ok(status) => status,
            Err(error) => return SandboxEnd::Failed(error.to_string()),
        };
        let log_tail = tail(&messages);
        let lost = |kind, reason| {
            let ending = Ending { kind, reason, log_tail: log_tail.clone() };
            SandboxEnd::Lost(ending)
        };
        match (hung, status.code()) {
            (Some(reason), _) => lost(EndKind::Hung, reason),
            (None, None) => lost(EndKind::Crashed, signal(status)),
            (None, Some(0 | 3)) => done(&last),
            // The terminal sends its signals to all processes of the group.
            (None, Some(75 | 130 | 143)) => SandboxEnd::Stopped,
            (None, Some(code)) => {
                SandboxEnd::Failed(format!("it ended with {code}: {}", log_tail.trim_end()))
            }
        }
    }
}

fn end(child: &mut Child) {
    // Results that the child has stored are durable; the rest is traced again.
    let _ = child.kill();
    let _ = child.wait();
}

fn signal(status: ExitStatus) -> String {
    let number = status.signal().unwrap_or(0);
    let name = signal_hook::low_level::signal_name(number).unwrap_or("unknown");
    let hint = if name == "SIGKILL" { ": possibly out of memory" } else { "" };
    format!("its process was killed by signal {number} ({name}){hint}")
}

fn done(outcome: &str) -> SandboxEnd {
    let Ok(outcome) = serde_json::from_str::<Value>(outcome) else {
        return SandboxEnd::Failed("it ended without an outcome".to_owned());
    };
    let count = |key: &str| outcome[key].as_u64().unwrap_or(0);
    SandboxEnd::Done {
        merged: count("merged"),
        traced: count("shards_traced"),
        resumed: count("shards_resumed"),
        loaded: count("scenes_loaded"),
        quarantined: outcome["quarantined"][0]["reason"].as_str().map(str::to_owned),
    }
}

fn tail(messages: &Receiver<String>) -> String {
    let mut last = VecDeque::new();
    for line in messages {
        if last.len() == TAIL_LINES {
            last.pop_front();
        }
        let line: String = line.chars().take(400).collect();
        last.push_back(line + "\n");
    }
    last.into_iter().collect()
}
