//! `plan RECIPE --out RUN`

use super::args::{Global, PlanArgs};
use super::exit_code::{Exit, Failure};
use super::output::Output;
use super::progress::Progress;
use super::store_env;
use super::work_cmd::threads;
use crate::farm::{PlanOptions, Planned, plan};
use crate::manifest::Roots;
use crate::shard::{SECONDS_PER_SAMPLE, ShardLayout};
use serde_json::json;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Mutex;

/// Bytes of a partial a pixel: 36 floats.
const PARTIAL_BYTES: f64 = 144.0;
/// Bytes of a tuple a pixel, about: compressed half floats and four PNGs.
const TUPLE_BYTES: f64 = 26.0;
/// Seconds of one core a scene besides, about: reading, decoding, writing.
const SECONDS_PER_SCENE: f64 = 0.1;

/// The run's folder: as given, or `runs/NAME` by the recipe's file name.
pub(super) fn run_folder(args: &PlanArgs) -> PathBuf {
    args.out.clone().unwrap_or_else(|| {
        PathBuf::from("runs").join(args.recipe.file_stem().unwrap_or(args.recipe.as_os_str()))
    })
}

/// Plans with progress and notes.
pub(super) fn plan_with(
    args: &PlanArgs,
    global: &Global,
    output: &Output,
) -> Result<Planned, Failure> {
    let roots = Roots::parse(&args.roots.roots)?;
    let inputs = store_env::inputs();
    let options = PlanOptions {
        roots: &roots,
        inputs: &inputs,
        tile_px: args.tile,
        dry_run: global.dry_run,
        threads: threads(global),
    };
    let bars: Mutex<BTreeMap<&'static str, Progress>> = Mutex::default();
    let planned = plan(
        &args.recipe,
        &run_folder(args),
        &options,
        &|what, done, all| {
            let mut bars = bars.lock().expect("no holder of this lock panics");
            let bar = bars
                .entry(what)
                .or_insert_with(|| Progress::new(global, what, all as u64));
            if done > 0 {
                bar.add(1, false);
            }
            if done == all {
                bar.finish();
            }
        },
    );
    let planned = planned?;
    for note in &planned.notes {
        output.note(note);
    }
    Ok(planned)
}

pub(super) fn run(args: &PlanArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let planned = plan_with(args, global, output)?;
    let folder = run_folder(args);
    let (mut shards, mut pixels, mut samples) = (0u64, 0.0, 0.0);
    for line in &planned.lines {
        shards += u64::from(ShardLayout::of(line, planned.spec.tile_px).len());
        let size = f64::from(line.film.width) * f64::from(line.film.height);
        pixels += size;
        samples += size * f64::from(line.film.spp);
    }
    let scenes = planned.lines.len();
    let core_s = samples * SECONDS_PER_SAMPLE + scenes as f64 * SECONDS_PER_SCENE;
    let (partials, tuples) = (pixels * PARTIAL_BYTES, pixels * TUPLE_BYTES);
    let verb = match (global.dry_run, planned.existed) {
        (true, _) => "would plan",
        (false, true) => "is planned already:",
        (false, false) => "planned",
    };
    output.result(
        "glasshouse.plan/1",
        json!({
            "run": folder,
            "dry_run": global.dry_run,
            "existed": planned.existed,
            "scenes": scenes,
            "shards": shards,
            "tile_px": planned.spec.tile_px,
            "partial_bytes": partials as u64,
            "tuple_bytes": tuples as u64,
            "core_seconds_estimate": core_s,
            "manifest_blake3": planned.spec.manifest_blake3,
            "rejected": planned.rejected.len(),
            "notes": planned.notes,
        }),
        &format!(
            "{} {verb} {scenes} scenes in {shards} shards (tile {} px); about {:.1} MB of tuples, up to {:.1} MB of \
             partials on the way, and {} of one core",
            folder.display(),
            planned.spec.tile_px,
            tuples / 1e6,
            partials / 1e6,
            span_text(core_s),
        ),
    );
    Ok(Exit::Done)
}

fn span_text(seconds: f64) -> String {
    match seconds {
        s if s < 120.0 => format!("{s:.0} s"),
        s if s < 7200.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}
