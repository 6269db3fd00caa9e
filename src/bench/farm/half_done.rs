//! A run that was left in the middle, made quickly: for measuring how long it takes to go on.

use crate::bench::BenchError;
use crate::run::{Run, keys};
use rayon::prelude::*;
use render::atomic_file::{create_dir, write_relaxed};
use render::color::SrgbEncoder;
use render::job::SceneJob;
use render::line::SceneLine;
use render::merge::{combine, encode_tuple_file, tuple_files};
use render::partial;
use render::scene::{load, read_files};
use render::trace::Isa;

/// What of the run is there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct HalfDone {
    /// Scenes with a tuple: those at even places.
    pub(super) tuples: u64,
    /// Partials of the others: the first half of each.
    pub(super) partials: u64,
    /// Scenes without a tuple.
    pub(super) missing: u64,
}

/// Makes the tuples of every other scene of a planned run, and the first half of the partials of those between. All of it
/// is what `work` would have made, but nobody waited for the disk. `on_scene` is called after each scene.
pub(super) fn half_done(
    run: &Run,
    isa: Isa,
    on_scene: &(dyn Fn() + Sync),
) -> Result<HalfDone, BenchError> {
    let encoder = SrgbEncoder::new();
    let parts: Vec<HalfDone> = run
        .lines
        .par_iter()
        .enumerate()
        .map(|(place, line)| {
            let done =
                if place % 2 == 0 { tuple(run, line, isa, &encoder) } else { half(run, line, isa) };
            on_scene();
            done
        })
        .collect::<Result<_, _>>()?;
    Ok(parts.iter().fold(HalfDone::default(), |a, b| HalfDone {
        tuples: a.tuples + b.tuples,
        partials: a.partials + b.partials,
        missing: a.missing + b.missing,
    }))
}

fn job<'a>(run: &Run, line: &'a SceneLine) -> Result<SceneJob<'a>, BenchError> {
    let files = read_files(line, &run.roots, run.root())?;
    Ok(SceneJob::new(line, run.layout(line), load(line, &files)?))
}

fn tuple(
    run: &Run,
    line: &SceneLine,
    isa: Isa,
    encoder: &SrgbEncoder,
) -> Result<HalfDone, BenchError> {
    let job = job(run, line)?;
    let shards = 0..job.layout.len();
    let partials: Vec<_> = shards.map(|s| job.trace(&job.layout.shard(s), isa)).collect();
    let tuple = combine(line, run.spec.tile_px, &partials)?;
    let folder = run.path(&keys::tuple_folder(&line.id));
    create_dir(&folder)?;
    for name in tuple_files(line) {
        let bytes = encode_tuple_file(&tuple, encoder, &name)
            .map_err(|e| BenchError::Encode { name: "tuple", reason: e.to_string() })?;
        write_relaxed(&folder.join(name), &bytes)?;
    }
    Ok(HalfDone { tuples: 1, ..HalfDone::default() })
}

fn half(run: &Run, line: &SceneLine, isa: Isa) -> Result<HalfDone, BenchError> {
    let job = job(run, line)?;
    create_dir(&run.path(&keys::partials(&line.id)))?;
    let there = job.layout.len() / 2;
    for shard in 0..there {
        let partial = job.trace(&job.layout.shard(shard), isa);
        let bytes = partial::encode(&partial)
            .map_err(|e| BenchError::Encode { name: "partial", reason: e.to_string() })?;
        write_relaxed(&run.path(&keys::partial(&line.id, shard)), &bytes)?;
    }
    Ok(HalfDone { partials: u64::from(there), missing: 1, ..HalfDone::default() })
}
