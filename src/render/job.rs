//! Traces a loaded scene shard by shard.

use crate::bands::{BandedShard, bands};
use crate::partial::{Maker, PARTIAL_SCHEMA, Partial, PartialHeader};
use crate::scene::LoadedScene;
use crate::shard::{Shard, ShardLayout, scene_digest};
use crate::threads::on_threads;
use crate::trace::{Isa, TRACER_VERSION, TileResult, trace_tile};
use glasshouse_line::SceneLine;
use glasshouse_line::label::Label;
use glasshouse_line::layer::Layer;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};

/// A loaded scene, its shards, and the finished partials.
pub struct SceneJob<'a> {
    pub line: &'a SceneLine,
    pub layout: ShardLayout,
    loaded: Arc<LoadedScene>,
    line_blake3: String,
    shards: Vec<BandedShard>,
    results: Mutex<Vec<Arc<Partial>>>,
}

impl<'a> SceneJob<'a> {
    /// Creates a job without finished shards.
    pub fn new(
        line: &'a SceneLine,
        layout: ShardLayout,
        loaded: impl Into<Arc<LoadedScene>>,
    ) -> Self {
        Self {
            line,
            layout,
            loaded: loaded.into(),
            line_blake3: scene_digest(line),
            shards: (0..layout.len()).map(|_| BandedShard::default()).collect(),
            results: Mutex::new(Vec::new()),
        }
    }

    /// Traces one shard in one piece.
    pub fn trace(&self, shard: &Shard, isa: Isa) -> Partial {
        self.partial(shard, self.trace_tile(shard, isa))
    }

    pub fn bands(&self, shard: u32) -> u32 {
        bands(self.layout.shard(shard).tile)
    }

    /// Traces one band of a shard. Returns the result of the whole shard once all its bands are finished.
    pub fn trace_band(&self, shard: &Shard, band: u32, isa: Isa) -> Option<TileResult> {
        self.shards[shard.index as usize].trace(shard.tile, band, |tile| {
            trace_tile(&self.loaded.scene, tile, shard.samples.clone(), isa)
        })
    }

    /// Traces one shard without making a partial.
    pub fn trace_tile(&self, shard: &Shard, isa: Isa) -> TileResult {
        trace_tile(&self.loaded.scene, shard.tile, shard.samples.clone(), isa)
    }

    /// Makes the partial of a traced shard, with header and digest.
    pub fn partial(&self, shard: &Shard, result: TileResult) -> Partial {
        Partial::new(self.header(shard, &result), result.pixels, result.labels)
    }

    /// Makes the partial of a shard that `maker` has traced, with an empty digest, for partials that stay in memory.
    pub fn partial_in_memory(&self, shard: &Shard, result: TileResult, maker: &Maker) -> Partial {
        let header = self.header(shard, &result);
        let (pixels, labels) = (result.pixels, result.labels);
        Partial { header, pixels, labels, maker: Some(maker.clone()) }
    }

    fn header(&self, shard: &Shard, result: &TileResult) -> PartialHeader {
        PartialHeader {
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
        }
    }

    /// True if a partial from disk is the result of this job's `shard`.
    pub fn accepts(&self, shard: &Shard, partial: &Partial) -> bool {
        let header = &partial.header;
        header.tracer_version == TRACER_VERSION
            && header.line_blake3 == self.line_blake3
            && header.shard == shard.index
            && header.tile == shard.tile
            && header.samples == [shard.samples.start, shard.samples.end]
            && header.inputs == self.loaded.inputs
            && header.facts == self.loaded.facts
            && self.has_samples(shard, header)
            && self.has_labels(shard, partial)
    }

    /// True if a partial has the labels that the line requests.
    fn has_labels(&self, shard: &Shard, partial: &Partial) -> bool {
        let requested = self.line.film.layers.labels();
        Label::ALL.into_iter().all(|label| {
            let is_in_range = label != Label::FrontDepth || shard.samples.start == 0;
            let is_due = requested.contains(label) && !label.is_derived() && is_in_range;
            partial.labels.contains_key(&label) == is_due
        })
    }

    /// True if a partial has the numbers of samples that the tracer takes. The other two layers and adaptive scenes have
    /// numbers that only tracing shows; [`crate::partial::decode`] checks their bounds.
    fn has_samples(&self, shard: &Shard, header: &PartialHeader) -> bool {
        let (count, film) = (shard.samples.end - shard.samples.start, &self.line.film);
        let is_adaptive = film.target_error.is_some();
        let asked = film.layers.asked();
        let taken = |layer| match (asked[layer], layer) {
            (false, _) => 0..=0,
            (true, Layer::Input | Layer::Transmission) if !is_adaptive => count..=count,
            (true, _) => 0..=count,
        };
        header.sample_sums.is_some() == is_adaptive
            && header.layer_samples.iter().all(|(layer, n)| taken(layer).contains(n))
    }

    /// Stores the partial of a finished shard.
    pub fn add(&self, partial: Partial) {
        self.results().push(Arc::new(partial));
    }

    /// Returns the partial of a finished shard; `None` for other shards, and after [`Self::take_results`].
    pub fn result(&self, shard: u32) -> Option<Arc<Partial>> {
        let results = self.results();
        let mut results = results.iter();
        results.find(|p| p.header.shard == shard).cloned()
    }

    /// Takes the partials of all finished shards.
    pub fn take_results(&self) -> Vec<Arc<Partial>> {
        std::mem::take(&mut *self.results())
    }

    fn results(&self) -> MutexGuard<'_, Vec<Arc<Partial>>> {
        self.results.lock().expect("no holder of this lock panics")
    }
}

/// Traces all shards of one scene on `threads` threads, in memory. [`crate::Loaded`] also loads and merges.
///
/// Calls `on_shard` after each shard. Returns `None` if `stop` ended the work before all shards were finished.
pub fn render_partials(
    job: &SceneJob,
    threads: usize,
    isa: Isa,
    stop: &AtomicBool,
    on_shard: &(dyn Fn() + Sync),
) -> Option<Vec<Partial>> {
    let all: Vec<(u32, u32)> = (0..job.layout.len())
        .flat_map(|shard| (0..job.bands(shard)).map(move |band| (shard, band)))
        .collect();
    let next = AtomicUsize::new(0);
    on_threads(threads.min(all.len()), || {
        while !stop.load(Ordering::Relaxed) {
            let Some(&(shard, band)) = all.get(next.fetch_add(1, Ordering::Relaxed)) else {
                break;
            };
            let shard = job.layout.shard(shard);
            let Some(result) = job.trace_band(&shard, band, isa) else {
                continue;
            };
            job.add(job.partial(&shard, result));
            on_shard();
        }
    });
    let partials = job.take_results();
    let is_whole = partials.len() == job.layout.len() as usize;
    is_whole.then(|| partials.into_iter().map(Arc::unwrap_or_clone).collect())
}
