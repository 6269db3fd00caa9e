//! Renders a scene as shards, merges their partials, and measures the CPU seconds of the tracer.

use super::clock::cpu_s;
use super::error::BenchError;
use super::scenes::BenchScene;
use glasshouse_line::SceneLine;
use render::job::SceneJob;
use render::merge::{Tuple, combine};
use render::partial::Partial;
use render::shard::ShardLayout;
use render::trace::{Isa, Sampling};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

/// Side of a tile, px: small enough that every thread gets tiles, large enough for a negligible overhead per tile.
const TILE_PX: u32 = 32;

pub struct Work<'a> {
    pub threads: usize,
    pub isa: Isa,
    /// Flag that stops the rendering after the shards that threads are tracing.
    pub stop: &'a AtomicBool,
    /// Callback with the number of camera samples of each finished shard.
    pub on_samples: &'a (dyn Fn(u64) + Sync),
}

pub struct Rendering {
    /// The four layers and their stated errors.
    pub tuple: Tuple,
    /// CPU seconds of all threads in the tracer (camera samples, intersection and radiance of all layers), without
    /// decoding, digests and merging.
    pub cpu_s: f64,
    /// CPU seconds of the scene's set-up: orders, tables and bounds, for decoded photographs.
    pub setup_s: f64,
}

/// Renders `line` with the scene's photographs. Returns `None` if `stop` was set before the end.
pub fn render(
    scene: &BenchScene,
    line: &SceneLine,
    sampling: Sampling,
    work: &Work,
) -> Result<Option<Rendering>, BenchError> {
    let layout = ShardLayout::of(line, TILE_PX);
    let (assembled, setup_s) = cpu_s(|| scene.assemble(line, sampling));
    let job = SceneJob::new(line, layout, assembled?);
    let next = AtomicU32::new(0);
    let done = Mutex::new((Vec::<Partial>::new(), 0.0));
    std::thread::scope(|scope| {
        for _ in 0..work.threads.max(1) {
            scope.spawn(|| {
                loop {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    if index >= layout.len() || work.stop.load(Ordering::Relaxed) {
                        break;
                    }
                    let shard = layout.shard(index);
                    let (result, seconds) = cpu_s(|| job.trace_tile(&shard, work.isa));
                    let partial = job.partial(&shard, result);
                    let mut done = done.lock().expect("no holder of this lock panics");
                    done.0.push(partial);
                    done.1 += seconds;
                    drop(done);
                    let count = shard.samples.end - shard.samples.start;
                    let pixels = u64::from(shard.tile.width) * u64::from(shard.tile.height);
                    (work.on_samples)(pixels * u64::from(count));
                }
            });
        }
    });
    let (partials, cpu_s) = done.into_inner().expect("no holder of this lock panics");
    if partials.len() < layout.len() as usize {
        return Ok(None);
    }
    let tuple = combine(line, TILE_PX, &partials)?;
    Ok(Some(Rendering { tuple, cpu_s, setup_s }))
}
