//! Makes a half-finished run quickly, to measure the time until it resumes.

use crate::bench::BenchError;
use crate::run::{Run, keys};
use compose::encode_tuple;
use glasshouse_line::SceneLine;
use glasshouse_line::color::SrgbEncoder;
use rayon::prelude::*;
use render::atomic_file::{create_dir, write_relaxed};
use render::job::SceneJob;
use render::merge::combine;
use render::partial;
use render::scene::{load, read_files};
use render::trace::Isa;

/// Sizes of the finished and the missing parts of the run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct HalfDone {
    /// Number of scenes with a tuple: those at even positions, counted from 0.
    pub(super) tuples: u64,
    /// Number of stored partials: those of the first half of the shards of each scene without a tuple.
    pub(super) partials: u64,
    /// Number of scenes without a tuple.
    pub(super) missing: u64,
}

/// Makes the tuples of every other scene of a planned run, and the first half of the partials of the remaining scenes.
/// Unlike `work`, writes no other files and does not wait for the disk. Calls `on_scene` after each scene.
pub(super) fn half_done(
    run: &Run,
    isa: Isa,
    on_scene: &(dyn Fn() + Sync),
) -> Result<HalfDone, BenchError> {
    let encoder = SrgbEncoder::new();
    let scenes = run.lines.par_iter().enumerate().map(|(place, line)| {
        let files = read_files(line, &run.roots, run.root())?;
        let job = SceneJob::new(line, run.layout(line), load(line, &files)?);
        let partials = if place % 2 == 0 {
            tuple(run, &job, line, isa, &encoder)?
        } else {
            half(run, &job, line, isa)?
        };
        on_scene();
        Ok(partials)
    });
    let partials: Result<Vec<u32>, BenchError> = scenes.collect();
    let scenes = run.lines.len() as u64;
    Ok(HalfDone {
        tuples: scenes.div_ceil(2),
        partials: partials?.into_iter().map(u64::from).sum(),
        missing: scenes / 2,
    })
}

/// Writes the scene's tuple; returns 0, because no partial remains.
fn tuple(
    run: &Run,
    job: &SceneJob,
    line: &SceneLine,
    isa: Isa,
    encoder: &SrgbEncoder,
) -> Result<u32, BenchError> {
    let shards = 0..job.layout.len();
    let partials: Vec<_> = shards.map(|s| job.trace(&job.layout.shard(s), isa)).collect();
    let tuple = combine(line, run.spec.tile_px, &partials)?;
    let folder = run.path(&keys::tuple_folder(&line.id));
    create_dir(&folder)?;
    let files = encode_tuple(&tuple, encoder)
        .map_err(|e| BenchError::Encode { name: "tuple", reason: e.to_string() })?;
    for (name, bytes) in files {
        write_relaxed(&folder.join(name), &bytes)?;
    }
    Ok(0)
}

/// Writes the first half of the scene's partials; returns their number.
fn half(run: &Run, job: &SceneJob, line: &SceneLine, isa: Isa) -> Result<u32, BenchError> {
    create_dir(&run.path(&keys::partials(&line.id)))?;
    let count = job.layout.len() / 2;
    for shard in 0..count {
        let partial = job.trace(&job.layout.shard(shard), isa);
        let bytes = partial::encode(&partial)
            .map_err(|e| BenchError::Encode { name: "partial", reason: e.to_string() })?;
        write_relaxed(&run.path(&keys::partial(&line.id, shard)), &bytes)?;
    }
    Ok(count)
}
