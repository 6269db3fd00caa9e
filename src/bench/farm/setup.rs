//! Inputs and conditions of a farm measurement.

use serde::Serialize;
use std::fmt;
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// Receiver of a measurement's progress.
pub trait Watcher: Sync {
    fn starts(&self, parts: u64);
    /// Names the part that starts now.
    fn measures(&self, what: &str);
    fn part_is_done(&self);
}

pub struct Setup<'a> {
    pub program: &'a Path,
    /// Address of a NATS server; `None` to start `nats-server`, if it is installed.
    pub queue: Option<&'a str>,
    /// Name of the processor, if known.
    pub cpu: Option<String>,
    /// Flag that stops the measurement after a signal.
    pub stop: &'a AtomicBool,
    pub watcher: &'a dyn Watcher,
}

/// Mode, queue and processor of a measurement.
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

    /// True if the measurement had a NATS server.
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
