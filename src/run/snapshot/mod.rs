//! Progress of a run: finished scenes, their workers, and the rate. A snapshot comes from the store; a refresh lists
//! the keys and reads new objects. The `status` command, the page, the metrics, the report, the coordinator and the
//! exit codes all use snapshots.
//!
//! The module `state` defines the states, `refresh` reads the store, `roster` follows the workers, and `status` computes
//! the numbers.

mod refresh;
mod roster;
mod state;
mod status;

pub use roster::SeenWorker;
pub use state::{Counts, Quarantined, RunState, SceneState};
pub use status::{StandingAttempt, Status, WorkerTuples};

use super::attempts::AttemptRecord;
use super::control::Control;
use super::open::Run;
use super::provenance::Provenance;
use crate::store::{Store, StoreError};
use glasshouse_line::ids::SceneId;
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::{Instant, SystemTime};

/// Objects that a snapshot covers besides the lists of tuples and receipts, the quarantine records and the control.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Scope {
    /// Record of each tuple, to check that the tuple belongs to this manifest and this version of the tracer. Snapshots
    /// of local stores, where reading is cheap, always check it.
    pub records: bool,
    pub partials: bool,
    /// Records of attempts and provenance.
    pub workers: bool,
}

impl Scope {
    /// Scope for a reliable list of finished scenes.
    pub const DONE: Self = Self { records: true, partials: false, workers: false };
    /// Scope for the numbers of finished scenes and shards.
    pub const COUNTS: Self = Self { records: false, partials: true, workers: false };
    pub const STATUS: Self = Self { records: false, partials: true, workers: true };
}

/// A run at the time of the last refresh.
#[derive(Clone, Debug, Default)]
pub struct Snapshot {
    scope: Scope,
    plan: Arc<Plan>,
    /// Scenes, by index in the manifest.
    scenes: Vec<Scene>,
    /// Tuples, in the order in which this process saw them.
    tuples: Vec<SeenTuple>,
    attempts: BTreeMap<String, SeenAttempt>,
    roster: BTreeMap<String, SeenWorker>,
    /// Time at which the last refresh listed the attempts.
    listed: Option<Instant>,
    pub control: Control,
    /// Time of each refresh of the last minutes, and the number of finished shards.
    history: VecDeque<(Instant, u64)>,
}

/// The unchanging part of a snapshot.
#[derive(Debug, Default)]
struct Plan {
    ids: Vec<SceneId>,
    shards: Vec<u32>,
    /// Indices of the scenes, sorted by id.
    by_id: Vec<usize>,
}

#[derive(Clone, Debug, Default)]
struct Scene {
    is_done: bool,
    /// Reason for the quarantine, if any.
    reason: Option<Arc<str>>,
    partials: u32,
    /// Time when the provenance was put.
    receipt: Option<SystemTime>,
    provenance: Option<Arc<Provenance>>,
}

#[derive(Clone, Copy, Debug)]
pub struct SeenTuple {
    /// Index of the tuple's scene in the manifest.
    pub scene: usize,
    /// Time when this process first saw the tuple; `None` if the first refresh found it.
    pub seen: Option<Instant>,
    /// Time of the put, by the store's clock.
    put: SystemTime,
}

#[derive(Clone, Debug)]
pub struct SeenAttempt {
    pub record: AttemptRecord,
    /// Time when this process first saw this record or the newest sign of life of its worker.
    pub signed: Instant,
    /// Time of the put, by the store's clock.
    put: SystemTime,
    /// Time of the sign of life, by the store's clock, if there is one.
    sign: Option<SystemTime>,
}

impl Snapshot {
    /// Makes an empty snapshot, for the first refresh to fill.
    pub fn new(run: &Run, scope: Scope) -> Self {
        let ids: Vec<SceneId> = run.lines.iter().map(|line| line.id.clone()).collect();
        let mut by_id: Vec<usize> = (0..ids.len()).collect();
        by_id.sort_by_key(|&scene| &ids[scene]);
        let shards = run.lines.iter().map(|line| run.layout(line).len());
        Self {
            scope,
            scenes: vec![Scene::default(); ids.len()],
            plan: Arc::new(Plan { shards: shards.collect(), by_id, ids }),
            tuples: Vec::new(),
            attempts: BTreeMap::new(),
            roster: BTreeMap::new(),
            listed: None,
            control: Control::default(),
            history: VecDeque::new(),
        }
    }

    /// Makes a snapshot and refreshes it once.
    pub fn take(run: &Run, store: &Store, scope: Scope) -> Result<Self, StoreError> {
        let mut snapshot = Self::new(run, scope);
        snapshot.refresh(run, store)?;
        Ok(snapshot)
    }

    /// Returns the state of the scene with this index in the manifest, as far as the scope shows it.
    pub fn scene(&self, index: usize) -> SceneState {
        let scene = &self.scenes[index];
        if scene.is_done {
            return SceneState::Done;
        }
        let has_attempts = || {
            let id = &self.plan.ids[index];
            self.attempts.values().any(|seen| seen.record.scene == *id)
        };
        SceneState::of_unfinished(
            scene.reason.is_some(),
            scene.partials,
            self.plan.shards[index],
            scene.partials == 0 && has_attempts(),
        )
    }

    /// True if the scene has a tuple.
    pub fn is_done(&self, index: usize) -> bool {
        self.scenes[index].is_done
    }

    /// Returns the reason for the quarantine of a scene without a tuple.
    pub fn reason(&self, index: usize) -> Option<&str> {
        let scene = &self.scenes[index];
        scene.reason.as_deref().filter(|_| !scene.is_done)
    }

    /// Returns the indices of the scenes that are neither done nor in quarantine.
    pub fn missing(&self) -> impl Iterator<Item = usize> {
        let scenes = self.scenes.iter().enumerate();
        let missing = scenes.filter(|(_, scene)| !scene.is_done && scene.reason.is_none());
        missing.map(|(index, _)| index)
    }

    /// True if every scene is done or in quarantine.
    pub fn is_finished(&self) -> bool {
        self.missing().next().is_none()
    }

    /// Returns the number of shards of a scene.
    pub fn shards(&self, index: usize) -> u32 {
        self.plan.shards[index]
    }

    /// Returns the provenance of the scene's tuple, if it has one and the scope includes workers.
    pub fn provenance(&self, index: usize) -> Option<&Provenance> {
        self.scenes[index].provenance.as_deref()
    }

    /// Returns all tuples, in the order in which this process saw them.
    pub fn tuples(&self) -> &[SeenTuple] {
        &self.tuples
    }

    /// Returns the attempts at scenes without a tuple.
    pub fn attempts(&self) -> impl Iterator<Item = &SeenAttempt> {
        self.attempts.values().filter(|seen| {
            let scene = self.plan.index(seen.record.scene.as_str());
            scene.is_none_or(|scene| !self.scenes[scene].is_done)
        })
    }
}

impl Plan {
    fn index(&self, scene: &str) -> Option<usize> {
        let found = self.by_id.binary_search_by(|&index| self.ids[index].as_str().cmp(scene));
        found.ok().map(|at| self.by_id[at])
    }
}
