//! `bench train`

use super::args::Global;
use super::bench_args::BenchTrainArgs;
use super::bench_cmd::{cpu_name, on_cpu};
use super::exit_code::{Exit, Failure};
use super::output::Output;
use super::progress::Progress;
use super::train_args::use_threads;
use crate::bench::{TrainBench, TrainStep, align};
use serde_json::json;
use std::collections::BTreeMap;
use train::candle_core::Device;
use train::{FeatureSource, TrainSettings};

const SCHEMA: &str = "glasshouse.bench_train/1";

pub(super) fn run(
    args: &BenchTrainArgs,
    global: &Global,
    output: &Output,
) -> Result<Exit, Failure> {
    let settings = TrainSettings {
        features: if args.no_features {
            FeatureSource::None
        } else {
            FeatureSource::Random
        },
        width: args.width,
        batch: args.batch,
        ..TrainSettings::default()
    };
    let usage = |e: train::SettingError| Failure::new(Exit::Usage, e);
    settings.validate().map_err(usage)?;
    if global.dry_run {
        let text = format!("would take {} steps and one before them", args.steps);
        output.result(
            SCHEMA,
            json!({ "dry_run": true, "steps": args.steps }),
            &text,
        );
        return Ok(Exit::Done);
    }
    let threads = use_threads(global);
    let failed = |e: train::candle_core::Error| Failure::new(Exit::Failed, e);
    let progress = Progress::new(global, "steps", u64::from(args.steps) + 1);
    let mut bench = TrainBench::new(&settings, args.size as usize, &Device::Cpu).map_err(failed)?;
    let mut steps = Vec::new();
    // The first warms up.
    for step in 0..=args.steps {
        let measured = bench.step().map_err(failed)?;
        progress.add(1, false);
        if step > 0 {
            steps.push(measured);
        }
    }
    progress.finish();
    let (Some(best), Some(fastest)) = (
        least(&steps, |s| s.cpu_s).cloned(),
        least(&steps, |s| s.wall_s),
    ) else {
        let error = anyhow::anyhow!("no step was taken");
        return Err(Failure::new(Exit::Usage, error));
    };
    let wall = fastest.wall_s;
    let images_per_s = settings.batch as f64 / wall;
    let peak = peak_memory_bytes();
    let mut parts: BTreeMap<&str, f64> = BTreeMap::new();
    for (name, seconds) in &best.parts {
        *parts.entry(name).or_default() += seconds;
    }
    let mut order: Vec<(&str, f64)> = parts.into_iter().collect();
    order.sort_by(|a, b| b.1.total_cmp(&a.1));
    let mut rows = vec![["part", "CPU s", "share"].map(str::to_owned).to_vec()];
    rows.extend(order.iter().map(|(name, seconds)| {
        let share = 100.0 * seconds / best.cpu_s;
        vec![
            (*name).to_owned(),
            format!("{seconds:.3}"),
            format!("{share:.0} %"),
        ]
    }));
    let mut cpu: Vec<f64> = steps.iter().map(|s| s.cpu_s).collect();
    cpu.sort_by(f64::total_cmp);
    let median = cpu[cpu.len() / 2];
    let text = format!(
        "one step, {size} x {size} px, batch {batch}, width {width}, {threads} threads{cpu}: {cpu_s:.3} CPU s (best of {n}; median {median:.3}), \
         {wall:.3} s, {images_per_s:.2} images/s, {parameters} parameters, peak memory {peak}\n{table}",
        size = args.size,
        batch = settings.batch,
        width = settings.width,
        cpu = on_cpu(),
        cpu_s = best.cpu_s,
        n = steps.len(),
        parameters = bench.parameters(),
        peak = peak.map_or("?".to_owned(), |b| format!("{:.2} GB", b as f64 / 1e9)),
        table = align(&rows, 1),
    );
    output.result(
        SCHEMA,
        json!({
            "step_cpu_seconds": best.cpu_s, "step_cpu_seconds_median": median, "step_wall_seconds": wall,
            "images_per_second": images_per_s, "params": bench.parameters(), "peak_memory_bytes": peak,
            "parts_cpu_seconds": order.iter().map(|(n, s)| ((*n).to_owned(), json!(s))).collect::<serde_json::Map<_, _>>(),
            "steps": steps.len(), "size_px": args.size, "batch": settings.batch, "width": settings.width,
            "features": settings.features, "threads": threads, "cpu": cpu_name(),
        }),
        &text,
    );
    Ok(Exit::Done)
}

/// The step with the least of a measure.
fn least(steps: &[TrainStep], of: fn(&TrainStep) -> f64) -> Option<&TrainStep> {
    steps.iter().min_by(|a, b| of(a).total_cmp(&of(b)))
}

/// The most memory that this process had at once, if the system says.
fn peak_memory_bytes() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024)
}
