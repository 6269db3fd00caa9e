//! Renders scene lines on the threads of a pool.

use crate::errors::BadScene;
use crate::process::text;
use glasshouse_line::{Roots, SceneLine};
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};
use render::job::SceneJob;
use render::merge::{Tuple, combine};
use render::partial::Maker;
use render::scene::SceneLoader;
use render::shard::ShardLayout;
use render::trace::Isa;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Side of the tiles, px. No pixel depends on it.
const TILE_PX: u32 = 64;

/// The threads and the decoded photographs of one process.
pub(crate) struct Engine {
    pub(crate) pool: ThreadPool,
    loader: SceneLoader,
    isa: Isa,
    maker: Maker,
}

/// Reason why a scene has no tuple.
pub(crate) enum Untraced {
    Bad(BadScene),
    Stopped,
}

impl Engine {
    /// Starts `threads` threads; `cache_bytes` limits the memory of decoded photographs.
    pub(crate) fn start(threads: usize, cache_bytes: usize) -> Result<Self, ThreadPoolBuildError> {
        // A child that is forked while a thread makes a table would wait for it for ever.
        render::prepare();
        Ok(Self {
            pool: pool(threads)?,
            loader: SceneLoader::new(cache_bytes),
            isa: Isa::detect(),
            maker: Maker { worker: "python".to_owned(), host: "python".to_owned() },
        })
    }

    /// Renders a scene. Threads of the pool share its bands. Relative paths start from `base`.
    pub(crate) fn tuple(
        &self,
        line: &SceneLine,
        roots: &Roots,
        base: &Path,
        stop: &AtomicBool,
    ) -> Result<Tuple, Untraced> {
        if stop.load(Ordering::Relaxed) {
            return Err(Untraced::Stopped);
        }
        let bad = |reason: String| Untraced::Bad(BadScene { id: line.id.clone(), reason });
        let traced = catch_unwind(AssertUnwindSafe(|| self.traced(line, roots, base, stop)));
        match traced {
            Ok(Ok(Some(tuple))) => Ok(tuple),
            Ok(Ok(None)) => Err(Untraced::Stopped),
            Ok(Err(reason)) => Err(bad(reason)),
            Err(panic) => Err(bad(format!("a bug of glasshouse: {}", text(&*panic)))),
        }
    }

    fn traced(
        &self,
        line: &SceneLine,
        roots: &Roots,
        base: &Path,
        stop: &AtomicBool,
    ) -> Result<Option<Tuple>, String> {
        let loaded = self.loader.load(line, roots, base).map_err(|e| e.to_string())?;
        let layout = ShardLayout::of(line, TILE_PX);
        let job = SceneJob::new(line, layout, loaded);
        let bands: Vec<(u32, u32)> = (0..job.layout.len())
            .flat_map(|shard| (0..job.bands(shard)).map(move |band| (shard, band)))
            .collect();
        bands.into_par_iter().for_each(|(shard, band)| {
            if stop.load(Ordering::Relaxed) {
                return;
            }
            let shard = job.layout.shard(shard);
            if let Some(result) = job.trace_band(&shard, band, self.isa) {
                job.add(job.partial_in_memory(&shard, result, &self.maker));
            }
        });
        if stop.load(Ordering::Relaxed) {
            return Ok(None);
        }
        let partials = job.take_results();
        let partials: Vec<_> = partials.iter().map(|partial| &**partial).collect();
        combine(line, TILE_PX, &partials).map(Some).map_err(|e| e.to_string())
    }
}

/// Starts a pool. The names of its threads show in debuggers.
pub(crate) fn pool(threads: usize) -> Result<ThreadPool, ThreadPoolBuildError> {
    let name = |index| format!("glasshouse-{index}");
    ThreadPoolBuilder::new().num_threads(threads.max(1)).thread_name(name).build()
}
