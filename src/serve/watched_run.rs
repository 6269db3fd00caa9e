//! Makes the view of a run from its coordinator's observations.

use super::action::Action;
use super::server::FarmSource;
use super::view::{
    Count, FARM_SCHEMA, FarmView, QuarantinedScene, QueueView, RecentTuple, WorkerState, WorkerView,
};
use crate::farm::Watch;
use crate::run::{ControlState, RetryScenes, Run, RunState, Snapshot, keys, retry, set_control};
use crate::store::Store;
use glasshouse_line::ids::SceneId;
use std::collections::BTreeMap;
use std::io::Cursor;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

const RECENT: usize = 12;
/// Maximum side of a thumbnail, px.
const THUMBNAIL_PX: u32 = 256;

/// The source of a run's views: its coordinator's observations and its store.
pub struct WatchedRun {
    name: String,
    id: String,
    scenes: Vec<SceneId>,
    layers: Vec<Vec<String>>,
    store: Store,
    watch: Arc<Mutex<Watch>>,
    /// Time without a sign of life after which a worker with a task counts as lost.
    silence: Duration,
}

impl WatchedRun {
    /// Creates the source of a run; [`crate::farm::coordinate()`] keeps `watch` up to date.
    pub fn new(run: &Run, store: &Store, watch: &Arc<Mutex<Watch>>, silence: Duration) -> Self {
        let names = |line: &glasshouse_line::SceneLine| {
            let names = line.film.layers.names();
            names.map(str::to_owned).collect()
        };
        let digest = run.id().iter().fold(String::new(), |hex, b| format!("{hex}{b:02x}"));
        let folder = run.root().file_name();
        Self {
            name: folder.map_or_else(|| "run".to_owned(), |n| n.to_string_lossy().into_owned()),
            id: digest,
            scenes: run.lines.iter().map(|line| line.id.clone()).collect(),
            layers: run.lines.iter().map(names).collect(),
            store: store.clone(),
            watch: Arc::clone(watch),
            silence,
        }
    }
}

/// Creates the view of a worker with only its name and its machine known.
fn new_worker(name: &str, host: &str) -> WorkerView {
    WorkerView {
        name: name.to_owned(),
        host: host.to_owned(),
        version: String::new(),
        state: WorkerState::Idle,
        last_progress_s: f64::INFINITY,
        scene: None,
        shard: None,
        shards_done: 0,
    }
}

impl WatchedRun {
    /// Lists the workers that have made a tuple since this process started, or have held a task.
    fn workers(&self, snapshot: &Snapshot, state: RunState) -> Vec<WorkerView> {
        let seconds = |at: Instant| at.elapsed().as_secs_f64();
        let mut workers: BTreeMap<&str, WorkerView> = BTreeMap::new();
        for tuple in snapshot.tuples() {
            let provenance = snapshot.provenance(tuple.scene);
            let (Some(provenance), Some(seen)) = (provenance, tuple.seen) else {
                continue;
            };
            let Some(worker) = &provenance.worker else {
                continue;
            };
            let host = provenance.host.as_deref().unwrap_or_default();
            let view = workers.entry(worker).or_insert_with(|| new_worker(worker, host));
            view.version = provenance.version.clone().unwrap_or_default();
            view.shards_done += u64::from(snapshot.shards(tuple.scene));
            view.last_progress_s = view.last_progress_s.min(seconds(seen));
        }
        for (name, seen) in snapshot.workers_seen() {
            let view = workers.entry(name).or_insert_with(|| new_worker(name, &seen.host));
            view.last_progress_s = seconds(seen.last);
            let is_over = state == RunState::Finished;
            let Some((scene, shard)) = seen.task.as_ref().filter(|_| !is_over) else {
                continue;
            };
            (view.scene, view.shard) = (Some(scene.clone()), Some(*shard));
            let is_lost = snapshot.is_lost(seen, self.silence);
            view.state = if is_lost { WorkerState::Lost } else { WorkerState::Working };
        }
        workers.into_values().collect()
    }

    fn recent(&self, snapshot: &Snapshot) -> Vec<RecentTuple> {
        let newest = snapshot.tuples().iter().rev().take(RECENT);
        let recent = newest.map(|tuple| RecentTuple {
            scene: self.scenes[tuple.scene].clone(),
            age_s: tuple.seen.map_or(0.0, |at| at.elapsed().as_secs_f64()),
            worker: snapshot.provenance(tuple.scene).and_then(|made| made.worker.clone()),
            miss_share: None,
            layers: self.layers[tuple.scene].clone(),
        });
        recent.collect()
    }

    fn quarantine(&self, snapshot: &Snapshot) -> Vec<QuarantinedScene> {
        let scenes = self.scenes.iter().enumerate();
        let view = |(index, scene): (usize, &SceneId)| {
            Some(QuarantinedScene {
                scene: scene.clone(),
                reason: snapshot.reason(index)?.to_owned(),
                log_tail: None,
            })
        };
        scenes.filter_map(view).collect()
    }
}

impl FarmSource for WatchedRun {
    fn view(&self) -> FarmView {
        let watch = self.watch.lock().expect("no holder of this lock panics");
        let snapshot = &watch.snapshot;
        let status = snapshot.status();
        let counts = &status.counts;
        FarmView {
            schema: FARM_SCHEMA,
            name: self.name.clone(),
            run: self.id.clone(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            state: status.state,
            scenes: Count { done: counts.merged, total: counts.scenes },
            shards: Count { done: counts.shards_done, total: counts.shards },
            quarantined: counts.quarantined.len() as u64,
            rate_scenes_per_s: status.rate_scenes_per_s,
            eta_s: status.eta_s,
            queue: QueueView {
                connected: watch.queue_lost.is_none(),
                reason: watch.queue_lost.clone(),
                spans_waiting: Some(watch.queue.waiting),
                spans_held: Some(watch.queue.held),
            },
            workers: self.workers(snapshot, status.state),
            quarantine: self.quarantine(snapshot),
            recent: self.recent(snapshot),
        }
    }

    fn thumbnail(&self, scene: &SceneId, layer: &str) -> Option<Vec<u8>> {
        let png = self.store.get(&keys::tuple(scene, &format!("{layer}.png"))).ok()??;
        let image = image::load_from_memory_with_format(&png, image::ImageFormat::Png).ok()?;
        if image.width() <= THUMBNAIL_PX && image.height() <= THUMBNAIL_PX {
            return Some(png.to_vec());
        }
        let mut bytes = Cursor::new(Vec::new());
        image
            .thumbnail(THUMBNAIL_PX, THUMBNAIL_PX)
            .write_to(&mut bytes, image::ImageFormat::Png)
            .ok()?;
        Some(bytes.into_inner())
    }

    fn act(&self, action: Action) -> Result<(), String> {
        let tell = |state| {
            set_control(&self.store, state, None, false).map_err(|e| e.to_string())?;
            self.watch.lock().expect("no holder of this lock panics").set_control(state);
            Ok(())
        };
        match action {
            Action::Pause => tell(ControlState::Paused),
            Action::Resume => tell(ControlState::Running),
            Action::Cancel => tell(ControlState::Cancelled),
            Action::Retry(scene) => {
                let scenes = [scene];
                let which = RetryScenes::These(&scenes);
                let done = retry(&self.store, &self.scenes, which, false);
                done.map(|_| ()).map_err(|e| e.to_string())
            }
        }
    }
}
