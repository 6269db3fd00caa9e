//! What is done of a run, read from its folder.

use super::quarantine::QuarantineRecord;
use super::run_dir::Run;
use render::line::SceneLine;
use render::merge::is_written;
use serde::Serialize;

/// Counts of a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RunStatus {
    /// Scenes of the manifest.
    pub scenes: u64,
    /// Scenes with a tuple.
    pub merged: u64,
    /// Scenes with some shards done and no tuple yet.
    pub started: u64,
    /// Scenes of which nothing is there.
    pub waiting: u64,
    /// Shards of the manifest.
    pub shards: u64,
    /// Shards done: those of merged scenes, and partials.
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
    count(run, |line| {
        if is_written(&run.dir.tuple(&line.id), line) {
            return Found::Tuple;
        }
        if let Some(record) = QuarantineRecord::read(&run.dir, &line.id) {
            return Found::Quarantine(record.reason);
        }
        let shards = 0..run.layout(line).len();
        let there = shards.filter(|&s| run.dir.partial(&line.id, s).is_file());
        Found::Partials(there.count() as u64)
    })
}

/// What there is of a scene.
pub(crate) enum Found {
    /// Its tuple.
    Tuple,
    /// A record of quarantine, with its reason.
    Quarantine(String),
    /// So many partials.
    Partials(u64),
}

/// Adds up what is found of each scene.
pub(crate) fn count(run: &Run, mut find: impl FnMut(&SceneLine) -> Found) -> RunStatus {
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
        match find(line) {
            Found::Tuple => {
                status.merged += 1;
                status.shards_done += shards;
            }
            Found::Quarantine(reason) => status.quarantined.push(Quarantined {
                scene: line.id.to_string(),
                reason,
            }),
            Found::Partials(there) => {
                status.shards_done += there;
                status.started += u64::from(there > 0);
                status.waiting += u64::from(there == 0);
            }
        }
    }
    status
}
