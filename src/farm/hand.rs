//! A thread that computes: it encodes a file of a finished scene if there is one, else traces a band of a shard from its
//! own deque, else steals one from the others', and only when there is nothing to steal does it decode the next scene
//! and fill its own deque.

use super::error::FarmError;
use super::finished::FinishedScene;
use super::intake::Loaded;
use super::open_span::OpenSpan;
use super::queue::Waiting;
use super::shared::{Shared, panic_reason};
use super::writer::{Order, What};
use crate::run::AccessError;
use crate::run::Span;
use crate::run::events::{Event, Stopwatch};
use crate::run::keys;
use crossbeam::channel::{Sender, TryRecvError};
use crossbeam::deque::{Steal, Worker};
use render::job::SceneJob;
use render::line::SceneLine;
use render::merge::combine;
use render::partial::{self, Partial};
use render::scene::{LoadError, load};
use render::shard::Shard;
use render::trace::TileResult;
use std::collections::BTreeSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// Partials fetched from the store in one go.
const FETCHED_AT_ONCE: usize = 32;

/// One band of a shard of an open span.
pub(super) struct Band<'a> {
    span: Arc<OpenSpan<'a>>,
    shard: u32,
    /// From the top.
    index: u32,
}

/// A thread that computes.
pub(super) struct Hand<'s, 'a> {
    pub(super) farm: &'s Shared<'a>,
    pub(super) index: usize,
    pub(super) deque: Worker<Band<'a>>,
    pub(super) writer: Sender<Order<'a>>,
}

impl<'a> Hand<'_, 'a> {
    pub(super) fn work(&self) {
        let farm = self.farm;
        while !farm.broken.load(Ordering::Relaxed) {
            if let Some((scene, file)) = take(|| farm.to_encode.steal()) {
                farm.step(&scene.span, || self.encode(&scene, file));
                continue;
            }
            if let Some(span) = take(|| farm.to_complete.steal()) {
                farm.step(&span, || self.complete(&span));
                continue;
            }
            if let Some(span) = take(|| farm.to_checkpoint.steal()) {
                farm.step(&span, || self.checkpoint(&span, &span.unwritten()));
                continue;
            }
            if let Some(band) = self.deque.pop().or_else(|| self.steal()) {
                farm.step(&band.span, || self.trace(&band));
                continue;
            }
            if farm.must_stop() {
                for span in farm.held.opened() {
                    farm.step(&span, || self.checkpoint(&span, &span.unwritten()));
                }
                return;
            }
            if farm.control.is_paused() && !farm.files.is_empty() {
                std::thread::sleep(Duration::from_millis(5));
                continue;
            }
            // Counted before it is taken, so that nobody goes home while a scene may still be shared out.
            farm.open.fetch_add(1, Ordering::AcqRel);
            match farm.files.try_recv() {
                Ok(loaded) => self.open(loaded),
                Err(error) => {
                    let open = farm.open.fetch_sub(1, Ordering::AcqRel) - 1;
                    if error == TryRecvError::Disconnected && open == 0 {
                        return;
                    }
                    std::thread::sleep(Duration::from_micros(500));
                }
            }
        }
    }

    fn steal(&self) -> Option<Band<'a>> {
        let stealers = &self.farm.stealers;
        let count = stealers.len();
        (1..count).find_map(|offset| take(|| stealers[(self.index + offset) % count].steal()))
    }

    /// Waits while the channel is full. The writer takes orders until the last hand has gone home.
    fn order(&self, span: &Arc<OpenSpan<'a>>, what: What) {
        let span = Arc::clone(span);
        if self.writer.send(Order { span, what }).is_err() {
            // Its thread panicked, which the scope that joins it tells.
            self.farm.broken.store(true, Ordering::Relaxed);
        }
    }

    /// Decodes a scene, takes up what is in the store, and puts the missing shards' bands into the deque.
    fn open(&self, loaded: Loaded<'a>) {
        let farm = self.farm;
        let Loaded {
            line,
            delivery,
            files,
        } = loaded;
        let ticket = delivery.ticket;
        if !farm.held.may_open(ticket) {
            // Given away while it waited.
            farm.open.fetch_sub(1, Ordering::AcqRel);
            return;
        }
        let start = Stopwatch::start();
        let loaded = catch_unwind(AssertUnwindSafe(|| {
            files.and_then(|files| load(line, &files))
        }));
        for fault in farm.options.faults {
            fault.after_load();
        }
        self.slow_down(&start);
        farm.seconds.add_decode(start.spent());
        farm.loads.fetch_add(1, Ordering::Relaxed);
        let refuse = |reason: &str| {
            farm.quarantine(line, reason);
            farm.close(ticket);
        };
        let job = match loaded {
            Ok(Ok(loaded)) => SceneJob::new(line, farm.run.layout(line), loaded),
            Ok(Err(error)) => return refuse(&load_reason(line, &error)),
            Err(panic) => return refuse(&panic_reason(&*panic)),
        };
        let span = Arc::new(OpenSpan::new(job, delivery));
        farm.held.open(&span);
        (farm.on_event)(Event::SceneOpened {
            scene: line.id.clone(),
        });
        farm.step(&span, || self.take_up(&span));
        for shard in span.left() {
            for index in 0..span.job.bands(shard) {
                self.deque.push(Band {
                    span: Arc::clone(&span),
                    shard,
                    index,
                });
            }
        }
    }

    /// Takes up the partials that the store has of the span's scene.
    fn take_up(&self, span: &Arc<OpenSpan<'a>>) -> Result<(), FarmError> {
        let (farm, job) = (self.farm, &span.job);
        if job.layout.len() == 1 {
            // Its only shard never has a partial.
            return Ok(());
        }
        let mut there: Vec<String> = farm.store.list(&keys::partials(&job.line.id))?;
        there.sort();
        self.fetch(span, &there, |partial| {
            farm.resumed.fetch_add(1, Ordering::Relaxed);
            (farm.on_event)(Event::ShardDone { resumed: true });
            span.found(partial.header.shard);
            if let Some(partials) = job.finish(partial) {
                self.merge(span, &partials);
            }
        })?;
        if span.settle() {
            farm.end_in_part(span)?;
        }
        Ok(())
    }

    /// Fetches partials, some at a time. What is not there, or is none of this scene's, is left out.
    fn fetch(
        &self,
        span: &OpenSpan<'a>,
        keys: &[String],
        mut take: impl FnMut(Partial),
    ) -> Result<(), FarmError> {
        let farm = self.farm;
        for keys in keys.chunks(FETCHED_AT_ONCE) {
            for (key, bytes) in keys.iter().zip(farm.store.get_all(keys)?) {
                let (Some(shard), Some(bytes)) = (keys::shard_of(key), bytes) else {
                    continue;
                };
                if let Some(partial) = self.read(span, shard, key, &bytes)? {
                    take(partial);
                }
            }
            // A slow store is no hanging worker.
            farm.held.touch(span.delivery.ticket);
        }
        Ok(())
    }

    /// A partial, if it is one of this scene; else it is removed, to be traced again.
    fn read(
        &self,
        span: &OpenSpan<'a>,
        shard: u32,
        key: &str,
        bytes: &[u8],
    ) -> Result<Option<Partial>, FarmError> {
        let (farm, job) = (self.farm, &span.job);
        let path = PathBuf::from(farm.store.name()).join(key);
        let known = shard < job.layout.len();
        let reason = match partial::decode(&path, bytes) {
            Ok(found) if known && job.accepts(&job.layout.shard(shard), &found) => {
                return Ok(Some(found));
            }
            Ok(_) => format!(
                "partial {} belongs to other inputs or another spec; it will be traced again",
                path.display()
            ),
            Err(error) => error.to_string(),
        };
        (farm.on_event)(Event::PartialRejected { reason });
        farm.store.delete(&[key.to_owned()])?;
        Ok(None)
    }

    fn trace(&self, band: &Band<'a>) -> Result<(), FarmError> {
        let (farm, job) = (self.farm, &band.span.job);
        if job.has_failed() || !job.may_trace(band.shard, farm.must_stop()) {
            return Ok(());
        }
        let shard = job.layout.shard(band.shard);
        for fault in farm.options.faults {
            fault.before(&job.line.id, farm.on_event);
        }
        let start = Stopwatch::start();
        let mut result = job.trace_band(&shard, band.index, farm.options.isa);
        let scene = band.span.delivery.waiting.span.scene;
        for fault in farm.options.faults {
            fault.after(&job.line.id, result.as_mut());
            fault.after_band(scene, band.shard, job.bands(band.shard));
        }
        self.slow_down(&start);
        let spent = start.spent();
        band.span.spent(spent.wall);
        farm.seconds.add_trace(spent);
        farm.scene_seconds.add(scene, spent.cpu);
        match result {
            Some(result) => self.finish(&band.span, &shard, result),
            None => Ok(()),
        }
    }

    /// Takes as many times as long as a fault orders.
    fn slow_down(&self, since: &Stopwatch) {
        for fault in self.farm.options.faults {
            fault.slow_down(since.spent().wall);
        }
    }

    /// A shard is traced. Its partial waits in memory for the scene's other shards, for some seconds: whoever is killed
    /// loses no more than that.
    fn finish(
        &self,
        span: &Arc<OpenSpan<'a>>,
        shard: &Shard,
        result: TileResult,
    ) -> Result<(), FarmError> {
        let (farm, job) = (self.farm, &span.job);
        let complete = job.finish(job.partial_in_memory(shard, result));
        let at_most = if farm.must_stop() {
            Duration::ZERO
        } else {
            farm.options.checkpoint
        };
        self.checkpoint(span, &span.traced(shard.index, at_most))?;
        farm.traced.fetch_add(1, Ordering::Relaxed);
        let scene = span.delivery.waiting.span.scene;
        farm.scene_seconds.add_shard(scene);
        (farm.on_event)(Event::ShardDone { resumed: false });
        if let Some(partials) = complete {
            self.merge(span, &partials);
        }
        Ok(())
    }

    /// Sends partials to the writer.
    fn checkpoint(&self, span: &Arc<OpenSpan<'a>>, shards: &[u32]) -> Result<(), FarmError> {
        for &shard in shards {
            // Merged meanwhile.
            let Some(partial) = span.job.result(shard) else {
                continue;
            };
            let start = Stopwatch::start();
            let bytes = partial.seal().map_err(|e| {
                let key = keys::partial(&span.job.line.id, shard);
                AccessError::Tuple(format!("cannot encode {key}: {e}"))
            })?;
            self.farm.seconds.add_checkpoint(start.spent());
            self.order(span, What::Partial { shard, bytes });
        }
        Ok(())
    }

    /// Others have traced the rest of the scene: fetches it. A partial of theirs that is damaged is published anew.
    fn complete(&self, span: &Arc<OpenSpan<'a>>) -> Result<(), FarmError> {
        let (farm, job) = (self.farm, &span.job);
        let mut partials = job.take_results();
        let mut missing: BTreeSet<u32> = (0..job.layout.len()).collect();
        for partial in &partials {
            missing.remove(&partial.header.shard);
        }
        let key = |&shard: &u32| keys::partial(&job.line.id, shard);
        let keys: Vec<String> = missing.iter().map(key).collect();
        // What is not there was merged by somebody else meanwhile, or removed.
        self.fetch(span, &keys, |partial| {
            missing.remove(&partial.header.shard);
            partials.push(Arc::new(partial));
        })?;
        let damaged = missing;
        if damaged.is_empty() {
            self.merge(span, &partials);
            return Ok(());
        }
        let waiting = &span.delivery.waiting;
        let again = damaged.into_iter().map(|shard| Waiting {
            span: Span {
                scene: waiting.span.scene,
                shards: shard..shard + 1,
            },
            handed_on: waiting.handed_on + 1,
        });
        // If the queue cannot be told, the coordinator notices.
        let _ = farm.queue.publish(&again.collect::<Vec<_>>());
        farm.close(span.delivery.ticket);
        Ok(())
    }

    /// All shards are there: combines them and shares out the encoding.
    fn merge(&self, span: &Arc<OpenSpan<'a>>, partials: &[Arc<Partial>]) {
        let farm = self.farm;
        let start = Stopwatch::start();
        let combined = combine(span.job.line, farm.run.spec.tile_px, partials);
        farm.seconds.add_merge(start.spent());
        match combined {
            Ok(tuple) => {
                let scene = Arc::new(FinishedScene::new(Arc::clone(span), tuple));
                for file in 0..scene.len() {
                    farm.to_encode.push((Arc::clone(&scene), file));
                }
            }
            Err(error) => farm.fail(span, &error.to_string()),
        }
    }

    fn encode(&self, scene: &FinishedScene<'a>, file: usize) -> Result<(), FarmError> {
        let farm = self.farm;
        let start = Stopwatch::start();
        let encoded = scene.encode(file, &farm.encoder)?;
        farm.seconds.add_encode(start.spent());
        if let Some(encoded) = encoded {
            let miss_share = scene.miss_share();
            let what = What::Tuple {
                encoded,
                miss_share,
            };
            self.order(&scene.span, what);
        }
        Ok(())
    }
}

/// Takes a task from a queue that others take from, too.
fn take<T>(steal: impl Fn() -> Steal<T>) -> Option<T> {
    loop {
        match steal() {
            Steal::Success(task) => return Some(task),
            Steal::Empty => return None,
            Steal::Retry => {}
        }
    }
}

/// Errors about a file name it; those about the scene as a whole need its files' names beside them.
fn load_reason(line: &SceneLine, error: &LoadError) -> String {
    match error {
        LoadError::Assemble(error) => format!(
            "{error} (front is {}, back is {})",
            line.front.name(),
            line.back.name()
        ),
        error => error.to_string(),
    }
}
