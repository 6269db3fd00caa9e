//! What is done of a run, read from its folder.

use super::quarantine::QuarantineRecord;
use super::run_dir::Run;
use crate::merge::is_written;
use serde::Serialize;

/// Counts of a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RunStatus {
    /// Scenes of the manifest.
    pub scenes: u64,
    /// Scenes with a tuple.
    pub merged: u64,
    /// Scenes with some, not all, shards on disk.
    pub started: u64,
    /// Scenes of which nothing is there.
    pub waiting: u64,
    /// Shards of the manifest.
    pub shards: u64,
    /// Shards done: those of merged scenes, and partials on disk.
    pub shards_done: u64,
    /// Scenes in quarantine.
    pub quarantined: Vec<Quarantined>,
}

/// A scene in quarantine.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Quarantined {
    /// Its id.
    pub scene: String,
    /// Why.
    pub reason: String,
}

impl RunStatus {
    /// Nothing is left to do.
    pub fn is_finished(&self) -> bool {
        self.merged + self.quarantined.len() as u64 == self.scenes
    }
}

/// Looks at a run's folder. Partials are counted, not checked.
pub fn run_status(run: &Run) -> RunStatus {
    let mut status = RunStatus {
        scenes: run.lines.len() as u64,
        merged: 0,
        started: 0,
        waiting: 0,
        shards: 0,
        shards_done: 0,
        quarantined: Vec::new(),
    };
    for line in &run.lines {
        let shards = u64::from(run.layout(line).len());
        status.shards += shards;
        if is_written(&run.dir.tuple(&line.id), line) {
            status.merged += 1;
            status.shards_done += shards;
        } else if let Some(record) = QuarantineRecord::read(&run.dir, &line.id) {
            status.quarantined.push(Quarantined {
                scene: line.id.to_string(),
                reason: record.reason,
            });
        } else {
            let done = (0..shards as u32)
                .filter(|&s| run.dir.partial(&line.id, s).is_file())
                .count();
            status.shards_done += done as u64;
            if done > 0 {
                status.started += 1;
            } else {
                status.waiting += 1;
            }
        }
    }
    status
}
