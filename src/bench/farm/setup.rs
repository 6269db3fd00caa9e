//! What a farm is measured with.

use serde::Serialize;
use std::fmt;
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// Follows a measurement, which consists of parts.
pub trait Watcher: Sync {
    /// There will be so many parts.
    fn starts(&self, parts: u64);
    /// What is measured from now on.
    fn measures(&self, what: &str);
    fn part_is_done(&self);
}

/// What a farm is measured with.
pub struct Setup<'a> {
    /// This program, of which processes are started.
    pub program: &'a Path,
    /// Address of a NATS server; if `None`, one is started if `nats-server` is installed.
    pub queue: Option<&'a str>,
    /// The processor's name, for the result.
    pub cpu: Option<String>,
    /// Stops the measurement when a signal has set it.
    pub stop: &'a AtomicBool,
    pub watcher: &'a dyn Watcher,
}

/// How the figures beside it were measured.
#[derive(Clone, Debug, Serialize)]
pub struct Conditions {
    measured: bool,
    mode: &'static str,
    queue: &'static str,
    cpu: Option<String>,
}

impl Conditions {
    pub(super) fn new(mode: &'static str, queue: &'static str, cpu: Option<String>) -> Self {
        Self { measured: true, mode, queue, cpu }
    }

    /// There was a queue that processes share.
    pub fn has_queue(&self) -> bool {
        self.queue != super::place::NO_QUEUE
    }
}

impl fmt::Display for Conditions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.queue)?;
        self.cpu.iter().try_for_each(|cpu| write!(f, " on {cpu}"))
    }
}
