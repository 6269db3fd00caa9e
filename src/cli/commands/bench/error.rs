//! `bench error`: measures the error of renderings against a reference.

use crate::bench::{
    BenchError, ERROR_SCHEMA, ErrorReport, Ladder, VARIANTS, Work, climb, cpu_name, own_reference,
    pair, read_reference, reference_files, slopes,
};
use crate::cli::args::{Global, RootArgs, isa, parse_spp, threads};
use crate::cli::commands::bench::read_scene;
use crate::cli::exit_code::{Exit, Failure, failure};
use crate::cli::output::Output;
use crate::cli::progress::Progress;
use crate::cli::signals::Signals;
use crate::outputs::Outputs;
use clap::Args as ClapArgs;
use glasshouse_line::Roots;
use render::trace::{Isa, TRACER_VERSION};
use serde::Serialize;
use std::borrow::Cow;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

#[derive(Debug, ClapArgs)]
pub(super) struct BenchErrorArgs {
    /// Scene (glasshouse.scene/1) [default: a built-in pair, 256 x 256 px]
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// Folder of four reference images, as `render` writes them or named ref_LAYER.npy [default: rendered]
    #[arg(long, value_name = "DIR")]
    reference: Option<PathBuf>,
    /// Folder for error.csv, error.json, error.svg and the rendered reference
    #[arg(long, value_name = "DIR", default_value = "runs/bench-error")]
    out: PathBuf,
    /// Numbers of samples per pixel to measure, powers of two
    #[arg(long, value_name = "N,...", value_delimiter = ',', value_parser = parse_spp,
          default_value = "1,2,4,8,16,32,64,128,256,512,1024")]
    spp: Vec<u32>,
    /// Samples per pixel of the rendered reference, a power of two
    #[arg(long, value_name = "N", value_parser = parse_spp, default_value = "16384", conflicts_with = "reference")]
    reference_spp: u32,
    /// Number of seeds to average over
    #[arg(long, value_name = "K", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1024))]
    seeds: u32,
    #[command(flatten)]
    roots: RootArgs,
}

/// Width and height of the built-in scene's photographs, px; below, the side of its square film.
const BUILTIN_SIZE: [u32; 2] = [1024, 768];
const BUILTIN_FILM_PX: u32 = 256;

/// Camera samples per unit of progress.
const PROGRESS_UNIT: u64 = 1 << 20;

pub(super) fn run(
    args: &BenchErrorArgs,
    global: &Global,
    output: &Output,
) -> Result<Exit, Failure> {
    let mut ladder = Ladder { spp: args.spp.clone(), seeds: args.seeds };
    ladder.spp.sort_unstable();
    ladder.spp.dedup();
    let roots = Roots::parse(&args.roots.roots)?;
    let scene = match &args.scene {
        Some(path) => read_scene(path, &roots)?,
        None => pair(BUILTIN_SIZE, BUILTIN_FILM_PX)?,
    };
    // An invalid scene fails before anything is rendered.
    scene.assemble(&scene.line, VARIANTS[0].sampling)?;
    let given = match &args.reference {
        Some(dir) => Some(read_reference(dir, &scene.line)?),
        None => None,
    };
    let outputs = outputs(args);
    outputs.check()?;
    if global.dry_run {
        let planned = Planned {
            dry_run: true,
            scene: &scene.name,
            out: args.out.to_string_lossy(),
            spp: &ladder.spp,
            seeds: ladder.seeds,
            reference: args.reference.as_ref().map(|dir| dir.to_string_lossy()),
            reference_spp: args.reference_spp,
        };
        output.show(ERROR_SCHEMA, &planned);
        return Ok(Exit::Done);
    }

    outputs.claim()?;
    let signals = Signals::catch();
    let stopped = || failure!(signals.exit(), "stopped by a signal: no table was written");
    let isa = isa(global)?;
    let threads = threads(global);
    let bench = Bench { global, threads, isa, signals: &signals };
    let film = &scene.line.film;
    let pixels = u64::from(film.width) * u64::from(film.height);
    let mut reference = given;
    if reference.is_none() {
        let dir = args.out.join("reference");
        let samples = pixels * u64::from(args.reference_spp);
        reference = bench
            .with_progress(samples, |work| own_reference(&scene, args.reference_spp, &dir, work))?;
    }
    let reference = reference.ok_or_else(stopped)?;
    if reference.record.is_some() && reference.reused {
        output.note(&format!("reusing the reference in {}", reference.dir.display()));
    }
    let rows = bench
        .with_progress(ladder.samples(pixels), |work| climb(&scene, &ladder, &reference, work))?;
    let rows = rows.ok_or_else(stopped)?;
    let mut report = ErrorReport {
        scene: &scene.name,
        film: [film.width, film.height],
        tracer_version: TRACER_VERSION,
        isa: isa.name(),
        threads,
        cpu: cpu_name(),
        seeds: ladder.seeds,
        spp: &ladder.spp,
        reference: &reference,
        slopes: slopes(&rows, &reference),
        rows,
        out: None,
    };
    report.write(&args.out)?;
    output.show(ERROR_SCHEMA, &report);
    Ok(Exit::Done)
}

/// Returns the files to write, and the files that the command reads.
fn outputs(args: &BenchErrorArgs) -> Outputs<'_> {
    let mut files = ErrorReport::FILES.map(PathBuf::from).to_vec();
    if args.reference.is_none() {
        files.extend(reference_files().map(|name| Path::new("reference").join(name)));
    }
    let inputs = args.scene.iter().cloned().collect();
    Outputs { command: "bench error", folder: &args.out, files, inputs }
}

/// Settings of a rendering with progress.
struct Bench<'a> {
    global: &'a Global,
    threads: usize,
    isa: Isa,
    signals: &'a Signals,
}

impl Bench<'_> {
    fn with_progress<T>(
        &self,
        samples: u64,
        work: impl FnOnce(&Work) -> Result<T, BenchError>,
    ) -> Result<T, BenchError> {
        let progress = Progress::new(self.global, "Msamples", samples.div_ceil(PROGRESS_UNIT));
        let counted = AtomicU64::new(0);
        let on_samples = |count: u64| {
            let before = counted.fetch_add(count, Ordering::Relaxed);
            let whole = (before + count) / PROGRESS_UNIT - before / PROGRESS_UNIT;
            if whole > 0 {
                progress.add(whole, false);
            }
        };
        let result = work(&Work {
            threads: self.threads,
            isa: self.isa,
            stop: self.signals.stop(),
            on_samples: &on_samples,
        });
        progress.finish();
        result
    }
}

#[derive(Serialize)]
struct Planned<'a> {
    dry_run: bool,
    scene: &'a str,
    out: Cow<'a, str>,
    spp: &'a [u32],
    seeds: u32,
    reference: Option<Cow<'a, str>>,
    reference_spp: u32,
}

impl fmt::Display for Planned<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { scene, out, spp, seeds, .. } = self;
        write!(
            f,
            "would render scene {scene} with {} sample counts, {} sampling methods and {seeds} seeds, and write error.csv, \
             error.json and error.svg to {out}",
            spp.len(),
            VARIANTS.len(),
        )
    }
}
