//! Arguments that several commands share. This file imports no command.

use super::exit_code::{Exit, Failure, failure};
use crate::farm::queue::NatsOptions;
use clap::{Args as ClapArgs, ValueEnum};
use render::ids::SceneId;
use render::line::Split;
use render::trace::Isa;
use std::path::PathBuf;
use std::time::Duration;

/// Options of every command.
#[derive(Clone, Debug, ClapArgs)]
#[command(next_help_heading = "Options of every command")]
pub(super) struct Global {
    /// Print one JSON object with a `schema` field to stdout, and nothing else there
    #[arg(long, global = true)]
    pub(super) json: bool,
    /// Compute threads; two more threads read and write files [default: one for each core]
    #[arg(short = 'j', long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(super) threads: Option<u16>,
    /// Print no progress and no notes
    #[arg(short, long, global = true)]
    pub(super) quiet: bool,
    /// Print more: rejected partials, time by stage
    #[arg(short, long, global = true)]
    pub(super) verbose: bool,
    /// Print what the command would do, write nothing
    #[arg(short = 'n', long, global = true)]
    pub(super) dry_run: bool,
    /// Colour of messages
    #[arg(long, global = true, value_enum, default_value = "auto", value_name = "WHEN")]
    pub(super) color: ColorWhen,
    /// Progress: bars on a terminal, plain lines elsewhere
    #[arg(long, global = true, value_enum, default_value = "auto", value_name = "HOW")]
    pub(super) progress: ProgressHow,
    /// Instruction set of the tracer's kernels; all give the same bits
    #[arg(long, global = true, value_enum, default_value = "auto", hide = true)]
    pub(super) isa: IsaChoice,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum ColorWhen {
    /// On a terminal, unless NO_COLOR is set.
    Auto,
    /// Always.
    Always,
    /// Never.
    Never,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum ProgressHow {
    /// Bars on a terminal, else plain lines.
    Auto,
    /// Bars.
    Bar,
    /// A line every few seconds.
    Plain,
    /// None.
    None,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum IsaChoice {
    /// The fastest that this machine has.
    Auto,
    /// Instructions that every machine has.
    Baseline,
    /// 256-bit vectors.
    Avx2,
}

/// Threads to use.
pub(super) fn threads(global: &Global) -> usize {
    let cores = || std::thread::available_parallelism().map_or(1, usize::from);
    global.threads.map_or_else(cores, usize::from)
}

/// Kernels to use.
pub(super) fn isa(global: &Global) -> Result<Isa, Failure> {
    match global.isa {
        IsaChoice::Auto => Ok(Isa::detect()),
        IsaChoice::Baseline => Ok(Isa::Baseline),
        IsaChoice::Avx2 if Isa::detect() == Isa::Avx2 => Ok(Isa::Avx2),
        IsaChoice::Avx2 => Err(failure!(Exit::Usage, "this machine has no AVX2; use --isa auto")),
    }
}

/// The text of a value on the command line.
pub(super) fn typed(value: &impl ValueEnum) -> String {
    let name = value.to_possible_value();
    name.map_or_else(String::new, |name| name.get_name().to_owned())
}

/// Folders of named roots.
#[derive(Clone, Debug, ClapArgs)]
pub(super) struct RootArgs {
    /// Folder of a named root, or s3://BUCKET/PREFIX; repeatable
    #[arg(long = "root", value_name = "NAME=DIR")]
    pub(super) roots: Vec<String>,
}

/// How often partials are written.
#[derive(Clone, Copy, Debug, ClapArgs)]
pub(super) struct CheckpointArgs {
    /// Seconds for which a scene's partials stay in memory before they are written; a kill loses at most that much work
    #[arg(long, value_name = "S", default_value = "20", value_parser = parse_duration, env = "GLASSHOUSE_CHECKPOINT_S")]
    pub(super) checkpoint_s: Duration,
}

/// Cache of input files from object stores.
#[derive(Clone, Debug, ClapArgs)]
pub(super) struct CacheArgs {
    /// Folder for input files that come from an object store; workers may share it [default: RUN/cache]
    #[arg(long, value_name = "DIR", env = "GLASSHOUSE_CACHE")]
    pub(super) cache: Option<PathBuf>,
    /// Approximate limit of the cache, GB; 0 keeps nothing
    #[arg(long, value_name = "GB", default_value = "20", value_parser = parse_gb)]
    pub(super) cache_gb: f64,
}

pub(super) const FARM: &str = "Many machines";

/// Where a run's objects are.
#[derive(Clone, Debug, ClapArgs)]
#[command(next_help_heading = FARM)]
pub(super) struct StoreArgs {
    /// Where the run's objects are, if not in the run's folder: a folder, or s3://BUCKET/PREFIX; spec and manifest are fetched from there if RUN lacks them
    #[arg(long, value_name = "URL", env = "GLASSHOUSE_STORE")]
    pub(super) store: Option<String>,
}

/// Keys to a NATS server.
#[derive(Clone, Debug, ClapArgs)]
#[command(next_help_heading = FARM)]
#[allow(clippy::struct_field_names, reason = "clap makes the flags of the names")]
pub(super) struct NatsKeys {
    /// File with the seed of an nkey
    #[arg(long, value_name = "FILE", env = "GLASSHOUSE_QUEUE_NKEY", requires = "queue")]
    queue_nkey: Option<PathBuf>,
    /// File with NATS credentials, as nsc writes it
    #[arg(long, value_name = "FILE", env = "GLASSHOUSE_QUEUE_CREDS", requires = "queue")]
    queue_creds: Option<PathBuf>,
    /// File with certificates (PEM) to trust besides the system's
    #[arg(long, value_name = "FILE", env = "GLASSHOUSE_QUEUE_CA", requires = "queue")]
    queue_ca: Option<PathBuf>,
}

impl NatsKeys {
    /// Options of a connection to `url` under `name`.
    pub(super) fn options(&self, url: String, name: String) -> NatsOptions {
        let [nkey, creds, ca] =
            [&self.queue_nkey, &self.queue_creds, &self.queue_ca].map(Clone::clone);
        NatsOptions { url, nkey, creds, ca, name }
    }
}

/// Queue and store of a farm.
#[derive(Clone, Debug, ClapArgs)]
#[command(next_help_heading = FARM)]
pub(super) struct QueueArgs {
    /// NATS server: nats://host:4222, tls://host:4222, several with commas
    #[arg(long, value_name = "URL", env = "GLASSHOUSE_QUEUE", hide_env_values = true)]
    pub(super) queue: Option<String>,
    /// Where the run's objects are, if not in the run's folder: a folder that all machines see, or s3://BUCKET/PREFIX
    #[arg(long, value_name = "URL", env = "GLASSHOUSE_STORE", requires = "queue")]
    pub(super) store: Option<String>,
    /// Retry a store that is unavailable or busy for so long; after that a worker exits with 75
    #[arg(long, value_name = "S", default_value = "45", value_parser = parse_duration, requires = "queue")]
    pub(super) store_patience_s: Duration,
    /// Lease: a task whose worker is silent for longer goes to another worker; must be the same on all machines
    #[arg(long, value_name = "S", default_value = "30", value_parser = parse_duration, requires = "queue")]
    pub(super) lease_s: Duration,
    #[command(flatten)]
    pub(super) keys: NatsKeys,
}

/// A queue that a command only reads.
#[derive(Clone, Debug, ClapArgs)]
#[command(next_help_heading = FARM)]
pub(super) struct ServerArgs {
    /// NATS server, to show how full the queue is: nats://host:4222, tls://host:4222, several with commas
    #[arg(long, value_name = "URL", env = "GLASSHOUSE_QUEUE", hide_env_values = true)]
    pub(super) queue: Option<String>,
    /// File with the seed of an nkey
    #[arg(long, value_name = "FILE", env = "GLASSHOUSE_QUEUE_NKEY")]
    pub(super) queue_nkey: Option<PathBuf>,
    /// File with NATS credentials, as nsc writes it
    #[arg(long, value_name = "FILE", env = "GLASSHOUSE_QUEUE_CREDS")]
    pub(super) queue_creds: Option<PathBuf>,
    /// File with certificates (PEM) to trust besides the system's
    #[arg(long, value_name = "FILE", env = "GLASSHOUSE_QUEUE_CA")]
    pub(super) queue_ca: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum SplitName {
    /// Scenes that no training sees.
    Test,
    /// Scenes to train on.
    Train,
    /// Both.
    All,
}

impl SplitName {
    /// The text of the value on the command line.
    #[cfg(feature = "train")]
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Test => "test",
            Self::Train => "train",
            Self::All => "all",
        }
    }

    /// True if the choice includes scenes of `split`.
    pub(super) fn has(self, split: Split) -> bool {
        match self {
            Self::Test => split == Split::Test,
            Self::Train => split == Split::Train,
            Self::All => true,
        }
    }
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
            return Err(format!("unknown unit {unit:?}: write seconds, 90s, 55m or 2h"));
        }
    };
    let number: f64 = digits.parse().map_err(|_| "write seconds, 90s, 55m or 2h".to_owned())?;
    Duration::try_from_secs_f64(number * scale).map_err(|e| e.to_string())
}

pub(super) fn parse_scene_id(text: &str) -> Result<SceneId, String> {
    SceneId::new(text).map_err(|e| e.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

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
