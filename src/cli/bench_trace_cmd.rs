//! `bench trace`

use super::args::{Global, IsaChoice};
use super::bench_args::BenchTraceArgs;
use super::bench_cmd::{cpu_name, isa_name, on_cpu, read_scene};
use super::exit_code::{Exit, Failure};
use super::output::Output;
use super::progress::Progress;
use super::work_cmd::isa;
use crate::bench::{
    BenchScene, BuildRow, KernelRow, RayDump, TracerRow, align, grid_builds, indoor, kernels,
    outdoor, stress, tracer,
};
use render::line::Roots;
use render::trace::{Isa, TRACER_VERSION};
use serde_json::json;
use std::fmt::Write;

const SCHEMA: &str = "glasshouse.bench_trace/1";

/// Photographs and film of the built-in scenes, px.
const BUILTIN_SIZE: [u32; 2] = [1024, 768];
const BUILTIN_FILM_PX: u32 = 256;

/// Steps of progress that a scene takes.
const STEPS: u64 = 3;

pub(super) fn run(
    args: &BenchTraceArgs,
    global: &Global,
    output: &Output,
) -> Result<Exit, Failure> {
    let roots = Roots::parse(&args.roots.roots)?;
    let isas = match (global.isa, isa(global)?) {
        (IsaChoice::Auto, Isa::Avx2) => vec![Isa::Avx2, Isa::Baseline],
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
        output.result(
            SCHEMA,
            json!({ "dry_run": true, "scenes": names, "dump": args.dump }),
            &format!("would measure {}", names.join(", ")),
        );
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
    let measured = measure(
        &scenes,
        &isas,
        usize::from(args.passes),
        dump.as_mut(),
        &progress,
    );
    progress.finish();
    let (kernels, tracers, builds) = measured?;
    let dumped = dump.map(RayDump::finish).transpose()?;

    let mut text = format!(
        "one core{}, {} passes\n\nIntersection alone, millions of rays a second: median (best)\n\n",
        on_cpu(),
        args.passes
    );
    text += &align(&kernel_table(&kernels, &isas), 2);
    text += "\nWhole tracer, millions of camera samples a second (best), and of rays a second\n\n";
    text += &align(&tracer_table(&tracers, &isas), 2);
    text += "\nGrid and pyramid, milliseconds\n\n";
    text += &align(&build_table(&builds), 2);
    if let Some(path) = &dumped {
        let _ = writeln!(text, "\nrays in {}", path.display());
    }
    let names: Vec<&str> = isas.iter().map(|isa| isa_name(*isa)).collect();
    output.result(
        SCHEMA,
        json!({
            "cpu": cpu_name(), "tracer_version": TRACER_VERSION, "passes": args.passes, "isas": names,
            "kernels": kernels, "tracer": tracers, "grids": builds, "dump": dumped,
        }),
        text.trim_end(),
    );
    Ok(Exit::Done)
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
        measured.0.extend(kernels(
            scene,
            isas,
            passes,
            &mut |name, probe, hits, mrays_per_s| match &mut dump {
                Some(dump) => dump.add(name, probe, hits, mrays_per_s),
                None => Ok(()),
            },
        )?);
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

fn kernel_table(rows: &[KernelRow], isas: &[Isa]) -> Vec<Vec<String>> {
    let mut head = words(&["scene", "kernel", "cells a ray", "rounds of 16 rays"]);
    head.extend(isas.iter().map(|isa| isa_name(*isa).to_owned()));
    let mut table = vec![head];
    for row in rows {
        let kernel = row.apex.map_or_else(
            || row.kernel.to_owned(),
            |apex| format!("{} {apex}", row.kernel),
        );
        let mut cells = vec![
            row.scene.clone(),
            kernel,
            format!("{:.2}", row.cells_per_ray),
            format!("{:.2}", row.rounds_per_16_rays),
        ];
        cells.extend(
            row.timings
                .iter()
                .map(|t| format!("{:.0} ({:.0})", t.mrays_per_s, t.best_mrays_per_s)),
        );
        table.push(cells);
    }
    table
}

fn tracer_table(rows: &[TracerRow], isas: &[Isa]) -> Vec<Vec<String>> {
    let mut head = words(&["scene", "apex", "rays a sample"]);
    for isa in isas {
        head.push(format!("{} samples", isa_name(*isa)));
        head.push(format!("{} rays", isa_name(*isa)));
    }
    let mut table = vec![head];
    for row in rows {
        let mut cells = words(&[&row.scene, row.apex]);
        cells.push(format!("{:.2}", row.rays as f64 / row.samples as f64));
        for t in &row.timings {
            cells.push(format!(
                "{:.1} ({:.1})",
                t.msamples_per_s, t.best_msamples_per_s
            ));
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
