//! `bench compose`: measures the composition of training examples.

use crate::bench::{CameraTimes, CompositionBench, CompositionRow, cpu_name, on_cpu};
use crate::cli::args::Global;
use crate::cli::exit_code::Exit;
use crate::cli::output::Output;
use clap::Args as ClapArgs;
use compose::{Composition, markdown_table};
use serde::Serialize;
use std::fmt;

#[derive(Debug, ClapArgs)]
pub(super) struct BenchComposeArgs {
    /// Side of the examples, px
    #[arg(long, value_name = "PX", default_value_t = 256, value_parser = clap::value_parser!(u32).range(32..=4096))]
    size: u32,
    /// Examples per row, after a warm-up of two
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    examples: u64,
}

const SCHEMA: &str = "glasshouse.bench_compose/1";

/// Threads without `-j`.
const THREADS: usize = 2;

pub(super) fn run(args: &BenchComposeArgs, global: &Global, output: &Output) -> Exit {
    if global.dry_run {
        output.show(SCHEMA, &Planned { dry_run: true, examples: args.examples });
        return Exit::Done;
    }
    let threads = global.threads.map_or(THREADS, usize::from);
    let bench = CompositionBench::new(args.size as usize, &Composition::default());
    let rows = bench.rows(args.examples);
    let camera = bench.camera(args.examples);
    let [examples_per_second, cpu_seconds] =
        bench.on_threads(args.examples * threads as u64, threads);
    let report = Report {
        rows,
        camera,
        examples_per_second,
        cpu_seconds,
        threads,
        examples: args.examples,
        size_px: args.size,
        cpu: cpu_name(),
    };
    output.show(SCHEMA, &report);
    Exit::Done
}

#[derive(Serialize)]
struct Planned {
    dry_run: bool,
    examples: u64,
}

impl fmt::Display for Planned {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "would compose {} examples per row", self.examples)
    }
}

#[derive(Serialize)]
struct Report {
    rows: Vec<CompositionRow>,
    camera: CameraTimes,
    /// Wall time of all threads together, with the settings' share of JPEG.
    examples_per_second: f64,
    /// CPU time of one of these examples.
    cpu_seconds: f64,
    threads: usize,
    examples: u64,
    size_px: u32,
    cpu: Option<String>,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut rows =
            vec![["up to", "CPU ms", "examples/s of a core"].map(str::to_owned).to_vec()];
        rows.extend(self.rows.iter().map(|row| {
            let [ms, rate] = [1e3 * row.cpu_seconds, row.examples_per_core_second];
            vec![row.up_to.to_owned(), format!("{ms:.2}"), format!("{rate:.0}")]
        }));
        write!(
            f,
            "{size} x {size} px{cpu}, median of {n} examples; {threads} threads compose {rate:.0} examples/s with the default settings ({ms:.2} CPU ms each)\n{table}",
            size = self.size_px,
            cpu = on_cpu(),
            n = self.examples,
            threads = self.threads,
            rate = self.examples_per_second,
            ms = 1e3 * self.cpu_seconds,
            table = markdown_table(&rows, 1),
        )?;
        let mut rows =
            vec![["camera, by stage", "CPU us per megapixel"].map(str::to_owned).to_vec()];
        let stages = self.camera.stages.iter();
        rows.extend(stages.map(|s| vec![s.stage.to_owned(), format!("{:.0}", s.us_per_megapixel)]));
        write!(
            f,
            "\nI with noise, T and R~ without, before JPEG: {:.2} CPU ms\n{}",
            1e3 * self.camera.three_layers_cpu_seconds,
            markdown_table(&rows, 1),
        )
    }
}
