//! A loaded scene on its way to a tuple.

use crate::manifest::SceneLine;
use crate::partial::{PARTIAL_SCHEMA, Partial, PartialHeader};
use crate::scene::LoadedScene;
use crate::shard::{Shard, ShardLayout, scene_digest};
use crate::trace::{Isa, TRACER_VERSION, TileResult, trace_tile};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

/// A scene whose shards are being traced.
pub struct SceneJob<'a> {
    /// Its manifest line.
    pub line: &'a SceneLine,
    /// Its shards.
    pub layout: ShardLayout,
    loaded: LoadedScene,
    line_blake3: String,
    results: Mutex<Vec<Partial>>,
    unfinished: AtomicU32,
    failed: AtomicBool,
}

impl<'a> SceneJob<'a> {
    /// A scene of which nothing is done.
    pub fn new(line: &'a SceneLine, layout: ShardLayout, loaded: LoadedScene) -> Self {
        Self {
            line,
            layout,
            loaded,
            line_blake3: scene_digest(line),
            results: Mutex::new(Vec::new()),
            unfinished: AtomicU32::new(layout.len()),
            failed: AtomicBool::new(false),
        }
    }

    /// Traces one shard.
    pub fn trace(&self, shard: &Shard, isa: Isa) -> Partial {
        self.partial(shard, self.trace_tile(shard, isa))
    }

    /// The tracer's part of [`Self::trace`].
    pub fn trace_tile(&self, shard: &Shard, isa: Isa) -> TileResult {
        trace_tile(&self.loaded.scene, shard.tile, shard.samples.clone(), isa)
    }

    /// The rest of it: header and digest.
    pub fn partial(&self, shard: &Shard, result: TileResult) -> Partial {
        let header = PartialHeader {
            schema: PARTIAL_SCHEMA.to_owned(),
            tracer_version: TRACER_VERSION,
            scene: self.line.id.clone(),
            line_blake3: self.line_blake3.clone(),
            inputs: self.loaded.inputs.clone(),
            shard: shard.index,
            film: [self.line.film.width, self.line.film.height],
            tile: shard.tile,
            samples: [shard.samples.start, shard.samples.end],
            layer_samples: result.samples,
            sample_sums: result.sample_sums,
            paths: result.paths,
            misses: result.misses,
            facts: self.loaded.facts.clone(),
            blake3: String::new(),
        };
        Partial::new(header, result.pixels)
    }

    /// A partial from disk is this job's shard.
    pub fn accepts(&self, shard: &Shard, partial: &Partial) -> bool {
        let header = &partial.header;
        header.tracer_version == TRACER_VERSION
            && header.line_blake3 == self.line_blake3
            && header.shard == shard.index
            && header.tile == shard.tile
            && header.samples == [shard.samples.start, shard.samples.end]
            && header.inputs == self.loaded.inputs
            && header.facts == self.loaded.facts
    }

    /// Takes a finished shard; true for the one that completes the scene.
    pub fn finish(&self, partial: Partial) -> bool {
        self.results
            .lock()
            .expect("no holder of this lock panics")
            .push(partial);
        self.unfinished.fetch_sub(1, Ordering::AcqRel) == 1
    }

    /// The finished shards.
    pub fn take_results(&self) -> Vec<Partial> {
        std::mem::take(&mut *self.results.lock().expect("no holder of this lock panics"))
    }

    /// Marks the scene as failed; true the first time.
    pub fn fail(&self) -> bool {
        !self.failed.swap(true, Ordering::AcqRel)
    }

    /// The scene has failed: its shards need not be traced.
    pub fn has_failed(&self) -> bool {
        self.failed.load(Ordering::Acquire)
    }
}

/// Traces all shards of one scene on `threads` threads, nothing being written. For `render`.
///
/// Returns `None` when `stop` was set before the end.
pub fn render_partials(
    job: &SceneJob,
    threads: usize,
    isa: Isa,
    stop: &AtomicBool,
    on_shard: &(dyn Fn() + Sync),
) -> Option<Vec<Partial>> {
    let next = AtomicU32::new(0);
    std::thread::scope(|scope| {
        for _ in 0..threads.max(1) {
            scope.spawn(|| {
                loop {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    if index >= job.layout.len() || stop.load(Ordering::Relaxed) {
                        break;
                    }
                    job.finish(job.trace(&job.layout.shard(index), isa));
                    on_shard();
                }
            });
        }
    });
    let partials = job.take_results();
    (partials.len() == job.layout.len() as usize).then_some(partials)
}
