//! `bench trace`: measures the speed of the tracer on one core.

use crate::bench::{
    BenchScene, BuildRow, KernelRow, RayDump, TracerRow, cpu_name, grid_builds, indoor, kernels,
    on_cpu, outdoor, stress, tracer,
};
use crate::cli::args::{Global, IsaChoice, RootArgs, isa};
use crate::cli::commands::bench::read_scene;
use crate::cli::exit_code::{Exit, Failure};
use crate::cli::output::Output;
use crate::cli::progress::Progress;
use clap::Args as ClapArgs;
use compose::markdown_table;
use glasshouse_line::Roots;
use render::trace::{Isa, TRACER_VERSION};
use serde::Serialize;
use std::borrow::Cow;
use std::fmt;
use std::path::PathBuf;

#[derive(Debug, ClapArgs)]
pub(super) struct BenchTraceArgs {
    /// Scene (glasshouse.scene/1), measured after the built-in ones; repeatable
    #[arg(long, value_name = "FILE")]
    scene: Vec<PathBuf>,
    /// Leave out the built-in scenes
    #[arg(long, requires = "scene")]
    no_builtin: bool,
    /// Number of passes; results are their median and their best
    #[arg(long, value_name = "N", default_value_t = 7, value_parser = clap::value_parser!(u16).range(1..=1000))]
    passes: u16,
    /// Folder to dump rays, hits and vertices to, for another ray tracer (rays.json describes them)
    #[arg(long, value_name = "DIR")]
    dump: Option<PathBuf>,
    #[command(flatten)]
    roots: RootArgs,
}

const SCHEMA: &str = "glasshouse.bench_trace/1";

/// Width and height of the built-in scenes' photographs, px; below, the side of their square films.
const BUILTIN_SIZE: [u32; 2] = [1024, 768];
const BUILTIN_FILM_PX: u32 = 256;

/// Number of progress steps per scene.
const STEPS: u64 = 3;

pub(super) fn run(
    args: &BenchTraceArgs,
    global: &Global,
    output: &Output,
) -> Result<Exit, Failure> {
    let roots = Roots::parse(&args.roots.roots)?;
    let isas = match (global.isa, isa(global)?) {
        (IsaChoice::Auto, _) => {
            Isa::ALL.into_iter().rev().filter(|isa| isa.is_available()).collect()
        }
        (_, isa) => vec![isa],
    };
    let mut scenes = Vec::new();
    for path in &args.scene {
        scenes.push(read_scene(path, &roots)?);
    }
    if global.dry_run {
        let mut names: Vec<&str> = scenes.iter().map(|scene| scene.name.as_str()).collect();
        if !args.no_builtin {
            names.splice(0..0, ["indoor", "outdoor", "stress"]);
        }
        let dump = args.dump.as_ref().map(|dir| dir.to_string_lossy());
        output.show(SCHEMA, &Planned { dry_run: true, scenes: names, dump });
        return Ok(Exit::Done);
    }
    if !args.no_builtin {
        let builtin = [
            indoor(BUILTIN_SIZE, BUILTIN_FILM_PX)?,
            outdoor(BUILTIN_SIZE, BUILTIN_FILM_PX)?,
            stress(BUILTIN_FILM_PX),
        ];
        scenes.splice(0..0, builtin);
    }
    let mut dump = args.dump.as_deref().map(RayDump::new).transpose()?;
    let progress = Progress::new(global, "measurements", scenes.len() as u64 * STEPS);
    let measured = measure(&scenes, &isas, usize::from(args.passes), dump.as_mut(), &progress);
    progress.finish();
    let (kernels, tracers, builds) = measured?;
    let dumped = dump.map(RayDump::finish).transpose()?;

    let report = Report {
        cpu: cpu_name(),
        tracer_version: TRACER_VERSION,
        passes: args.passes,
        isas: isas.iter().map(|isa| isa.name()).collect(),
        kernels,
        tracer: tracers,
        grids: builds,
        dump: dumped,
    };
    output.show(SCHEMA, &report);
    Ok(Exit::Done)
}

#[derive(Serialize)]
struct Planned<'a> {
    dry_run: bool,
    scenes: Vec<&'a str>,
    dump: Option<Cow<'a, str>>,
}

impl fmt::Display for Planned<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "would measure {}", self.scenes.join(", "))
    }
}

#[derive(Serialize)]
struct Report {
    cpu: Option<String>,
    tracer_version: u32,
    passes: u16,
    isas: Vec<&'static str>,
    kernels: Vec<KernelRow>,
    tracer: Vec<TracerRow>,
    grids: Vec<BuildRow>,
    #[serde(serialize_with = "render::path_text::optional")]
    dump: Option<PathBuf>,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "one core{}, {} passes\n\nIntersection alone, millions of rays per second: median (best)\n\n{}\n\
             Whole tracer, millions per second: camera samples, median (best), and rays, median\n\n{}\n\
             Grid and pyramid, milliseconds\n\n{}",
            on_cpu(),
            self.passes,
            markdown_table(&kernel_table(&self.kernels, &self.isas), 2),
            markdown_table(&tracer_table(&self.tracer, &self.isas), 2),
            markdown_table(&build_table(&self.grids), 2).trim_end(),
        )?;
        match &self.dump {
            Some(path) => write!(f, "\n\nrays in {}", path.display()),
            None => Ok(()),
        }
    }
}

type Measured = (Vec<KernelRow>, Vec<TracerRow>, Vec<BuildRow>);

fn measure(
    scenes: &[BenchScene],
    isas: &[Isa],
    passes: usize,
    mut dump: Option<&mut RayDump>,
    progress: &Progress,
) -> Result<Measured, Failure> {
    let mut measured = Measured::default();
    for scene in scenes {
        progress.message(scene.name.clone());
        measured.0.extend(kernels(scene, isas, passes, &mut |name, probe, hits, mrays_per_s| {
            match &mut dump {
                Some(dump) => dump.add(name, probe, hits, mrays_per_s),
                None => Ok(()),
            }
        })?);
        progress.add(1, false);
        measured.1.extend(tracer(scene, isas, passes)?);
        progress.add(1, false);
        measured.2.extend(grid_builds(scene, passes));
        progress.add(1, false);
    }
    Ok(measured)
}

fn words(cells: &[&str]) -> Vec<String> {
    cells.iter().map(|cell| (*cell).to_owned()).collect()
}

fn kernel_table(rows: &[KernelRow], isas: &[&str]) -> Vec<Vec<String>> {
    let mut head = words(&["scene", "kernel", "cells a ray", "rounds of 16 rays"]);
    head.extend(isas.iter().map(|isa| (*isa).to_owned()));
    let mut table = vec![head];
    for row in rows {
        let kernel =
            row.apex.map_or_else(|| row.kernel.to_owned(), |apex| format!("{} {apex}", row.kernel));
        let mut cells = vec![
            row.scene.clone(),
            kernel,
            format!("{:.2}", row.cells_per_ray),
            format!("{:.2}", row.rounds_per_16_rays),
        ];
        cells.extend(
            row.timings.iter().map(|t| format!("{:.0} ({:.0})", t.mrays_per_s, t.best_mrays_per_s)),
        );
        table.push(cells);
    }
    table
}

fn tracer_table(rows: &[TracerRow], isas: &[&str]) -> Vec<Vec<String>> {
    let mut head = words(&["scene", "apex", "rays a sample"]);
    for isa in isas {
        head.push(format!("{isa} samples"));
        head.push(format!("{isa} rays"));
    }
    let mut table = vec![head];
    for row in rows {
        let mut cells = words(&[&row.scene, row.apex]);
        cells.push(format!("{:.2}", row.rays as f64 / row.samples as f64));
        for t in &row.timings {
            cells.push(format!("{:.1} ({:.1})", t.msamples_per_s, t.best_msamples_per_s));
            cells.push(format!("{:.0}", t.mrays_per_s));
        }
        table.push(cells);
    }
    table
}

fn build_table(rows: &[BuildRow]) -> Vec<Vec<String>> {
    let mut table = vec![words(&["scene", "side", "vertices", "median", "best"])];
    for row in rows {
        table.push(vec![
            row.scene.clone(),
            row.side.to_owned(),
            format!("{} x {}", row.nx, row.ny),
            format!("{:.2}", row.build_ms),
            format!("{:.2}", row.best_build_ms),
        ]);
    }
    table
}
