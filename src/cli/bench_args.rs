//! What can be typed after `bench`.

use super::args::{RootArgs, parse_spp};
use super::bench_farm_cmd::BenchFarmArgs;
use clap::{Args as ClapArgs, Subcommand};
use std::path::PathBuf;

/// `bench`
#[derive(Debug, ClapArgs)]
pub struct BenchArgs {
    /// What to measure.
    #[command(subcommand)]
    pub what: BenchCommand,
}

/// The benchmarks.
#[derive(Debug, Subcommand)]
pub enum BenchCommand {
    /// Error against samples and CPU seconds: a ladder of sample counts against a reference, as table, CSV, JSON and plot
    #[command(after_help = "\
A rung of the ladder is one rendering of the four layers. Its measures are taken over all pixels and
colours, in linear light where nothing else is said:
  RMSE            root of the mean squared difference from the reference
  relative MSE    mean of squared difference / (reference squared + 0.01)
  bias            mean of (rendering - reference)
  sRGB steps      mean |difference| of sRGB-coded values, clamped to [0, 1], times 255, not rounded
  worst, p99 8x8  RMSE of the worst cell of 8 x 8 px; RMSE that 99 % of the cells have at most
  stated/true     RMSE that the tuple states of itself (error_rms) over the RMSE
  CPU s           seconds of the tracer on all threads, for all four layers together
A slope is fitted to the rungs whose RMSE is at least three times the own reference's stated error.

The own reference has --reference-spp samples of another seed. It is kept in OUT/reference and used
again while the scene, its files, the tracer's version and the samples are the same.

Examples:
  glasshouse bench error
  glasshouse bench error --scene scene.json --spp 1,4,16,64 --reference-spp 4096 --out error
  glasshouse bench error --scene scene.json --reference out")]
    Error(BenchErrorArgs),
    /// Rays a second on one core: the intersection kernels and the whole tracer, AVX2 and baseline
    #[command(after_help = "\
One thread, its CPU time; the median of the passes, and the best; AVX2 and baseline in turns, or one of
them with --isa avx2 or --isa baseline. Of each scene:
  intersection    span and walk of 256 samples of every fourth pixel across and down; camera samples
                  and lines are made before
  whole tracer    sixteen tiles of 16 x 16 px, 256 samples: camera samples, all orders, radiance, sums
  grid            building the grid and its pyramid
t0, t1 are the pane's first orders to the front, r0, r1 to the back; R is the pinhole without glass
(nothing is walked for it with apex mirror). A cell is one between a ray's start and its hit; a round is
one cell of sixteen rays, until the last of them ends.

Examples:
  glasshouse bench trace
  glasshouse bench trace --scene scene.json --dump rays")]
    Trace(BenchTraceArgs),
    /// The farm: shards a second against workers, overhead a shard, makespan against its lower bound, time to resume
    #[command(after_help = "\
Without a mode, with --makespan and with --resume real processes of this program work on real runs in a
temporary folder, with a nats-server that is started for them (or --queue): one coordinator, workers of
one thread. Film and samples are so small that tracing costs nothing; where a shard should cost
something it sleeps, so that many workers fit on few cores.
  no mode         1, 2, 4, ... workers, on the queue and as threads of one process, with shards that cost
                  nothing and with shards that sleep; then real shards of 256 px and 256 samples
    CPU us        of workers, coordinator and server, without starting, reading, decoding, tracing and
                  merging; what the store's threads do for tuples is in it
    worker us     makespan x workers / shards, without the sleep
  --makespan      8 workers, 50 scenes of 16 shards, costs 1:16, the three dearest last, leases of 2 s;
                  then the same with one worker four times slower and one killed at a third of the time,
                  unless --kill and --slow say otherwise. The tuples must be those of one process
  --resume        5000 scenes of 64 shards: half of the scenes have tuples, the others half of their
                  partials
With --simulate nothing is traced and no server is asked: the rules by which workers share spans are the
farm's own code, the queue's server, the store and the tracer are models. Equal arguments give equal
numbers.
  bound           (work + one load a scene) / speed that was there: no schedule can beat it
  makespan        until the last tuple is in the store
  known           until the coordinator, which lists the store, knows it

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
The step is the separation stage's with everything in it: the discriminator learns on (I, T); SP-net
through l1 + 0.2 feature + 0.01 adversarial on T and l1 + 0.2 feature on R~; l1 + 0.2 feature of
BT-net(R~*) against R; Adam on all three. Images are random numbers, VGG-19 has random weights, no
feature is kept from one step to the next. CPU seconds are user + system of all threads.
benches/peers/train_step.py is the same step in PyTorch.

Examples:
  glasshouse bench train -j 1
  glasshouse bench train -j 1 --json --steps 3
  glasshouse bench train --size 64 --width 16 --no-features")]
    Train(BenchTrainArgs),
}

/// `bench train`
#[cfg(feature = "train")]
#[derive(Debug, ClapArgs)]
pub struct BenchTrainArgs {
    /// Side of the images, px
    #[arg(long, value_name = "PX", default_value_t = 256, value_parser = clap::value_parser!(u32).range(32..=4096))]
    pub size: u32,
    /// Channels of the generators
    #[arg(long, value_name = "N", default_value_t = 64)]
    pub width: usize,
    /// Images a step
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub batch: usize,
    /// Without VGG-19: red, green and blue alone, and no feature losses
    #[arg(long)]
    pub no_features: bool,
    /// Steps after the first, which warms up
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=10000))]
    pub steps: u32,
}

/// `bench error`
#[derive(Debug, ClapArgs)]
pub struct BenchErrorArgs {
    /// Scene (glasshouse.scene/1) [default: a built-in pair, 256 x 256 px]
    #[arg(long, value_name = "FILE")]
    pub scene: Option<PathBuf>,
    /// Folder of four reference images (LAYER.exr as `render` writes them, or ref_LAYER.npy) [default: rendered]
    #[arg(long, value_name = "DIR")]
    pub reference: Option<PathBuf>,
    /// Folder to write error.csv, error.json, error.svg and the own reference to
    #[arg(long, value_name = "DIR", default_value = "runs/bench-error")]
    pub out: PathBuf,
    /// Samples a pixel of the ladder, powers of two
    #[arg(long, value_name = "N,...", value_delimiter = ',', value_parser = parse_spp,
          default_value = "1,2,4,8,16,32,64,128,256,512,1024")]
    pub spp: Vec<u32>,
    /// Samples a pixel of the own reference, a power of two
    #[arg(long, value_name = "N", value_parser = parse_spp, default_value = "16384", conflicts_with = "reference")]
    pub reference_spp: u32,
    /// Seeds to average over
    #[arg(long, value_name = "K", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub seeds: u32,
    /// Named roots.
    #[command(flatten)]
    pub roots: RootArgs,
}

/// `bench trace`
#[derive(Debug, ClapArgs)]
pub struct BenchTraceArgs {
    /// Scene (glasshouse.scene/1), repeatable; after the built-in ones
    #[arg(long, value_name = "FILE")]
    pub scene: Vec<PathBuf>,
    /// Leave out the built-in scenes
    #[arg(long, requires = "scene")]
    pub no_builtin: bool,
    /// Passes, of which the median and the best are shown
    #[arg(long, value_name = "N", default_value_t = 7, value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub passes: u16,
    /// Folder to write rays, hits and vertices to, for another ray tracer (rays.json lists them)
    #[arg(long, value_name = "DIR")]
    pub dump: Option<PathBuf>,
    /// Named roots.
    #[command(flatten)]
    pub roots: RootArgs,
}
