//! What can be typed with every command.

use super::exit_code::{Exit, Failure};
use crate::trace::Isa;
use clap::{Args as ClapArgs, ValueEnum};

/// Options of every command.
#[derive(Clone, Debug, ClapArgs)]
#[command(next_help_heading = "Options of every command")]
pub struct Global {
    /// Print one JSON object with a `schema` field to stdout, and nothing else there
    #[arg(long, global = true)]
    pub json: bool,
    /// Threads that compute; one more reads files and one writes them, mostly waiting [default: one for each core]
    #[arg(short = 'j', long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// No progress and no notes
    #[arg(short, long, global = true)]
    pub quiet: bool,
    /// Say more: rejected partials, where the seconds went
    #[arg(short, long, global = true)]
    pub verbose: bool,
    /// Say what would be done, write nothing
    #[arg(short = 'n', long, global = true)]
    pub dry_run: bool,
    /// Colour of messages
    #[arg(
        long,
        global = true,
        value_enum,
        default_value = "auto",
        value_name = "WHEN"
    )]
    pub color: ColorWhen,
    /// Progress: bars on a terminal, plain lines elsewhere
    #[arg(
        long,
        global = true,
        value_enum,
        default_value = "auto",
        value_name = "HOW"
    )]
    pub progress: ProgressHow,
    /// Instruction set of the tracer's kernels; all give the same bits
    #[arg(long, global = true, value_enum, default_value = "auto", hide = true)]
    pub isa: IsaChoice,
}

/// `--color`
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ColorWhen {
    /// On a terminal, unless NO_COLOR is set.
    Auto,
    /// Always.
    Always,
    /// Never.
    Never,
}

/// `--progress`
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ProgressHow {
    /// Bars on a terminal, else plain lines.
    Auto,
    /// Bars.
    Bar,
    /// A line now and then.
    Plain,
    /// None.
    None,
}

/// `--isa`
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum IsaChoice {
    /// The fastest at hand.
    Auto,
    /// What every machine has.
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
        IsaChoice::Avx2 => Err(Failure::new(
            Exit::Usage,
            anyhow::anyhow!("this machine has no AVX2; use --isa auto"),
        )),
    }
}
