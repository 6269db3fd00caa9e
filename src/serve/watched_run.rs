//! The view of a run, from what its coordinator has seen.

use super::action::Action;
use super::server::FarmSource;
use super::view::{
    Count, FARM_SCHEMA, FarmView, QuarantinedScene, QueueView, RecentTuple, WorkerState, WorkerView,
};
use crate::run::{
    ControlState, FarmState, RetryScenes, Run, SeenAttempt, Watch, keys, retry, set_control,
};
use crate::store::Store;
use render::ids::SceneId;
use std::collections::BTreeMap;
use std::io::Cursor;
use std::sync::{Arc, Mutex};
use std::time::Instant;

/// Tuples shown.
const RECENT: usize = 12;
/// Side of a thumbnail, px.
const THUMBNAIL_PX: u32 = 256;

/// A run as its coordinator sees it.
pub struct WatchedRun {
    name: String,
    id: String,
    scenes: Vec<SceneId>,
    layers: Vec<Vec<String>>,
    shards: Vec<u32>,
    store: Store,
    watch: Arc<Mutex<Watch>>,
    /// A worker that made no tuple for so many seconds is shown as silent.
    silent_s: f64,
}

impl WatchedRun {
    /// `watch` is what [`crate::farm::coordinate()`] keeps up to date.
    pub fn new(run: &Run, store: &Store, watch: &Arc<Mutex<Watch>>, silent_s: f64) -> Self {
        let names = |line: &render::line::SceneLine| {
            let names = line.film.layers.names();
            names.map(str::to_owned).collect()
        };
        let digest = run
            .id()
            .iter()
            .fold(String::new(), |hex, b| format!("{hex}{b:02x}"));
        let folder = run.dir.root().file_name();
        Self {
            name: folder.map_or_else(|| "run".to_owned(), |n| n.to_string_lossy().into_owned()),
            id: digest,
            scenes: run.lines.iter().map(|line| line.id.clone()).collect(),
            layers: run.lines.iter().map(names).collect(),
            shards: run
                .lines
                .iter()
                .map(|line| run.layout(line).len())
                .collect(),
            store: store.clone(),
            watch: Arc::clone(watch),
            silent_s,
        }
    }
}

/// A worker, as long as only its name and machine are known.
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

impl FarmSource for WatchedRun {
    fn view(&self) -> FarmView {
        let watch = self.watch.lock().expect("no holder of this lock panics");
        let seconds = |at: Instant| at.elapsed().as_secs_f64();
        let left = (watch.scenes - watch.done - watch.quarantined) as f64;
        let mut workers: BTreeMap<&str, WorkerView> = BTreeMap::new();
        let mut shards_done = 0;
        for tuple in &watch.tuples {
            let shards = u64::from(self.shards[tuple.scene]);
            shards_done += shards;
            let receipt = &tuple.receipt;
            let (Some(worker), Some(at)) = (&receipt.worker, tuple.at) else {
                continue;
            };
            let host = receipt.host.as_deref().unwrap_or_default();
            let view = workers
                .entry(worker)
                .or_insert_with(|| new_worker(worker, host));
            view.version = receipt.version.clone().unwrap_or_default();
            view.shards_done += shards;
            view.last_progress_s = view.last_progress_s.min(seconds(at));
        }
        let in_hand = |seen: &&SeenAttempt| seen.record.ended.is_none();
        for SeenAttempt { record, at } in watch.attempts.values().filter(in_hand) {
            let view = workers
                .entry(&record.worker)
                .or_insert_with(|| new_worker(&record.worker, &record.host));
            view.state = WorkerState::Working;
            view.scene.get_or_insert_with(|| record.scene.clone());
            view.last_progress_s = view.last_progress_s.min(seconds(*at));
        }
        for worker in workers.values_mut() {
            if watch.finished {
                worker.state = WorkerState::Idle;
            } else if worker.last_progress_s > self.silent_s {
                worker.state = WorkerState::Silent;
            }
        }
        let recent = watch
            .tuples
            .iter()
            .rev()
            .take(RECENT)
            .map(|tuple| RecentTuple {
                scene: self.scenes[tuple.scene].clone(),
                age_s: tuple.at.map_or(0.0, seconds),
                worker: tuple.receipt.worker.clone(),
                miss_share: None,
                layers: self.layers[tuple.scene].clone(),
            });
        let rate = watch.rate_scenes_per_s();
        FarmView {
            schema: FARM_SCHEMA,
            name: self.name.clone(),
            run: self.id.clone(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            state: FarmState::new(watch.finished, watch.control.state),
            scenes: Count {
                done: watch.done,
                total: watch.scenes,
            },
            shards: Count {
                done: shards_done,
                total: self.shards.iter().map(|&n| u64::from(n)).sum(),
            },
            quarantined: watch.quarantined,
            rate_scenes_per_s: rate,
            eta_s: rate.filter(|r| *r > 0.0).map(|r| left / r),
            queue: QueueView {
                connected: watch.queue_lost.is_none(),
                reason: watch.queue_lost.clone(),
                spans_waiting: Some(watch.waiting),
                spans_held: Some(watch.held),
            },
            workers: workers.into_values().collect(),
            quarantine: watch
                .reasons
                .iter()
                .map(|(scene, reason)| QuarantinedScene {
                    scene: self.scenes[*scene].clone(),
                    reason: reason.clone(),
                    log_tail: None,
                })
                .collect(),
            recent: recent.collect(),
        }
    }

    fn thumbnail(&self, scene: &SceneId, layer: &str) -> Option<Vec<u8>> {
        let png = self
            .store
            .get(&keys::tuple(scene, &format!("{layer}.png")))
            .ok()??;
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
            // The coordinator sees it at its next poll; the page that asked shows it at once.
            let mut watch = self.watch.lock().expect("no holder of this lock panics");
            watch.control.state = state;
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
