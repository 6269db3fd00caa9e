//! `bench`: what the benchmarks share.

use super::args::Global;
use super::bench_args::{BenchArgs, BenchCommand};
use super::exit_code::{Exit, Failure};
use super::output::Output;
use super::{bench_error_cmd, bench_farm_cmd, bench_trace_cmd};
use crate::bench::{BenchError, BenchScene};
use anyhow::Context;
use render::line::{Roots, parse_scene};
use render::scene::{decode, read_files};
use render::trace::Isa;
use std::path::Path;

pub(super) fn run(args: &BenchArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    match &args.what {
        BenchCommand::Error(args) => bench_error_cmd::run(args, global, output),
        BenchCommand::Farm(args) => bench_farm_cmd::run(args, global, output),
        BenchCommand::Trace(args) => bench_trace_cmd::run(args, global, output),
        #[cfg(feature = "train")]
        BenchCommand::Train(args) => super::bench_train_cmd::run(args, global, output),
    }
}

/// A scene file with its photographs.
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
    Ok(BenchScene {
        name: line.id.to_string(),
        line,
        photographs,
    })
}

/// What an instruction set is called.
pub(super) fn isa_name(isa: Isa) -> &'static str {
    match isa {
        Isa::Avx2 => "avx2",
        Isa::Baseline => "baseline",
    }
}

/// The machine's processor, if it says: figures are worth little without it.
pub(super) fn cpu_name() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find(|line| line.starts_with("model name"))?;
    Some(line.split_once(':')?.1.trim().to_owned())
}

/// "on CPU", or nothing.
pub(super) fn on_cpu() -> String {
    cpu_name().map_or_else(String::new, |name| format!(" on {name}"))
}

impl From<BenchError> for Failure {
    fn from(error: BenchError) -> Self {
        use BenchError as E;
        let exit = match error {
            E::Sample(_) | E::Write(_) | E::Encode { .. } => Exit::Failed,
            E::Load(_)
            | E::Assemble(_)
            | E::Merge(_)
            | E::NoReference { .. }
            | E::Read { .. }
            | E::Image(_)
            | E::Size { .. } => Exit::InvalidInput,
        };
        Self::new(exit, error)
    }
}
