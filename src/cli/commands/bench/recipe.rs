//! `bench recipe`: measures the scenes of a recipe by feature or by stage.

use crate::bench::{
    BenchError, FeatureRow, SceneCost, Work, by_feature, cpu_name, on_cpu, scene_cost, stage_costs,
};
use crate::cli::args::{Global, RootArgs, isa, parse_spp};
use crate::cli::exit_code::{Exit, Failure, failure};
use crate::cli::output::Output;
use crate::cli::progress::Progress;
use crate::cli::signals::Signals;
use crate::cli::store_env;
use crate::farm::WorkOptions;
use crate::run::{PlanOptions, Planned, Run, plan_run, process_cpu_s};
use clap::{Args as ClapArgs, ValueEnum};
use compose::markdown_table;
use glasshouse_line::{Roots, SceneLine, to_jsonl};
use render::atomic_file;
use render::scene::read_files_by;
use render::shard::{Golden, golden};
use render::trace::{Isa, TRACER_VERSION};
use serde::Serialize;
use std::collections::BTreeSet;
use std::fmt;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

#[derive(Debug, ClapArgs)]
pub(super) struct BenchRecipeArgs {
    /// Recipe (.toml) or scenes (.jsonl)
    recipe: PathBuf,
    /// Rows of the table
    #[arg(long, value_enum, default_value = "feature")]
    by: By,
    /// Number of scenes, spread over all
    #[arg(long, value_name = "N", default_value_t = 35, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    scenes: u32,
    /// Samples per pixel, a power of two [default: those of the recipe]
    #[arg(long, value_name = "N", value_parser = parse_spp)]
    spp: Option<u32>,
    /// Number of rounds of `--by feature`
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u16).range(1..=1000))]
    rounds: u16,
    #[command(flatten)]
    roots: RootArgs,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "snake_case")]
enum By {
    Feature,
    Stage,
}

const SCHEMA: &str = "glasshouse.bench_recipe/1";

pub(super) fn run(
    args: &BenchRecipeArgs,
    global: &Global,
    output: &Output,
) -> Result<Exit, Failure> {
    if global.dry_run {
        let recipe = args.recipe.clone();
        output.show(SCHEMA, &Announced { dry_run: true, recipe, by: args.by, scenes: args.scenes });
        return Ok(Exit::Done);
    }
    let report = Bench::new(args, global)?.measure(output)?;
    output.show(SCHEMA, &report);
    Ok(Exit::Done)
}

/// A recipe and a temporary folder for its runs.
struct Bench<'a> {
    args: &'a BenchRecipeArgs,
    global: &'a Global,
    isa: Isa,
    /// Traced once and before the clock starts, because it does not depend on the scenes.
    golden: Golden,
    folder: TempDir,
}

impl<'a> Bench<'a> {
    fn new(args: &'a BenchRecipeArgs, global: &'a Global) -> Result<Self, Failure> {
        let folder = tempfile::tempdir()
            .map_err(|e| failure!(Exit::Failed, "cannot make a temporary folder: {e}"))?;
        let isa = isa(global)?;
        Ok(Self { args, global, isa, golden: golden(isa, 1), folder })
    }

    /// Plans the scenes of `source` into a run. Returns it with the CPU seconds of planning.
    fn plan(&self, source: &Path, run: &Path, roots: &Roots) -> Result<(Planned, f64), Failure> {
        let inputs = store_env::inputs();
        let options = PlanOptions {
            roots,
            inputs: &inputs,
            tile_px: None,
            dry_run: false,
            skip_invalid: false,
            only: Some(self.args.scenes as usize),
            golden: Some(self.golden.clone()),
            training: None,
            threads: 1,
        };
        let start = process_cpu_s();
        let planned = plan_run(source, run, &options, &|_, _, _| {})?;
        Ok((planned, process_cpu_s() - start))
    }

    fn measure(&self, output: &Output) -> Result<Report, Failure> {
        let given = Roots::parse(&self.args.roots.roots)?;
        let mut place = self.folder.path().join("run");
        let (mut planned, first_s) = self.plan(&self.args.recipe, &place, &given)?;
        for note in &planned.drafted.notes {
            output.note(note);
        }
        if let Some(spp) = self.args.spp {
            for line in &mut planned.drafted.lines {
                line.film.spp = spp;
            }
        }
        let lines = &planned.drafted.lines;
        let count = lines.len();
        let mut report = Report {
            recipe: self.args.recipe.clone(),
            by: self.args.by,
            scenes: count,
            spp: self.args.spp,
            tracer_version: TRACER_VERSION,
            cpu: cpu_name(),
            features: None,
            costs: None,
            stages: None,
            refused: Vec::new(),
        };
        let run = Run::open(&place, &Roots::default())?;
        if self.args.by == By::Feature {
            let costs = self.costs(&run, lines, &mut report.refused)?;
            report.features = Some(by_feature(&costs));
            report.costs = Some(costs);
            return Ok(report);
        }
        // A second planning finds the photographs made and checks no files.
        let (_, again_s) = self.plan(&self.args.recipe, &place, &given)?;
        if self.args.spp.is_some() {
            let source = self.folder.path().join("scenes.jsonl");
            atomic_file::write(&source, to_jsonl(lines).as_bytes())?;
            place = self.folder.path().join("again");
            self.plan(&source, &place, &used_roots(&run.roots, lines))?;
        }
        let run = Run::open(&place, &Roots::default())?;
        let signals = Signals::catch();
        let mut stages = vec![
            ("once: checks, photographs", (first_s - again_s).max(0.0) / count as f64),
            ("plan", again_s / count as f64),
        ];
        let costs = stage_costs(&run, &WorkOptions::new(1, self.isa, signals.stop()))?;
        stages.extend(costs.stages);
        let quarantined = costs.quarantined.into_iter();
        report.refused =
            quarantined.map(|(id, reason)| Refused { scene: id.to_string(), reason }).collect();
        some_measured(&report.refused, count)?;
        report.stages = Some(stages.into_iter().map(Stage::from).collect());
        Ok(report)
    }

    /// Measures the scenes, and puts those that a run would quarantine into `refused`.
    fn costs(
        &self,
        run: &Run,
        lines: &[SceneLine],
        refused: &mut Vec<Refused>,
    ) -> Result<Vec<SceneCost>, Failure> {
        let signals = Signals::catch();
        let progress = Progress::new(self.global, "scenes", lines.len() as u64);
        let inputs = store_env::inputs();
        let read = |line: &SceneLine| {
            read_files_by(line, &run.roots, run.root(), &|path| inputs.read(path))
        };
        let work = Work { threads: 1, isa: self.isa, stop: signals.stop(), on_samples: &|_| {} };
        let mut costs = Vec::new();
        for line in lines {
            match scene_cost(line, usize::from(self.args.rounds), &read, &work) {
                Ok(Some(cost)) => costs.push(cost),
                Ok(None) => {
                    progress.finish();
                    let stopped = "stopped by a signal: no table was written";
                    return Err(failure!(signals.exit(), "{stopped}"));
                }
                Err(refusal @ (BenchError::Load(_) | BenchError::Assemble(_))) => {
                    let reason = refusal.to_string();
                    refused.push(Refused { scene: line.id.to_string(), reason });
                }
                Err(error) => return Err(error.into()),
            }
            progress.add(1, false);
        }
        progress.finish();
        some_measured(refused, lines.len())?;
        Ok(costs)
    }
}

/// Fails if all scenes were refused, with the first reason.
fn some_measured(refused: &[Refused], count: usize) -> Result<(), Failure> {
    match refused.first() {
        Some(first) if refused.len() == count => {
            Err(failure!(Exit::InvalidInput, "no scene can be rendered; the first: {first}"))
        }
        _ => Ok(()),
    }
}

/// Returns the roots that the lines' paths begin with.
fn used_roots(roots: &Roots, lines: &[SceneLine]) -> Roots {
    let paths = lines.iter().flat_map(SceneLine::paths);
    let names: BTreeSet<&str> =
        paths.filter_map(|(_, path)| Some(path.split_once(':')?.0)).collect();
    let mut used = Roots::default();
    for (name, folder) in roots.iter().filter(|(name, _)| names.contains(name)) {
        used.replace(name, folder.to_owned());
    }
    used
}

#[derive(Serialize)]
struct Announced {
    dry_run: bool,
    #[serde(serialize_with = "render::path_text::one")]
    recipe: PathBuf,
    by: By,
    scenes: u32,
}

impl fmt::Display for Announced {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "would measure {} scenes of {}", self.scenes, self.recipe.display())
    }
}

#[derive(Serialize)]
struct Report {
    #[serde(serialize_with = "render::path_text::one")]
    recipe: PathBuf,
    by: By,
    scenes: usize,
    /// `null` for the recipe's own.
    spp: Option<u32>,
    tracer_version: u32,
    cpu: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    features: Option<Vec<FeatureRow>>,
    /// Costs of the single scenes.
    #[serde(skip_serializing_if = "Option::is_none")]
    costs: Option<Vec<SceneCost>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    stages: Option<Vec<Stage>>,
    /// Scenes that a run quarantines; they are in no figure.
    refused: Vec<Refused>,
}

#[derive(Serialize)]
struct Refused {
    scene: String,
    reason: String,
}

impl fmt::Display for Refused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.scene, self.reason)
    }
}

/// A stage and its CPU seconds for one tuple.
#[derive(Serialize)]
struct Stage {
    stage: &'static str,
    cpu_seconds: f64,
}

impl From<(&'static str, f64)> for Stage {
    fn from((stage, cpu_seconds): (&'static str, f64)) -> Self {
        Self { stage, cpu_seconds }
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let spp = self.spp.map_or_else(String::new, |spp| format!(", {spp} samples"));
        let Self { recipe, scenes, .. } = self;
        writeln!(f, "{}: {scenes} scenes{spp}, one thread{}", recipe.display(), on_cpu())?;
        if let Some(rows) = &self.features {
            f.write_str(&feature_table(rows))?;
        }
        if let Some(stages) = &self.stages {
            let sum: f64 = stages.iter().skip(1).map(|stage| stage.cpu_seconds).sum();
            let row =
                |stage: &str, seconds: f64| vec![stage.to_owned(), format!("{:.1}", 1e3 * seconds)];
            let mut table = vec![vec!["stage".to_owned(), "CPU ms of a tuple".to_owned()]];
            table.extend(stages.iter().map(|stage| row(stage.stage, stage.cpu_seconds)));
            table.push(row("plan to rest", sum));
            f.write_str(&markdown_table(&table, 1))?;
        }
        for refused in &self.refused {
            write!(f, "\nrefused, in no figure: {refused}")?;
        }
        Ok(())
    }
}

fn feature_table(rows: &[FeatureRow]) -> String {
    let head =
        "features | scenes | CPU s | over flat | worst | over plain | worst | error | flat | plain";
    let mut table = vec![head.split(" | ").map(str::to_owned).collect::<Vec<_>>()];
    for row in rows {
        let mut cells =
            vec![row.features.clone(), row.scenes.to_string(), format!("{:.3}", row.cpu_seconds)];
        let ratios = [row.over_flat, row.worst_over_flat, row.over_plain, row.worst_over_plain];
        cells.extend(ratios.map(|ratio| format!("{ratio:.2}")));
        let error = |error: Option<f64>| error.map_or("-".to_owned(), |e| format!("{e:.1e}"));
        cells.extend(row.error_rms.map(error));
        table.push(cells);
    }
    markdown_table(&table, 1)
}
