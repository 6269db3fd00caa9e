//! Progress of a run: finished scenes, their workers, and the rate. It is read from the store and refreshed by reading
//! only new objects. `status`, the page, metrics, the report, the coordinator and exit codes all use it.
//!
//! `state` names the states, `refresh` reads the store, `status` adds up.

mod refresh;
mod state;
mod status;

pub use state::{Counts, Quarantined, RunState, SceneState};
pub use status::{StandingAttempt, Status, WorkerTuples};

use super::attempts::AttemptRecord;
use super::control::Control;
use super::open::Run;
use super::provenance::Provenance;
use crate::store::{Store, StoreError};
use render::ids::SceneId;
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::{Instant, SystemTime};

/// Objects that a snapshot reads in addition to tuples and quarantine records.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Scope {
    /// The record of each tuple, to check that it belongs to this manifest and this version of the tracer. Local
    /// stores, where reading is cheap, always check it; in other stores the names of the files decide without it.
    pub records: bool,
    pub partials: bool,
    /// Attempts and provenance.
    pub workers: bool,
}

impl Scope {
    /// For a reliable list of finished scenes.
    pub const DONE: Self = Self { records: true, partials: false, workers: false };
    /// For the number of finished scenes and shards.
    pub const COUNTS: Self = Self { records: false, partials: true, workers: false };
    pub const STATUS: Self = Self { records: false, partials: true, workers: true };
}

/// A run at the time of the last refresh.
#[derive(Clone, Debug)]
pub struct Snapshot {
    scope: Scope,
    plan: Arc<Plan>,
    /// By index in the manifest.
    scenes: Vec<Scene>,
    /// In the order in which they were seen.
    tuples: Vec<SeenTuple>,
    attempts: BTreeMap<String, SeenAttempt>,
    pub control: Control,
    /// Shards done at the refreshes of the last minutes.
    history: VecDeque<(Instant, u64)>,
}

/// The unchanging part of a snapshot.
#[derive(Debug)]
struct Plan {
    ids: Vec<SceneId>,
    shards: Vec<u32>,
    /// Indices, sorted by id.
    by_id: Vec<usize>,
}

#[derive(Clone, Debug, Default)]
struct Scene {
    is_done: bool,
    /// Why it is in quarantine.
    reason: Option<Arc<str>>,
    partials: u32,
    /// When its provenance was put.
    receipt: Option<SystemTime>,
    provenance: Option<Arc<Provenance>>,
}

/// A tuple in the store.
#[derive(Clone, Copy, Debug)]
pub struct SeenTuple {
    /// Index of its scene in the manifest.
    pub scene: usize,
    /// When this process saw it first; `None` if it was there at the first refresh.
    pub seen: Option<Instant>,
    /// When it was put, by the store's clock.
    put: SystemTime,
}

/// An attempt in the store.
#[derive(Clone, Debug)]
pub struct SeenAttempt {
    pub record: AttemptRecord,
    /// When this process saw this record first.
    pub seen: Instant,
    /// When it was put, by the store's clock.
    put: SystemTime,
}

impl Snapshot {
    /// An empty snapshot, before the first refresh.
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
            control: Control::default(),
            history: VecDeque::new(),
        }
    }

    /// Reads the store once.
    pub fn take(run: &Run, store: &Store, scope: Scope) -> Result<Self, StoreError> {
        let mut snapshot = Self::new(run, scope);
        snapshot.refresh(run, store)?;
        Ok(snapshot)
    }

    /// The state of the scene with this index in the manifest, as far as the scope shows it.
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

    /// The scene has a tuple.
    pub fn is_done(&self, index: usize) -> bool {
        self.scenes[index].is_done
    }

    /// Why the scene is in quarantine, if it is and has no tuple.
    pub fn reason(&self, index: usize) -> Option<&str> {
        let scene = &self.scenes[index];
        scene.reason.as_deref().filter(|_| !scene.is_done)
    }

    /// Scenes that are neither done nor in quarantine.
    pub fn missing(&self) -> impl Iterator<Item = usize> {
        let scenes = self.scenes.iter().enumerate();
        let missing = scenes.filter(|(_, scene)| !scene.is_done && scene.reason.is_none());
        missing.map(|(index, _)| index)
    }

    /// Every scene is done or in quarantine.
    pub fn is_finished(&self) -> bool {
        self.missing().next().is_none()
    }

    /// Shards of a scene.
    pub fn shards(&self, index: usize) -> u32 {
        self.plan.shards[index]
    }

    /// Provenance of the scene's tuple, if the scope includes it.
    pub fn provenance(&self, index: usize) -> Option<&Provenance> {
        self.scenes[index].provenance.as_deref()
    }

    /// All tuples, in the order in which this process saw them.
    pub fn tuples(&self) -> &[SeenTuple] {
        &self.tuples
    }

    /// Attempts at scenes without a tuple.
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
