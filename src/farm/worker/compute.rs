//! The work of a compute thread: loading scenes, tracing bands, sealing and merging shards, and encoding files.

use super::core::panic_reason;
use super::jobs::{ActiveTask, Band, FinishedScene, Job, Loaded, Objects, Order};
use super::pool::ComputeThread;
use crate::farm::FarmError;
use crate::run::{AccessError, Event, Makers, Stage, Stopwatch, keys};
use render::job::SceneJob;
use render::merge::combine;
use render::scene::{LoadError, load_with};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

impl<'a> ComputeThread<'_, 'a> {
    pub(super) fn do_job(&self, job: Job<'a>) -> Result<(), FarmError> {
        match job {
            Job::Seal(task, shard) => self.seal(&task, shard),
            Job::Gather(task) => self.gather(&task),
            Job::Merge(task) => self.merge(&task),
            Job::Encode(scene, file) => self.encode(&scene, file),
        }
    }

    /// Decodes a scene, fetches its partials from the store, and puts the missing shards' bands into the deque.
    pub(super) fn open(&self, loaded: Loaded<'a>) {
        let worker = self.worker;
        let Loaded { line, task, leased, files } = loaded;
        let now = worker.now();
        if !worker.tasks().load(task, now) {
            // The task was donated meanwhile.
            return;
        }
        let start = Stopwatch::start();
        let cache = &worker.photographs;
        let load = || files.and_then(|files| load_with(line, &files, cache));
        let loaded = catch_unwind(AssertUnwindSafe(load));
        for fault in worker.options.faults {
            fault.after_load();
        }
        self.slow_down(&start);
        worker.tally.seconds.add(Stage::Decode, start.spent());
        worker.tally.loads.add(1);
        let reason = match loaded {
            Ok(Ok(loaded)) => {
                let job = SceneJob::new(line, worker.run.layout(line), loaded);
                let task = Arc::new(ActiveTask { id: task, leased, job });
                (worker.on_event)(Event::SceneOpened { scene: line.id.clone() });
                return worker.step(&task, || self.begin(&task));
            }
            // The error does not name the scene's files.
            Ok(Err(LoadError::Assemble(error))) => {
                format!("{error} (front is {}, back is {})", line.front.name(), line.back.name())
            }
            Ok(Err(error)) => error.to_string(),
            Err(panic) => panic_reason(&*panic),
        };
        worker.break_down_if(worker.fail(task, &reason));
    }

    fn begin(&self, task: &Arc<ActiveTask<'a>>) -> Result<(), FarmError> {
        let worker = self.worker;
        let found = self.fetch_found(task)?;
        let count = task.job.layout.len();
        let (actions, waiting) = {
            let mut tasks = worker.tasks();
            let actions = tasks.loaded(task.id, count, &found, Arc::clone(task));
            (actions, tasks.waiting(task.id))
        };
        worker.perform(actions)?;
        let mut bands = 0;
        for shard in waiting {
            for index in 0..task.job.bands(shard) {
                self.deque.push(Band { task: Arc::clone(task), shard, index });
                bands += 1;
            }
        }
        worker.bell.ring(bands);
        Ok(())
    }

    pub(super) fn trace(&self, band: &Band<'a>) -> Result<(), FarmError> {
        let (worker, task) = (self.worker, &band.task);
        worker.must_stop();
        if !worker.tasks().begin(task.id, band.shard) {
            return Ok(());
        }
        let job = &task.job;
        let shard = job.layout.shard(band.shard);
        let faults = worker.options.faults;
        for fault in faults {
            fault.before(&job.line.id, worker.on_event);
        }
        let start = Stopwatch::start();
        let mut result = job.trace_band(&shard, band.index, worker.options.isa);
        let (scene, bands) = (task.leased.scene, job.bands(band.shard));
        for fault in faults {
            fault.after(&job.line.id, result.as_mut());
            fault.after_band(scene, band.shard, bands);
        }
        self.slow_down(&start);
        let spent = start.spent();
        worker.tally.seconds.add(Stage::Trace, spent);
        worker.tally.scene_seconds.add(scene, spent.cpu);
        let part = 1.0 / f64::from(bands);
        worker.tasks().spent(task.id, spent.wall.as_secs_f64(), part);
        let Some(result) = result else {
            return Ok(());
        };
        job.add(job.partial_in_memory(&shard, result, &worker.maker));
        worker.must_stop();
        let now = worker.now();
        let actions = worker.tasks().traced(task.id, band.shard, now);
        worker.tally.traced.add(1);
        worker.tally.scene_seconds.add_shard(scene);
        (worker.on_event)(Event::ShardDone { resumed: false });
        worker.perform(actions)
    }

    fn slow_down(&self, since: &Stopwatch) {
        for fault in self.worker.options.faults {
            fault.slow_down(since.spent().wall);
        }
    }

    fn seal(&self, task: &Arc<ActiveTask<'a>>, shard: u32) -> Result<(), FarmError> {
        // A scene that was merged meanwhile has no results left.
        let Some(partial) = task.job.result(shard) else {
            return Ok(());
        };
        let start = Stopwatch::start();
        let bytes = partial.seal().map_err(|e| {
            let key = keys::partial(&task.job.line.id, shard);
            AccessError::Tuple(format!("cannot encode {key}: {e}"))
        })?;
        self.worker.tally.seconds.add(Stage::Checkpoint, start.spent());
        self.order(Order { task: Arc::clone(task), objects: Objects::Partial(shard, bytes) });
        Ok(())
    }

    /// Combines all shards of a scene, and queues a job for each file to encode.
    fn merge(&self, task: &Arc<ActiveTask<'a>>) -> Result<(), FarmError> {
        let worker = self.worker;
        let start = Stopwatch::start();
        let partials = task.job.take_results();
        let makers = Makers::of(partials.iter().map(|partial| &**partial));
        let combined = combine(task.job.line, worker.run.spec.tile_px, &partials);
        worker.tally.seconds.add(Stage::Merge, start.spent());
        match combined {
            Ok(tuple) => {
                let scene = Arc::new(FinishedScene::new(Arc::clone(task), tuple, makers));
                for file in 0..scene.len() {
                    worker.jobs.push(Job::Encode(Arc::clone(&scene), file));
                }
                worker.bell.ring(scene.len());
                Ok(())
            }
            Err(error) => worker.fail(task.id, &error.to_string()),
        }
    }

    fn encode(&self, scene: &FinishedScene<'a>, file: usize) -> Result<(), FarmError> {
        let worker = self.worker;
        // The task may have ended meanwhile.
        if !worker.tasks().has(scene.task.id) {
            return Ok(());
        }
        let start = Stopwatch::start();
        let encoded = scene.encode(file, &self.pool.encoder)?;
        worker.tally.seconds.add(Stage::Encode, start.spent());
        if let Some(encoded) = encoded {
            let task = Arc::clone(&scene.task);
            self.order(Order { task, objects: Objects::Tuple(encoded) });
        }
        Ok(())
    }
}
