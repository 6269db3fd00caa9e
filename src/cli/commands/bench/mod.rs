//! `bench`: its subcommands and their shared code.

mod error;
mod farm;
mod trace;
#[cfg(feature = "train")]
mod train;

use crate::bench::{BenchError, BenchScene};
use crate::cli::args::Global;
use crate::cli::exit_code::{Exit, Failure, exit_codes};
use crate::cli::output::Output;
use anyhow::Context;
use clap::{Args as ClapArgs, Subcommand};
use farm::BenchFarmArgs;
use render::line::{Roots, parse_scene};
use render::scene::{decode, read_files};
use std::path::Path;

#[derive(Debug, ClapArgs)]
pub(super) struct BenchArgs {
    #[command(subcommand)]
    what: BenchCommand,
}

/// The benchmarks.
#[derive(Debug, Subcommand)]
enum BenchCommand {
    /// Error against samples and CPU seconds: a ladder of sample counts against a reference, as table, CSV, JSON and plot
    #[command(after_help = "\
A rung of the ladder is one rendering of the four layers, measured over all pixels and colours, in
linear light unless stated otherwise:
  RMSE            root of the mean squared difference from the reference
  relative MSE    mean of squared difference / (reference squared + 0.01)
  bias            mean of (rendering - reference)
  sRGB steps      mean |difference| of sRGB-coded values, clamped to [0, 1], times 255, not rounded
  worst, p99 8x8  RMSE of the worst cell of 8 x 8 px; 99th percentile of the cells' RMSE
  stated/true     RMSE that the tuple states of itself (error_rms) over the RMSE
  CPU s           seconds of the tracer on all threads, for all four layers together
A slope is fitted to the rungs with an RMSE of at least three times the reference's stated error.

The rendered reference has --reference-spp samples of another seed. It is kept in OUT/reference and
reused while the scene, its files, the tracer's version and the samples stay the same.

Examples:
  glasshouse bench error
  glasshouse bench error --scene scene.json --spp 1,4,16,64 --reference-spp 4096 --out error
  glasshouse bench error --scene scene.json --reference out")]
    Error(error::BenchErrorArgs),
    /// Rays a second on one core: the intersection kernels and the whole tracer, AVX2 and baseline
    #[command(after_help = "\
CPU time of one thread: median and best of the passes, AVX2 and baseline in turns, or one of them with
--isa avx2 or --isa baseline. For each scene:
  intersection    span and walk of 256 samples of every fourth pixel across and down; camera samples
                  and lines are made before
  whole tracer    sixteen tiles of 16 x 16 px, 256 samples: camera samples, all orders, radiance, sums
  grid            building the grid and its pyramid
t0, t1 are the pane's first orders to the front, r0, r1 to the back; R is the pinhole without glass
(not walked with apex mirror). Cells are counted from a ray's start to its hit; a round advances sixteen
rays by one cell, until the last of them ends.

Examples:
  glasshouse bench trace
  glasshouse bench trace --scene scene.json --dump rays")]
    Trace(trace::BenchTraceArgs),
    /// The farm: shards a second against workers, overhead a shard, makespan against its lower bound, time to resume
    #[command(after_help = "\
Except with --simulate, real processes of this program work on real runs in a temporary folder, with a
temporary nats-server (or --queue): one coordinator, workers of one thread. Film and samples are so small
that tracing costs nothing; a shard with a cost sleeps, so that many workers fit on few cores.
  no mode         1, 2, 4, ... workers, on the queue and as threads of one process, with shards that cost
                  nothing and with shards that sleep; then real shards of 256 px and 256 samples
    CPU us        of workers, coordinator and server, without starting, reading, decoding, tracing and
                  merging, but with the store's threads
    worker us     makespan x workers / shards, without the sleep
  --makespan      8 workers, 50 scenes of 16 shards, costs 1:16, the three most expensive last, leases of
                  2 s; then the same with one worker four times slower and one killed at a third of the
                  time, unless --kill and --slow say otherwise. The tuples must equal those of one process
  --resume        5000 scenes of 64 shards: half of the scenes have tuples, the others half of their
                  partials
With --simulate the rules by which workers share tasks are the farm's own code; the queue's server, the
store and the tracer are models. Equal arguments give equal numbers.
  bound           (work + one load per scene) / available speed: no schedule can beat it
  makespan        until the last tuple is in the store
  known           until the coordinator has listed the store and knows it

Examples:
  glasshouse bench farm
  glasshouse bench farm --makespan
  glasshouse bench farm --resume
  glasshouse bench farm --simulate
  glasshouse bench farm --simulate --lease-s 2 --kill 0@3.1 --slow 1x4
  glasshouse bench farm --simulate --workers 100 --scenes 2000 --kill 5% --wipe 20")]
    Farm(BenchFarmArgs),
    /// A training step: CPU seconds and their parts, images a second, memory
    #[cfg(feature = "train")]
    #[command(after_help = "\
The step is a full step of the separation stage: the discriminator learns on (I, T); SP-net through
l1 + 0.2 feature + 0.01 adversarial on T and l1 + 0.2 feature on R~; l1 + 0.2 feature of BT-net(R~*)
against R; Adam on all three. Images are random numbers, VGG-19 has random weights, and no feature is
cached between steps. CPU seconds are user + system of all threads.
benches/peers/train_step.py is the same step in PyTorch.

Examples:
  glasshouse bench train -j 1
  glasshouse bench train -j 1 --json --steps 3
  glasshouse bench train --size 64 --width 16 --no-features")]
    Train(train::BenchTrainArgs),
}

pub(super) fn run(args: &BenchArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    match &args.what {
        BenchCommand::Error(args) => error::run(args, global, output),
        BenchCommand::Farm(args) => farm::run(args, global, output),
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
    let text = std::fs::read_to_string(path)
        .with_context(|| format!("cannot read {}; check the path", path.display()))
        .map_err(invalid)?;
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
