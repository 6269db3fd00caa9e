//! What can be typed.

use super::bench_args::BenchArgs;
use super::export_args::ExportArgs;
use super::farm_args::{
    AuditArgs, ExplainArgs, HoldArgs, ResumeArgs, RetryArgs, StatusArgs, StoreArgs,
};
pub(super) use super::global_args::{ColorWhen, Global, IsaChoice, ProgressHow};
use super::isolate::Only;
use super::look_args::{CompletionsArgs, DoctorArgs, InspectArgs, ManArgs};
#[cfg(feature = "train")]
use super::train_args::{EvaluateArgs, SeparateArgs, TrainArgs};
use clap::{Args as ClapArgs, Parser, Subcommand, ValueEnum};
use std::path::PathBuf;
use std::time::Duration;

/// Farms physically based training data for single-image reflection removal.
#[derive(Debug, Parser)]
#[command(
    name = "glasshouse",
    version,
    max_term_width = 100,
    arg_required_else_help = true,
    after_help = "Examples:
  glasshouse doctor                       # is this machine fit for it?
  glasshouse run manifests/smoke.toml     # everything once, small, in seconds
  glasshouse run --help                   # every command has examples"
)]
pub struct Args {
    /// For every command.
    #[command(flatten)]
    pub global: Global,
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands, in pipeline order.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Plan, trace, merge and report a recipe on this machine; resumes what is there
    #[command(after_help = "Examples:
  glasshouse run manifests/smoke.toml
  glasshouse run manifests/smoke.toml --out runs/again -j 1")]
    Run(RunArgs),
    /// Make procedural RGBD photographs (rooms and streets) in the layout of DIODE or of PLACES365
    #[command(after_help = "Examples:
  glasshouse sample /tmp/rooms --count 8
  glasshouse sample /tmp/rooms --count 8 --seed 7 --json
  glasshouse sample /tmp/places --layout places --count 68
  glasshouse sample /tmp/many --layout places --count 4160 --width 32 --height 24")]
    Sample(SampleArgs),
    /// Turn a recipe or a .jsonl of scenes into a run's frozen manifest and spec
    #[command(after_help = "Examples:
  glasshouse plan manifests/smoke.toml -n
  glasshouse plan my.toml --root diode=/data/diode --out runs/mine
  glasshouse plan my.toml --root diode=/data/diode -n --json   # files, bytes, hours
  glasshouse plan my.toml --root diode=/data/diode --skip-invalid --out runs/mine")]
    Plan(PlanArgs),
    /// Render one scene (a scene file, or a tuple.json to make again) to four EXRs and PNGs
    #[command(after_help = "Examples:
  glasshouse render scene.json --out out --spp 1024 -j 2
  glasshouse render runs/smoke/tuples/train-sample-000000/tuple.json --out again")]
    Render(RenderArgs),
    /// Trace shards of a planned run until none are left, merging scenes as they are done
    #[command(after_help = "Examples:
  glasshouse work runs/smoke
  glasshouse work runs/smoke --time-limit 55m   # exits with 75 when more is left")]
    Work(WorkArgs),
    /// Keep a farm of many machines supplied until every scene is done; may be stopped and started at any time
    #[command(after_help = "Examples:
  glasshouse coordinate runs/mine --queue nats://localhost:4222
  glasshouse work runs/mine --queue nats://localhost:4222      # on as many machines as you like")]
    Coordinate(CoordinateArgs),
    /// Merge scenes whose partials are complete into tuples; refuses gaps
    #[command(after_help = "Examples:
  glasshouse merge runs/smoke
  glasshouse merge runs/smoke -n --json")]
    Merge(MergeArgs),
    /// Say what is done and what is left of a run, who works on it, and when it will be over
    #[command(after_help = "Examples:
  glasshouse status runs/smoke
  glasshouse status runs/smoke --json
  glasshouse status runs/smoke --watch")]
    Status(StatusArgs),
    /// Let workers take nothing new until the run is resumed; they finish what they have opened
    #[command(after_help = "Examples:
  glasshouse pause runs/smoke
  glasshouse pause runs/smoke --reason backup")]
    Pause(HoldArgs),
    /// Let a run go on that was paused or cancelled
    #[command(after_help = "Examples:
  glasshouse resume runs/smoke")]
    Resume(ResumeArgs),
    /// Give up what is left of a run: workers end after the shards in flight; what is done stays
    #[command(after_help = "Examples:
  glasshouse cancel runs/smoke
  glasshouse cancel runs/smoke --json")]
    Cancel(HoldArgs),
    /// Take scenes out of quarantine, to be tried again; or have some made anew
    #[command(after_help = "Examples:
  glasshouse retry runs/smoke --all
  glasshouse retry runs/smoke --all --json   # or name the scenes")]
    Retry(RetryArgs),
    /// Say everything that is known of a scene or a shard, what happens next, and what you can do
    #[command(after_help = "Examples:
  glasshouse explain runs/smoke train-sample-000000
  glasshouse explain runs/smoke train-sample-000000:0")]
    Explain(ExplainArgs),
    /// Trace some scenes again and compare every file with what the run holds, bit for bit
    #[command(after_help = "Examples:
  glasshouse audit runs/smoke
  glasshouse audit runs/smoke --share 0.2 --seed 7
  glasshouse audit runs/smoke --scene train-sample-000000")]
    Audit(AuditArgs),
    /// Train BT-net or SP-net on a run's tuples; resumes from the newest checkpoint
    #[cfg(feature = "train")]
    #[command(after_help = "\
Checkpoints stand in RUN/train/STAGE/step-NNNNNNN (model.safetensors, optimizer.safetensors, state.json),
beside metrics.csv, TensorBoard's event files and pictures/ (validation scenes: I, T*, T, R~*, R~, R*, R).
Stopping at any time loses the steps since the last checkpoint (Ctrl-C: none); the same command goes on,
and ends with the same bits on the same kind of CPU, on any number of threads.

The separation stage comes second: the same with --stage separation.

Examples:
  glasshouse train runs/smoke --stage backtrack --steps 200
  glasshouse train runs/smoke --stage separation --steps 200 --json")]
    Train(TrainArgs),
    /// Score trained networks, and the pictures as they were, against the truth
    #[cfg(feature = "train")]
    #[command(after_help = "\
The first row of the table is the input as it is; the second the input times one factor of linear
light, the best for train scenes: what comes of brightness alone. PSNR and SSIM are of 8-bit
pictures at their own size, none resized. Real pairs whose truth lies beside the picture are named,
and a second table leaves them out. In JSON the PSNR of equal pictures is the string \"inf\".

Exit code 3: some pairs are missing or cannot be read, `left_out` tells which. 4: nothing to score.

Examples:
  glasshouse evaluate runs/smoke
  glasshouse evaluate runs/smoke --split all --checkpoint runs/smoke/train/separation --json
  glasshouse evaluate pairs --checkpoint ours=runs/smoke --fit-gain runs/smoke --out scores")]
    Evaluate(EvaluateArgs),
    /// Take the reflections out of photographs with a trained network
    #[cfg(feature = "train")]
    #[command(after_help = "\
Each picture becomes NAME.transmission.png (what is behind the glass) and
NAME.glass_reflection.png (what the glass adds): 8-bit sRGB, as large as the picture, turned as its
EXIF data say.

Exit code 3: some pictures cannot be read or are smaller than 16 px a side; the others are done.

Examples:
  glasshouse separate runs/smoke photo.jpg --out separated
  glasshouse separate runs/smoke/train/separation photo.jpg --out separated --tile-px 512 --json")]
    Separate(SeparateArgs),
    /// Make a data set of a run's tuples, in a form that loaders know: tars, folders or OpenEXR files
    #[command(after_help = "\
webdataset   DIR/SPLIT-000000.tar with ID.LAYER.png and ID.json, for the WebDataset library
imagefolder  DIR/SPLIT/metadata.jsonl and DIR/SPLIT/LAYER/ID.png, for Hugging Face's datasets
pairs        DIR/SPLIT/blended/ID.png, transmission_layer/, reflection_layer/, clean_reflection_layer/
exr          DIR/SPLIT/ID.exr: OpenEXR with a part for each layer, linear light

Beside them a dataset card (README.md), croissant.json (of the first two), export.json and SHA256SUMS.
Equal runs make equal bytes. An export that was stopped goes on with the same command; a folder that
holds something else is refused. docs/datasets.md shows how to read each form in PyTorch.

Exit code 3: scenes in quarantine, or (with --partial) not merged yet, are not in it. 75: the run is not
finished.

Examples:
  glasshouse export runs/smoke --format webdataset --out smoke-webdataset
  glasshouse export runs/smoke --format imagefolder --out smoke-imagefolder --split train
  glasshouse export runs/smoke --format pairs --encoding srgb16 --out smoke-pairs --json")]
    Export(ExportArgs),
    /// Write report/index.html: the whole run on one page that needs nothing else, to look at and to attach to a mail
    #[command(after_help = "\
On the page: the run at a glance, a contact sheet of up to 32 tuples with maps of their noise, stated
errors and what they cost, where the seconds went, parameters, quarantine, training and scores. It
has no script and fetches nothing; at most about 10 MB, whatever the size of the run. A run that is
half done has a report, too. Training and scores are those of RUN, also where --store is given.

Exit code 3: some tuples are damaged; the page and `damaged` tell which.

Examples:
  glasshouse report runs/smoke
  glasshouse report runs/smoke --out smoke.html --json")]
    Report(ReportArgs),
    /// Explain files: what each is, which scene it belongs to, whether it is whole
    #[command(after_help = "\
Kinds are told by content: partials, tuples, specs, manifests, recipes, records of the farm, checkpoints, curves, event
files, scores, exported archives, report pages, input files; and folders of a run, a tuple, a checkpoint.

Exit code 4: a file is damaged, unknown or not there; the text says what is wrong, where, and what to do.

Examples:
  glasshouse inspect runs/smoke
  glasshouse inspect runs/smoke/tuples/train-sample-000000/tuple.exr
  glasshouse inspect runs/smoke/spec.json runs/smoke/manifest.jsonl --json")]
    Inspect(InspectArgs),
    /// Check this machine, a run's disk, a store and a queue, and say what to do
    #[command(after_help = "\
Looks at processor and kernels, cores, memory, open files, clock, whether the right bits are computed, and the disk:
space, speed, what names, links, renames and locks promise there. With --store and --queue also those.
Small files, an object and a stream are made for it and removed.

Exit code 1: something fails. Warnings alone end with 0.

Examples:
  glasshouse doctor
  glasshouse doctor runs/smoke -j 2 --json
  glasshouse doctor --store s3://bucket/runs/mine --queue nats://localhost:4222")]
    Doctor(DoctorArgs),
    /// Print the JSON Schema of recipes, for editors that check them while you write
    #[command(after_help = "Examples:
  glasshouse schema > recipe.schema.json
  glasshouse schema --json")]
    Schema,
    /// Measure speed and error on this machine; needs no data
    #[command(after_help = "Examples:
  glasshouse bench error
  glasshouse bench trace
  glasshouse bench error --help   # what is measured, and how")]
    Bench(BenchArgs),
    /// Print a script that completes this program's command line in a shell
    #[command(after_help = "Examples:
  glasshouse completions bash > glasshouse.bash   # then: source glasshouse.bash
  glasshouse completions zsh > _glasshouse        # into a folder of $fpath
  glasshouse completions fish --json")]
    Completions(CompletionsArgs),
    /// Write a man page for every command, or print the main one
    #[command(after_help = "Examples:
  glasshouse man --out man      # then: man -l man/glasshouse-run.1
  glasshouse man > glasshouse.1")]
    Man(ManArgs),
}

/// A place for a named root.
#[derive(Clone, Debug, ClapArgs)]
pub struct RootArgs {
    /// Folder of a named root, or s3://BUCKET/PREFIX; repeatable
    #[arg(long = "root", value_name = "NAME=DIR")]
    pub roots: Vec<String>,
}

/// `plan`
#[derive(Debug, ClapArgs)]
pub struct PlanArgs {
    /// Recipe (.toml) or scenes (.jsonl)
    pub recipe: PathBuf,
    /// Folder of the run [default: runs/NAME]
    #[arg(long, value_name = "RUN")]
    pub out: Option<PathBuf>,
    /// Side of a tile, px [default: such that a shard takes 0.2 s, 64 to 256]
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u32).range(1..=16384))]
    pub tile: Option<u32>,
    /// Leave out photographs whose files cannot be used, and draw others in their place (of a .jsonl: leave out scenes)
    #[arg(long)]
    pub skip_invalid: bool,
    /// Named roots.
    #[command(flatten)]
    pub roots: RootArgs,
}

/// How often what is traced is written down.
#[derive(Clone, Copy, Debug, ClapArgs)]
pub struct CheckpointArgs {
    /// Partials of a scene that is open as a whole wait in memory for so long, for the rest of it: what a kill may cost
    #[arg(long, value_name = "S", default_value = "20", value_parser = parse_duration, env = "GLASSHOUSE_CHECKPOINT_S")]
    pub checkpoint_s: Duration,
}

/// `run`
#[derive(Debug, ClapArgs)]
pub struct RunArgs {
    /// What to plan, and where.
    #[command(flatten)]
    pub plan: PlanArgs,
    /// When to write partials.
    #[command(flatten)]
    pub checkpoint: CheckpointArgs,
}

/// `sample`
#[derive(Debug, ClapArgs)]
pub struct SampleArgs {
    /// Folder to write to
    pub dir: PathBuf,
    /// Photographs to make
    #[arg(long, value_name = "N")]
    pub count: u32,
    /// Seed
    #[arg(long, default_value_t = 2020)]
    pub seed: u64,
    /// Pixels across [default: 1024; 256 for places]
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u32).range(1..=16384))]
    pub width: Option<u32>,
    /// Pixels down [default: 768; 256 for places]
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u32).range(1..=16384))]
    pub height: Option<u32>,
    /// Folders and files
    #[arg(long, value_enum, default_value = "diode")]
    pub layout: SampleLayout,
}

/// `--layout`
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SampleLayout {
    /// DIODE's: PNG, depth in metres, mask.
    Diode,
    /// PLACES365's: JPEG by category, relative inverse depth in a folder beside it.
    Places,
}

impl SampleLayout {
    /// As it is typed.
    pub fn name(self) -> &'static str {
        match self {
            Self::Diode => "diode",
            Self::Places => "places",
        }
    }
}

/// `render`
#[derive(Debug, ClapArgs)]
pub struct RenderArgs {
    /// Scene (glasshouse.scene/1), or a tuple.json
    pub scene: PathBuf,
    /// Folder to write to
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Samples a pixel, a power of two from 1 to 65536 [default: the scene's]
    #[arg(long, value_name = "N", value_parser = parse_spp)]
    pub spp: Option<u32>,
    /// Side of a tile, px: how the work is cut, never what comes out
    #[arg(long, value_name = "PX", default_value_t = 32, value_parser = clap::value_parser!(u32).range(1..=16384))]
    pub tile: u32,
    /// Named roots.
    #[command(flatten)]
    pub roots: RootArgs,
}

/// Where input files from object stores are kept.
#[derive(Clone, Debug, ClapArgs)]
pub struct CacheArgs {
    /// Folder for input files that come from an object store; workers may share it [default: RUN/cache]
    #[arg(long, value_name = "DIR", env = "GLASSHOUSE_CACHE")]
    pub cache: Option<PathBuf>,
    /// Its size at most, about, in GB; 0 keeps nothing
    #[arg(long, value_name = "GB", default_value = "20", value_parser = parse_gb)]
    pub cache_gb: f64,
}

/// `work`
#[derive(Debug, ClapArgs)]
pub struct WorkArgs {
    /// Folder of the run
    pub run: PathBuf,
    /// Begin no shard after this time (90, 90s, 55m, 2h), then exit with 75 if work is left
    #[arg(long, value_name = "TIME", value_parser = parse_duration)]
    pub time_limit: Option<Duration>,
    /// Named roots.
    #[command(flatten)]
    pub roots: RootArgs,
    /// The queue.
    #[command(flatten)]
    pub queue: QueueArgs,
    /// Input files from object stores.
    #[command(flatten)]
    pub cache: CacheArgs,
    /// When to write partials.
    #[command(flatten)]
    pub checkpoint: CheckpointArgs,
    /// A scene without any progress for this time counts as hung: the worker ends and leaves it to others
    #[arg(long, value_name = "S", default_value = "120", value_parser = parse_duration, help_heading = FARM)]
    pub hang_s: Duration,
    /// Name of this worker in messages and receipts [default: host and process]
    #[arg(long, value_name = "NAME", help_heading = FARM)]
    pub name: Option<String>,
    /// Only these shards of a scene, for a worker that fears them
    #[arg(long, value_name = "SCENE:A-B", hide = true)]
    pub only: Option<Only>,
    /// Misbehave: abort:SCENE, hang:SCENE, wrong:SCENE, slow:FACTOR (repeatable)
    #[arg(long = "fault", value_name = "FAULT", hide = true)]
    pub faults: Vec<crate::farm::Fault>,
}

pub(super) const FARM: &str = "Many machines";

/// Where the queue and the store of a farm are.
#[derive(Clone, Debug, ClapArgs)]
#[command(next_help_heading = FARM)]
pub struct QueueArgs {
    /// NATS server: nats://host:4222, tls://host:4222, several with commas
    #[arg(
        long,
        value_name = "URL",
        env = "GLASSHOUSE_QUEUE",
        hide_env_values = true
    )]
    pub queue: Option<String>,
    /// Where the run's objects are, if not in the run's folder: a folder that all machines see, or s3://BUCKET/PREFIX
    #[arg(long, value_name = "URL", env = "GLASSHOUSE_STORE", requires = "queue")]
    pub store: Option<String>,
    /// Try again for so long when the store is away or busy; a worker then ends with 75
    #[arg(long, value_name = "S", default_value = "45", value_parser = parse_duration, requires = "queue")]
    pub store_patience_s: Duration,
    /// What is held for longer without a sign of life goes to another worker; the same for all
    #[arg(long, value_name = "S", default_value = "30", value_parser = parse_duration, requires = "queue")]
    pub lease_s: Duration,
    /// File with the seed of an nkey
    #[arg(
        long,
        value_name = "FILE",
        env = "GLASSHOUSE_QUEUE_NKEY",
        requires = "queue"
    )]
    pub queue_nkey: Option<PathBuf>,
    /// File with NATS credentials, as nsc writes it
    #[arg(
        long,
        value_name = "FILE",
        env = "GLASSHOUSE_QUEUE_CREDS",
        requires = "queue"
    )]
    pub queue_creds: Option<PathBuf>,
    /// File with certificates (PEM) to trust besides the system's
    #[arg(
        long,
        value_name = "FILE",
        env = "GLASSHOUSE_QUEUE_CA",
        requires = "queue"
    )]
    pub queue_ca: Option<PathBuf>,
}

/// `coordinate`
#[derive(Debug, ClapArgs)]
pub struct CoordinateArgs {
    /// Folder of the run
    pub run: PathBuf,
    /// The queue.
    #[command(flatten)]
    pub queue: QueueArgs,
    /// Address of the status page; port 0 picks one and prints it
    #[arg(long, value_name = "ADDR:PORT", help_heading = FARM)]
    pub listen: Option<std::net::SocketAddr>,
    /// File with the secret (16 characters or more) that opens the page's buttons; or GLASSHOUSE_TOKEN in the environment
    #[arg(long, value_name = "FILE", requires = "listen", help_heading = FARM)]
    pub token_file: Option<PathBuf>,
}

/// `merge`
#[derive(Debug, ClapArgs)]
pub struct MergeArgs {
    /// Folder of the run
    pub run: PathBuf,
    /// Where the run's objects are, if not in the run's folder: a folder, or s3://BUCKET/PREFIX
    #[arg(long, value_name = "URL", env = "GLASSHOUSE_STORE", help_heading = FARM)]
    pub store: Option<String>,
}

/// `report`
#[derive(Debug, ClapArgs)]
pub struct ReportArgs {
    /// Folder of the run
    pub run: PathBuf,
    /// File to write [default: RUN/report/index.html]
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// The store.
    #[command(flatten)]
    pub store: StoreArgs,
}

pub(super) fn parse_spp(text: &str) -> Result<u32, String> {
    match text.parse::<u32>() {
        Ok(n) if n.is_power_of_two() && n <= 65_536 => Ok(n),
        _ => Err("samples a pixel are a power of two from 1 to 65536".to_owned()),
    }
}

fn parse_gb(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(gb) if (0.0..=1e6).contains(&gb) => Ok(gb),
        _ => Err("write gigabytes, 0 to 1000000".to_owned()),
    }
}

pub(super) fn parse_duration(text: &str) -> Result<Duration, String> {
    let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let scale = match &text[digits.len()..] {
        "" | "s" => 1.0,
        "m" => 60.0,
        "h" => 3600.0,
        unit => {
            return Err(format!(
                "unknown unit {unit:?}: write seconds, 90s, 55m or 2h"
            ));
        }
    };
    let number: f64 = digits
        .parse()
        .map_err(|_| "write seconds, 90s, 55m or 2h".to_owned())?;
    Duration::try_from_secs_f64(number * scale).map_err(|e| e.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_sound() {
        Args::command().debug_assert();
    }

    #[test]
    fn durations_have_units() {
        assert_eq!(parse_duration("90"), Ok(Duration::from_secs(90)));
        assert_eq!(parse_duration("0.5s"), Ok(Duration::from_millis(500)));
        assert_eq!(parse_duration("55m"), Ok(Duration::from_mins(55)));
        assert_eq!(parse_duration("2h"), Ok(Duration::from_hours(2)));
        for bad in ["", "x", "5d", "-1", "1e999"] {
            assert!(parse_duration(bad).is_err(), "{bad}");
        }
    }
}
