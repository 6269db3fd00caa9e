//! Arguments that several commands share. This file imports no command.

use super::exit_code::{Exit, Failure, failure};
use crate::farm::queue::NatsOptions;
use clap::{Args as ClapArgs, ValueEnum};
use glasshouse_line::Split;
use glasshouse_line::ids::SceneId;
use render::trace::Isa;
use std::path::PathBuf;
use std::time::Duration;

/// Options of every command.
#[derive(Clone, Debug, ClapArgs)]
#[command(next_help_heading = "Options of every command")]
pub(super) struct Global {
    /// Print the result to stdout as one JSON object with a `schema` field
    #[arg(long, global = true)]
    pub(super) json: bool,
    /// Number of compute threads; a worker has two more for its files [default: number of cores]
    #[arg(short = 'j', long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(super) threads: Option<u16>,
    /// Print no progress and no notes
    #[arg(short, long, global = true)]
    pub(super) quiet: bool,
    /// Print details, such as rejected partials and time by stage
    #[arg(short, long, global = true)]
    pub(super) verbose: bool,
    /// Print what the command would do, and write nothing
    #[arg(short = 'n', long, global = true)]
    pub(super) dry_run: bool,
    /// When to colour messages
    #[arg(long, global = true, value_enum, default_value = "auto", value_name = "WHEN")]
    pub(super) color: ColorWhen,
    /// Form of the progress messages
    #[arg(long, global = true, value_enum, default_value = "auto", value_name = "HOW")]
    pub(super) progress: ProgressHow,
    /// Time without progress after which a read of a file, or a scene, counts as hung; the command then exits with 1
    #[arg(long, global = true, value_name = "S", default_value = "120", value_parser = parse_duration)]
    pub(super) hang_s: Duration,
    /// Instruction set of the tracer's kernels; all give the same bits
    #[arg(long, global = true, value_enum, default_value = "auto", hide = true)]
    pub(super) isa: IsaChoice,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum ColorWhen {
    /// Colour on a terminal, unless NO_COLOR is set.
    Auto,
    /// Colour, even without a terminal.
    Always,
    /// No colour.
    Never,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum ProgressHow {
    /// Bars on a terminal, plain lines elsewhere.
    Auto,
    /// Progress bars.
    Bar,
    /// A line at most every ten seconds.
    Plain,
    /// No progress messages.
    None,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum IsaChoice {
    /// The fastest instruction set of this machine.
    Auto,
    /// Instructions that every machine supports.
    Baseline,
    /// 256-bit vectors.
    Avx2,
    /// 512-bit vectors.
    Avx512,
}

/// Returns the number of compute threads.
pub(super) fn threads(global: &Global) -> usize {
    let cores = || std::thread::available_parallelism().map_or(1, usize::from);
    global.threads.map_or_else(cores, usize::from)
}

/// Selects the instruction set of the kernels; fails if this machine lacks it.
pub(super) fn isa(global: &Global) -> Result<Isa, Failure> {
    let (isa, name) = match global.isa {
        IsaChoice::Auto => return Ok(Isa::detect()),
        IsaChoice::Baseline => return Ok(Isa::Baseline),
        IsaChoice::Avx2 => (Isa::Avx2, "AVX2"),
        IsaChoice::Avx512 => (Isa::Avx512, "AVX-512"),
    };
    if isa.is_available() {
        return Ok(isa);
    }
    Err(failure!(Exit::Usage, "this machine has no {name}; use --isa auto"))
}

/// Returns the command-line name of a value.
pub(super) fn typed(value: &impl ValueEnum) -> String {
    let name = value.to_possible_value();
    name.map_or_else(String::new, |name| name.get_name().to_owned())
}

/// Folders or addresses of named roots.
#[derive(Clone, Debug, ClapArgs)]
pub(super) struct RootArgs {
    /// Folder of a named root, or s3://BUCKET/PREFIX; repeatable
    #[arg(long = "root", value_name = "NAME=DIR")]
    pub(super) roots: Vec<String>,
}

/// What a worker keeps in memory.
#[derive(Clone, Copy, Debug, ClapArgs)]
pub(super) struct MemoryArgs {
    /// Longest time that a scene's partials wait in memory, in seconds; a kill loses them and the shards in flight
    #[arg(long, value_name = "S", default_value = "20", value_parser = parse_duration, env = "GLASSHOUSE_CHECKPOINT_S")]
    pub(super) checkpoint_s: Duration,
    /// Memory for decoded photographs, GB, in case later scenes show them again
    #[arg(long, value_name = "GB", default_value = "0", value_parser = parse_gb)]
    pub(super) photographs_gb: f64,
}

/// Cache of input files from object stores.
#[derive(Clone, Debug, ClapArgs)]
pub(super) struct CacheArgs {
    /// Folder for input files that come from an object store; workers may share it [default: RUN/cache]
    #[arg(long, value_name = "DIR", env = "GLASSHOUSE_CACHE")]
    pub(super) cache: Option<PathBuf>,
    /// Approximate size limit of the cache, GB; 0 disables the cache
    #[arg(long, value_name = "GB", default_value = "20", value_parser = parse_gb)]
    pub(super) cache_gb: f64,
}

pub(super) const FARM: &str = "Many machines";

#[derive(Clone, Debug, ClapArgs)]
#[command(next_help_heading = FARM)]
pub(super) struct StoreArgs {
    /// Store of the run's objects, if not RUN: a folder, or s3://BUCKET/PREFIX; RUN gets spec and manifest from it
    #[arg(long, value_name = "URL", env = "GLASSHOUSE_STORE")]
    pub(super) store: Option<String>,
}

/// How a command that resumes looks at the results of earlier calls.
#[derive(Clone, Debug, ClapArgs)]
pub(super) struct VerifyArgs {
    /// Read all bytes of earlier results and of their inputs, also where size, times and inode of a file are the same
    #[arg(long)]
    pub(super) verify: bool,
}

/// Keys and certificates for a NATS server.
#[derive(Clone, Debug, ClapArgs)]
#[command(next_help_heading = FARM)]
#[allow(clippy::struct_field_names, reason = "clap derives the flags from the names")]
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
    /// Returns the options of a connection to `url` with the client name `name`.
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
    /// NATS server: nats://host:4222 or tls://host:4222; commas separate several
    #[arg(long, value_name = "URL", env = "GLASSHOUSE_QUEUE", hide_env_values = true)]
    pub(super) queue: Option<String>,
    /// Store of the run's objects, if not RUN: a folder that all machines share, or s3://BUCKET/PREFIX
    #[arg(long, value_name = "URL", env = "GLASSHOUSE_STORE", requires = "queue")]
    pub(super) store: Option<String>,
    /// Seconds to retry an unavailable or busy store; a worker then exits with 75
    #[arg(long, value_name = "S", default_value = "45", value_parser = parse_duration, requires = "queue")]
    pub(super) store_patience_s: Duration,
    /// Duration of a lease, equal on all machines; the queue passes on a task of a worker that is silent for longer
    #[arg(long, value_name = "S", default_value = "30", value_parser = parse_duration, requires = "queue")]
    pub(super) lease_s: Duration,
    #[command(flatten)]
    pub(super) keys: NatsKeys,
}

/// Server of a queue that a command only reads.
#[derive(Clone, Debug, ClapArgs)]
#[command(next_help_heading = FARM)]
pub(super) struct ServerArgs {
    /// NATS server, to show the state of the queue: nats://host:4222 or tls://host:4222; commas separate several
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
    /// Scenes for the final scores.
    Test,
    /// Scenes that choose among checkpoints.
    Validation,
    /// Scenes for training.
    Train,
    /// Scenes of all splits.
    All,
}

impl SplitName {
    /// Returns the command-line name of the choice.
    #[cfg(feature = "train")]
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Test => "test",
            Self::Validation => "validation",
            Self::Train => "train",
            Self::All => "all",
        }
    }

    /// True if the choice includes scenes of `split`.
    pub(super) fn has(self, split: Split) -> bool {
        match self {
            Self::Test => split == Split::Test,
            Self::Validation => split == Split::Validation,
            Self::Train => split == Split::Train,
            Self::All => true,
        }
    }
}

pub(super) fn parse_spp(text: &str) -> Result<u32, String> {
    match text.parse::<u32>() {
        Ok(n) if n.is_power_of_two() && n <= 65_536 => Ok(n),
        _ => Err("samples per pixel must be a power of two from 1 to 65536".to_owned()),
    }
}

fn parse_gb(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(gb) if (0.0..=1e6).contains(&gb) => Ok(gb),
        _ => Err("write a number of gigabytes from 0 to 1000000".to_owned()),
    }
}

/// Converts an option in GB to bytes.
pub(super) fn bytes_of_gb(gb: f64) -> usize {
    (gb.max(0.0) * 1e9) as usize
}

pub(super) fn parse_duration(text: &str) -> Result<Duration, String> {
    let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let scale = match &text[digits.len()..] {
        "" | "s" => 1.0,
        "m" => 60.0,
        "h" => 3600.0,
        unit => {
            return Err(format!("unknown unit {unit:?}: write a time like 90, 55m or 2h"));
        }
    };
    let number: f64 = digits.parse().map_err(|_| "write a time like 90, 55m or 2h".to_owned())?;
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
