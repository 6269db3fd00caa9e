//! `bench train`: measures a training step.

use crate::bench::{TrainBench, TrainStep, cpu_name, on_cpu};
use crate::cli::args::Global;
use crate::cli::commands::train::NetworkName;
use crate::cli::exit_code::{Exit, Failure, failure};
use crate::cli::network::use_threads;
use crate::cli::output::{Output, as_map};
use crate::cli::progress::Progress;
use clap::Args as ClapArgs;
use compose::markdown_table;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;
use train::{FeatureSource, NetworkKind, OptimizerKind, Start, TrainSettings};

#[cfg(feature = "train")]
#[derive(Debug, ClapArgs)]
pub(super) struct BenchTrainArgs {
    /// Side of the images, px
    #[arg(long, value_name = "PX", default_value_t = 256, value_parser = clap::value_parser!(u32).range(32..=4096))]
    size: u32,
    /// Network to train; a U-Net's step has no features, adversarial or a priori loss, but gradient L1, a bound, AdamW,
    /// clipping and running means
    #[arg(long, value_enum, default_value = "generator")]
    network: NetworkName,
    /// Channels of the generators, or of the U-Net at its largest size
    #[arg(long, value_name = "N", default_value_t = 64)]
    width: usize,
    /// Images per step
    #[arg(long, value_name = "N", default_value_t = 1)]
    batch: usize,
    /// Train without VGG-19: RGB input only, no feature losses
    #[arg(long)]
    no_features: bool,
    /// Steps after the first, which is a warm-up
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=10000))]
    steps: u32,
}

const SCHEMA: &str = "glasshouse.bench_train/1";

pub(super) fn run(
    args: &BenchTrainArgs,
    global: &Global,
    output: &Output,
) -> Result<Exit, Failure> {
    let paper = TrainSettings {
        features: if args.no_features { FeatureSource::None } else { FeatureSource::Random },
        width: args.width,
        batch: args.batch,
        ..TrainSettings::default()
    };
    let settings = match args.network {
        NetworkName::Generator => paper,
        NetworkName::Unet => TrainSettings {
            features: FeatureSource::None,
            network: NetworkKind::Unet,
            start: Start::Residual,
            a_priori: false,
            bound: 1.0,
            adversarial_weight: 0.0,
            gradient_weight: 1.0,
            optimizer: OptimizerKind::Adamw,
            learning_rate: 2e-3,
            betas: [0.9, 0.99],
            weight_decay: 1e-4,
            clip_norm: 1.0,
            ema: 0.998,
            ..paper
        },
    };
    let usage = |e: train::SettingError| Failure::new(Exit::Usage, e);
    settings.validate().map_err(usage)?;
    if global.dry_run {
        output.show(SCHEMA, &Planned { dry_run: true, steps: args.steps });
        return Ok(Exit::Done);
    }
    let threads = use_threads(global);
    let failed = |e: train::candle_core::Error| Failure::new(Exit::Failed, e);
    let progress = Progress::new(global, "steps", u64::from(args.steps) + 1);
    let mut bench = TrainBench::new(&settings, args.size as usize).map_err(failed)?;
    let mut steps = Vec::new();
    // The first step is a warm-up.
    for step in 0..=args.steps {
        let measured = bench.step().map_err(failed)?;
        progress.add(1, false);
        if step > 0 {
            steps.push(measured);
        }
    }
    progress.finish();
    let (Some(best), Some(fastest)) =
        (least(&steps, |s| s.cpu_s).cloned(), least(&steps, |s| s.wall_s))
    else {
        return Err(failure!(Exit::Usage, "no step was taken"));
    };
    let mut parts: BTreeMap<&'static str, f64> = BTreeMap::new();
    for (name, seconds) in &best.parts {
        *parts.entry(name).or_default() += seconds;
    }
    let mut parts: Vec<(&'static str, f64)> = parts.into_iter().collect();
    parts.sort_by(|a, b| b.1.total_cmp(&a.1));
    let mut cpu: Vec<f64> = steps.iter().map(|s| s.cpu_s).collect();
    cpu.sort_by(f64::total_cmp);
    let report = Report {
        step_cpu_seconds: best.cpu_s,
        step_cpu_seconds_median: cpu[cpu.len() / 2],
        step_wall_seconds: fastest.wall_s,
        images_per_second: settings.batch as f64 / fastest.wall_s,
        params: bench.parameters(),
        peak_memory_bytes: peak_memory_bytes(),
        parts_cpu_seconds: parts,
        steps: steps.len(),
        size_px: args.size,
        batch: settings.batch,
        width: settings.width,
        network: settings.network,
        features: settings.features,
        threads,
        cpu: cpu_name(),
    };
    output.show(SCHEMA, &report);
    Ok(Exit::Done)
}

#[derive(Serialize)]
struct Planned {
    dry_run: bool,
    steps: u32,
}

impl fmt::Display for Planned {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "would take {} steps and a warm-up step", self.steps)
    }
}

#[derive(Serialize)]
struct Report {
    step_cpu_seconds: f64,
    step_cpu_seconds_median: f64,
    step_wall_seconds: f64,
    images_per_second: f64,
    params: usize,
    peak_memory_bytes: Option<u64>,
    #[serde(serialize_with = "as_map")]
    parts_cpu_seconds: Vec<(&'static str, f64)>,
    steps: usize,
    size_px: u32,
    batch: usize,
    width: usize,
    network: NetworkKind,
    features: FeatureSource,
    threads: usize,
    cpu: Option<String>,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut rows = vec![["part", "CPU s", "share"].map(str::to_owned).to_vec()];
        rows.extend(self.parts_cpu_seconds.iter().map(|(name, seconds)| {
            let share = 100.0 * seconds / self.step_cpu_seconds;
            vec![(*name).to_owned(), format!("{seconds:.3}"), format!("{share:.0} %")]
        }));
        let peak = self.peak_memory_bytes;
        write!(
            f,
            "one step, {size} x {size} px, batch {batch}, width {width}, {threads} threads{cpu}: {cpu_s:.3} CPU s (best of {n}; median {median:.3}), \
             {wall:.3} s, {images_per_s:.2} images/s, {parameters} parameters, peak memory {peak}\n{table}",
            size = self.size_px,
            batch = self.batch,
            width = self.width,
            threads = self.threads,
            cpu = on_cpu(),
            cpu_s = self.step_cpu_seconds,
            n = self.steps,
            median = self.step_cpu_seconds_median,
            wall = self.step_wall_seconds,
            images_per_s = self.images_per_second,
            parameters = self.params,
            peak = peak.map_or("?".to_owned(), |b| format!("{:.2} GB", b as f64 / 1e9)),
            table = markdown_table(&rows, 1),
        )
    }
}

/// Returns the step with the least value of a measure; `None` without steps.
fn least(steps: &[TrainStep], of: fn(&TrainStep) -> f64) -> Option<&TrainStep> {
    steps.iter().min_by(|a, b| of(a).total_cmp(&of(b)))
}

/// Returns the peak memory of this process, bytes, if the system reports it.
fn peak_memory_bytes() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024)
}
