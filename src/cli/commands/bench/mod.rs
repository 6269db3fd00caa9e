//! `bench`: its subcommands and their shared code.

mod compose;
mod error;
mod farm;
mod recipe;
mod trace;
#[cfg(feature = "train")]
mod train;

use crate::bench::{BenchError, BenchScene};
use crate::cli::args::Global;
use crate::cli::exit_code::{Exit, Failure, exit_codes, failure};
use crate::cli::output::Output;
use clap::{Args as ClapArgs, Subcommand};
use farm::BenchFarmArgs;
use glasshouse_line::{Roots, parse_scene};
use render::scene::{decode, read_files};
use std::path::Path;

#[derive(Debug, ClapArgs)]
pub(super) struct BenchArgs {
    #[command(subcommand)]
    what: BenchCommand,
}

/// The benchmarks. `--help` lists them in this order.
#[derive(Debug, Subcommand)]
enum BenchCommand {
    /// Measure the error against a reference for several sample counts, as table, CSV, JSON and plot
    #[command(after_help = "\
A table has one row per sample count, with errors of one layer over all pixels and colours, in linear
light unless stated otherwise:
  RMSE            root of the mean squared difference from the reference
  relative MSE    mean of squared difference / (reference squared + 0.01)
  bias            mean of (rendering - reference)
  sRGB steps      mean |difference| of sRGB-coded values, clamped to [0, 1], times 255, not rounded
  worst, p99 8x8  RMSE of the worst cell of 8 x 8 px; 99th percentile of the cells' RMSE
  stated/true     the tuple's own estimate of the RMSE (error_rms), divided by the RMSE
  CPU s           CPU seconds of the tracer on all threads, for the four layers together
Slopes are fitted to sample counts with an RMSE of at least three times the reference's stated error.

The rendered reference takes --reference-spp samples per pixel from another seed. OUT/reference keeps it
for later calls with the same scene, files, tracer version and sample count.

Examples:
  glasshouse bench error
  glasshouse bench error --scene scene.json --spp 1,4,16,64 --reference-spp 4096 --out error
  glasshouse bench error --scene scene.json --reference out")]
    Error(error::BenchErrorArgs),
    /// Measure rays per second on one core: the intersection kernels and the whole tracer, AVX2 and baseline
    #[command(after_help = "\
Rates count CPU time of one thread; tables have the median and the best of the passes. Passes alternate
between AVX2 and baseline, unless --isa avx2 or --isa baseline selects one. For each scene:
  intersection    span and walk for 16 samples of every pixel, in bundles of 4 x 4 px, without the time to
                  make camera samples and lines
  whole tracer    sixteen tiles of 16 x 16 px, 256 samples: camera samples, all orders, radiance, sums
  grid            construction of the grid and its pyramid
t0 and t1 are the pane's first orders to the front, r0 and r1 those to the back. R is the pinhole
without glass; with apex mirror, its rays need no walk. A ray's cells are those between its start and
its hit. A round advances sixteen rays by one cell; rounds repeat until all of these rays end.

Examples:
  glasshouse bench trace
  glasshouse bench trace --scene scene.json --dump rays")]
    Trace(trace::BenchTraceArgs),
    /// Measure the farm: shards per second by workers, overhead per shard, makespan over its bound, time to resume
    #[command(after_help = "\
Without --simulate, processes of this program (a coordinator, and workers of one thread each) work on
real runs in a temporary folder, with a temporary nats-server or the server of --queue. Film and sample
counts are so small that tracing takes almost no time; shards sleep instead, so that many workers fit on
few cores.
  no mode         1, 2, 4, ... workers, on the queue and as threads of one process, with shards that do
                  not sleep and with shards that do; then real shards of 256 px and 256 samples
    CPU us        CPU time per shard of workers, coordinator and server, without startup, reading,
                  decoding, tracing and merging, but with the store's threads
    worker us     makespan x workers / shards, without the sleep
  --makespan      8 workers, 50 scenes of 16 shards with costs from 1 to 16, the three most expensive
                  scenes last, leases of 2 s; then again with one worker four times slower and one killed
                  at a third of the bound, or with the faults of --kill and --slow. The tuples must equal
                  those of one process
  --resume        5000 scenes of 64 shards; half of the scenes have tuples, the others half of their
                  partials
With --simulate, the farm's own code shares the tasks; the queue's server, the store and the tracer are
models. Equal arguments give equal numbers.
  bound           (work + one load per scene) / available speed, a lower bound for every schedule
  makespan        time until the last tuple is in the store
  known           time until the coordinator finds this tuple in a listing of the store

Examples:
  glasshouse bench farm
  glasshouse bench farm --makespan
  glasshouse bench farm --resume
  glasshouse bench farm --simulate
  glasshouse bench farm --simulate --lease-s 2 --kill 0@3.1 --slow 1x4
  glasshouse bench farm --simulate --workers 100 --scenes 2000 --kill 5% --wipe 20")]
    Farm(BenchFarmArgs),
    /// Measure the composition of training examples: CPU seconds by part, examples per second
    #[command(after_help = "\
Composes examples of four synthetic tuples in memory with the default settings of composed examples, each
row up to one more stage. CPU milliseconds are those of one thread, the median of all examples. The
examples per second of -j threads (default: 2) are wall time, and 0.7 of these examples pass through JPEG.

Examples:
  glasshouse bench compose
  glasshouse bench compose --size 128 -j 1 --json")]
    Compose(compose::BenchComposeArgs),
    /// Measure a recipe's scenes: cost and error by feature of the pane, or CPU seconds of a tuple by stage
    #[command(after_help = "\
Draws some scenes of a recipe, spread over all, into a temporary folder, and works with one thread.
  --by feature    each scene as drawn, with its stack made flat, smooth and clean, and with a plain pane of
                  4 mm without covers, in turns. CPU seconds are those of the tracer with the set-up of the
                  scene, medians of the rounds; ratios are of sums, and the worst of one scene. error: the
                  stated error of I, root mean square over the scenes, as drawn, flat and plain
  --by stage      CPU milliseconds of a tuple: planning (draws and previews), reading, decoding, tracing,
                  merging, encoding and writing. Checks of the inputs and procedural photographs, which
                  a run makes once, have a line of their own

Examples:
  glasshouse bench recipe manifests/windows.toml
  glasshouse bench recipe manifests/windows.toml --spp 16 --by stage
  glasshouse bench recipe manifests/folder.toml --root photos=/data/holiday --scenes 100 --json")]
    Recipe(recipe::BenchRecipeArgs),
    /// Measure a training step: CPU seconds in total and by part, images per second, memory
    #[cfg(feature = "train")]
    #[command(after_help = "\
A step is a full step of the separation stage. The discriminator learns on (I, T). The losses of SP-net
and BT-net are l1 + 0.2 feature + 0.01 adversarial on T, and l1 + 0.2 feature on R~ and on BT-net(R~*)
against R. Adam updates the three networks. Images are random numbers, VGG-19 has random weights, and no
feature is cached between steps. CPU seconds are user + system time of all threads.
benches/peers/train_step.py runs the same step in PyTorch.

Examples:
  glasshouse bench train -j 1
  glasshouse bench train -j 1 --json --steps 3
  glasshouse bench train --size 64 --width 16 --no-features")]
    Train(train::BenchTrainArgs),
}

pub(super) fn run(args: &BenchArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    match &args.what {
        BenchCommand::Error(args) => error::run(args, global, output),
        BenchCommand::Compose(args) => Ok(compose::run(args, global, output)),
        BenchCommand::Farm(args) => farm::run(args, global, output),
        BenchCommand::Recipe(args) => recipe::run(args, global, output),
        BenchCommand::Trace(args) => trace::run(args, global, output),
        #[cfg(feature = "train")]
        BenchCommand::Train(args) => train::run(args, global, output),
    }
}

/// Reads a scene file and its photographs.
pub(super) fn read_scene(path: &Path, roots: &Roots) -> Result<BenchScene, Failure> {
    let invalid = |e: anyhow::Error| {
        let what = format!("cannot measure {}", path.display());
        Failure::new(Exit::InvalidInput, e.context(what))
    };
    let text = std::fs::read_to_string(path).map_err(|e| {
        failure!(Exit::InvalidInput, "cannot read {}: {e}; check the path", path.display())
    })?;
    let line = parse_scene(&text).map_err(|e| invalid(e.into()))?;
    let base = path.parent().map_or_else(Default::default, Path::to_owned);
    let files = read_files(&line, roots, &base).map_err(|e| invalid(e.into()))?;
    let photographs = decode(&line, &files).map_err(|e| invalid(e.into()))?;
    Ok(BenchScene { name: line.id.to_string(), line, photographs })
}

exit_codes! {
    BenchError {
        Sample | Write | Encode => Failed,
        Load | Assemble | Merge | NoReference | Read | Image | Size => InvalidInput,
    }
}
