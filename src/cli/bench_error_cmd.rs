//! `bench error`

use super::args::Global;
use super::bench_args::BenchErrorArgs;
use super::bench_cmd::{cpu_name, isa_name, on_cpu, read_scene};
use super::exit_code::{Exit, Failure};
use super::output::Output;
use super::progress::Progress;
use super::signals::Signals;
use super::work_cmd::{isa, threads};
use crate::bench::{
    BenchScene, Ladder, LayerRow, Reference, Slope, VARIANTS, Work, align, climb, csv, error_plot,
    own_reference, pair, read_reference, slopes,
};
use anyhow::anyhow;
use render::atomic_file;
use render::line::Roots;
use render::trace::{LAYERS, TRACER_VERSION};
use serde_json::{Value, json};
use std::fmt::Write;

const SCHEMA: &str = "glasshouse.bench_error/1";

/// Photographs and film of the built-in scene, px.
const BUILTIN_SIZE: [u32; 2] = [1024, 768];
const BUILTIN_FILM_PX: u32 = 256;

/// Camera samples that progress counts as one.
const PROGRESS_UNIT: u64 = 1 << 20;

pub(super) fn run(
    args: &BenchErrorArgs,
    global: &Global,
    output: &Output,
) -> Result<Exit, Failure> {
    let mut ladder = Ladder {
        spp: args.spp.clone(),
        seeds: args.seeds,
    };
    ladder.spp.sort_unstable();
    ladder.spp.dedup();
    let roots = Roots::parse(&args.roots.roots)?;
    let scene = match &args.scene {
        Some(path) => read_scene(path, &roots)?,
        None => pair(BUILTIN_SIZE, BUILTIN_FILM_PX)?,
    };
    // What cannot be traced is found out before anything is rendered.
    scene.assemble(&scene.line, VARIANTS[0].sampling)?;
    let given = match &args.reference {
        Some(dir) => Some(read_reference(dir, &scene.line)?),
        None => None,
    };
    if global.dry_run {
        output.result(
            SCHEMA,
            json!({
                "dry_run": true, "scene": scene.name, "out": args.out, "spp": ladder.spp, "seeds": ladder.seeds,
                "reference": args.reference, "reference_spp": args.reference_spp,
            }),
            &format!(
                "would render scene {} with {} sample counts, {} kinds of sampling and {} seeds, and write error.csv, error.json \
                 and error.svg to {}",
                scene.name,
                ladder.spp.len(),
                VARIANTS.len(),
                ladder.seeds,
                args.out.display()
            ),
        );
        return Ok(Exit::Done);
    }

    let signals = Signals::catch();
    let stopped = || {
        Failure::new(
            signals.exit(),
            anyhow!("stopped by a signal: no table is written"),
        )
    };
    let isa = isa(global)?;
    let threads = threads(global);
    let with_progress = |samples: u64, work: &mut dyn FnMut(&Work) -> Result<(), Failure>| {
        let progress = Progress::new(global, "Msamples", samples.div_ceil(PROGRESS_UNIT));
        let counted = std::sync::atomic::AtomicU64::new(0);
        let on_samples = |count: u64| {
            let before = counted.fetch_add(count, std::sync::atomic::Ordering::Relaxed);
            let whole = (before + count) / PROGRESS_UNIT - before / PROGRESS_UNIT;
            if whole > 0 {
                progress.add(whole, false);
            }
        };
        let result = work(&Work {
            threads,
            isa,
            stop: signals.stop(),
            on_samples: &on_samples,
        });
        progress.finish();
        result
    };
    let film = &scene.line.film;
    let pixels = u64::from(film.width) * u64::from(film.height);
    let mut reference = given;
    if reference.is_none() {
        let dir = args.out.join("reference");
        with_progress(pixels * u64::from(args.reference_spp), &mut |work| {
            reference = own_reference(&scene, args.reference_spp, &dir, work)?;
            Ok(())
        })?;
    }
    let reference = reference.ok_or_else(stopped)?;
    if reference.record.is_some() && reference.reused {
        output.note(&format!(
            "the reference in {} fits and is used again",
            reference.dir.display()
        ));
    }
    let mut rows = None;
    with_progress(ladder.samples(pixels), &mut |work| {
        rows = climb(&scene, &ladder, &reference, work)?;
        Ok(())
    })?;
    let rows = rows.ok_or_else(stopped)?;
    let slopes = slopes(&rows, &reference);

    let mut object = json!({
        "scene": scene.name, "film": [film.width, film.height], "tracer_version": TRACER_VERSION, "isa": isa_name(isa),
        "threads": threads, "cpu": cpu_name(), "seeds": ladder.seeds, "spp": ladder.spp,
        "reference": reference_json(&reference), "slopes": slopes, "rows": rows,
    });
    let title = format!(
        "Scene {}: error against CPU time (reference: {})",
        scene.name,
        truth(&reference, "samples of another seed")
    );
    atomic_file::create_dir(&args.out)?;
    let mut file = json!({ "schema": SCHEMA });
    if let (Value::Object(file), Value::Object(object)) = (&mut file, &object) {
        file.extend(object.clone());
    }
    let svg = args.out.join("error.svg");
    atomic_file::write(&args.out.join("error.csv"), csv(&rows).as_bytes())?;
    atomic_file::write(&svg, error_plot(&rows, &title).as_bytes())?;
    atomic_file::write(
        &args.out.join("error.json"),
        format!("{file:#}\n").as_bytes(),
    )?;
    object["out"] = json!(args.out);
    let mut text = text(&scene, &reference, &rows, &slopes);
    let _ = write!(text, "look at {}", svg.display());
    output.result(SCHEMA, object, &text);
    Ok(Exit::Done)
}

fn reference_json(reference: &Reference) -> Value {
    match &reference.record {
        Some(record) => {
            let errors: serde_json::Map<String, Value> = LAYERS
                .iter()
                .zip(record.error_rms)
                .map(|(name, error)| ((*name).to_owned(), json!(error)))
                .collect();
            json!({
                "dir": reference.dir, "spp": record.spp, "seed": record.seed, "stated_rmse": errors, "cpu_s": record.cpu_s,
                "reused": reference.reused,
            })
        }
        None => json!({ "dir": reference.dir }),
    }
}

/// What the error is against, in words.
fn truth(reference: &Reference, what: &str) -> String {
    reference.record.as_ref().map_or_else(
        || format!("the images in {}", reference.dir.display()),
        |record| format!("{} {what}", record.spp),
    )
}

/// The tables: one for each kind of sampling and layer.
fn text(scene: &BenchScene, reference: &Reference, rows: &[LayerRow], slopes: &[Slope]) -> String {
    let film = &scene.line.film;
    let mut text = format!(
        "{}, {} x {} px{}, against {}",
        scene.name,
        film.width,
        film.height,
        on_cpu(),
        truth(reference, "samples of another seed")
    );
    if let Some(record) = &reference.record {
        let stated: Vec<String> = LAYERS
            .iter()
            .zip(record.error_rms)
            .map(|(name, error)| format!("{name} {}", optional(error, |e| format!("{e:.1e}"))))
            .collect();
        let _ = write!(text, " (its own stated error: {})", stated.join(", "));
    }
    text += "\n";
    for slope in slopes {
        let tail = slope.tail_slope.map_or_else(String::new, |s| {
            format!(", samples^{s:.2} from 16 samples on")
        });
        let fitted = slope.slope.map_or_else(
            || "too few rungs for a slope".to_owned(),
            |s| format!("RMSE ~ samples^{s:.2} over {} rungs{tail}", slope.rungs),
        );
        let _ = writeln!(text, "\n{}, {}: {fitted}\n", slope.layer, slope.variant);
        let head = [
            "samples",
            "CPU s",
            "RMSE",
            "relative MSE",
            "bias",
            "sRGB steps",
            "worst 8x8",
            "p99 8x8",
            "stated/true",
        ];
        let mut table = vec![head.map(str::to_owned).to_vec()];
        let of_slope = |row: &&LayerRow| row.variant == slope.variant && row.layer == slope.layer;
        for row in rows.iter().filter(of_slope) {
            let d = &row.deviation;
            table.push(vec![
                format!("{}", (row.samples * 10.0).round() / 10.0),
                format!("{:.3}", row.cpu_s),
                format!("{:.2e}", d.rmse),
                format!("{:.2e}", d.relative_mse),
                format!("{:+.1e}", d.bias),
                format!("{:.3}", d.srgb_steps),
                format!("{:.2e}", d.cell_rmse_worst),
                format!("{:.2e}", d.cell_rmse_p99),
                optional(row.stated_over_true, |ratio| format!("{ratio:.2}")),
            ]);
        }
        text += &align(&table, 0);
    }
    text += "\n";
    text += &summary(rows, slopes);
    text += "\n";
    text
}

/// One row for each layer: how each kind of sampling falls, and where it ends.
fn summary(rows: &[LayerRow], slopes: &[Slope]) -> String {
    let top = rows.iter().map(|row| row.spp).max().unwrap_or(0);
    let mut head = vec!["layer".to_owned()];
    for variant in VARIANTS {
        head.push(format!("{} slope", variant.name));
        head.push("from 16".to_owned());
        head.push(format!("RMSE at {top} spp"));
        head.push("CPU s".to_owned());
    }
    let mut table = vec![head];
    for layer in LAYERS {
        let mut cells = vec![layer.to_owned()];
        for variant in VARIANTS {
            let slope = slopes
                .iter()
                .find(|s| s.variant == variant.name && s.layer == layer);
            for fitted in [
                slope.and_then(|s| s.slope),
                slope.and_then(|s| s.tail_slope),
            ] {
                cells.push(optional(fitted, |s| format!("{s:.2}")));
            }
            let last = rows
                .iter()
                .find(|r| r.variant == variant.name && r.layer == layer && r.spp == top);
            cells.push(optional(last.map(|r| r.deviation.rmse), |e| {
                format!("{e:.2e}")
            }));
            cells.push(optional(last.map(|r| r.cpu_s), |s| format!("{s:.2}")));
        }
        table.push(cells);
    }
    align(&table, 1)
}

fn optional(value: Option<f64>, print: impl Fn(f64) -> String) -> String {
    value.map_or_else(|| "-".to_owned(), print)
}
