//! `plan RECIPE --out RUN`: plans a run and estimates its cost.

use crate::bench::calibrate;
use crate::cli::args::{Global, RootArgs, isa, threads};
use crate::cli::exit_code::{Exit, Failure, failure};
use crate::cli::output::Output;
use crate::cli::progress::Progress;
use crate::cli::store_env;
use crate::doctor::{available_bytes, bytes_text};
use crate::outputs::check_place;
use crate::run::{PlanOptions, Planned, keys, plan_run};
use clap::Args as ClapArgs;
use glasshouse_line::{Roots, SceneLine, is_url};
use plan::{Calibration, Cost, Estimate, InvalidInput, Recipe, cost};
use render::atomic_file;
use render::scene::read_files_by;
use render::trace::Isa;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use tempfile::TempDir;

/// The recipe of a folder of photographs.
const FOLDER_RECIPE: &str = include_str!("../../../manifests/folder.toml");

#[derive(Clone, Debug, ClapArgs)]
pub(super) struct PlanArgs {
    /// Recipe (.toml), scenes (.jsonl), or a folder of photographs, for manifests/folder.toml
    pub(super) recipe: PathBuf,
    /// Folder of the run [default: runs/NAME]
    #[arg(long, value_name = "RUN")]
    pub(super) out: Option<PathBuf>,
    /// Side of a tile, px [default: 64 to 256, the smallest with shards of 0.2 s]
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u32).range(1..=16384))]
    pub(super) tile: Option<u32>,
    /// Leave out photographs with unusable files and draw others in their place (for a .jsonl: leave out scenes)
    #[arg(long)]
    pub(super) skip_invalid: bool,
    #[command(flatten)]
    pub(super) roots: RootArgs,
}

/// Returns the arguments as typed, or, for a folder of photographs, those of the recipe for folders, with the temporary folder of the
/// recipe.
pub(super) fn of_folder(typed: &PlanArgs) -> Result<(PlanArgs, Option<TempDir>), Failure> {
    let folder = &typed.recipe;
    if !folder.is_dir() {
        return Ok((typed.clone(), None));
    }
    if folder.join(keys::SPEC).is_file() {
        let run = folder.display();
        return Err(failure!(Exit::Usage, "{run} is a run: `glasshouse work {run}` continues it"));
    }
    let failed = |e: &dyn fmt::Display| {
        failure!(Exit::Failed, "cannot use the folder {}: {e}", folder.display())
    };
    let real = folder.canonicalize().map_err(|e| failed(&e))?;
    let name = real.file_name().unwrap_or("photos".as_ref());
    let place = tempfile::tempdir().map_err(|e| failed(&e))?;
    let recipe = place.path().join("folder.toml");
    atomic_file::write(&recipe, FOLDER_RECIPE.as_bytes()).map_err(|e| failed(&e))?;
    let mut args = typed.clone();
    args.out = Some(typed.out.clone().unwrap_or_else(|| Path::new("runs").join(name)));
    args.roots.roots.push(format!("photos={}", real.display()));
    args.recipe = recipe;
    Ok((args, Some(place)))
}

/// Returns the run's folder: `--out`, or `runs/NAME` with the recipe's file name, without its extension.
pub(super) fn run_folder(args: &PlanArgs) -> PathBuf {
    args.out.clone().unwrap_or_else(|| {
        PathBuf::from("runs").join(args.recipe.file_stem().unwrap_or(args.recipe.as_os_str()))
    })
}

/// Plans a run and prints progress, notes and warnings.
pub(super) fn plan_with(
    args: &PlanArgs,
    global: &Global,
    output: &Output,
) -> Result<Planned, Failure> {
    let roots = Roots::parse(&args.roots.roots)?;
    let inputs = store_env::inputs();
    let training = training(args)?;
    let options = PlanOptions {
        roots: &roots,
        inputs: &inputs,
        tile_px: args.tile,
        dry_run: global.dry_run,
        skip_invalid: args.skip_invalid,
        only: None,
        golden: None,
        training: training.as_deref(),
        threads: threads(global),
    };
    let steps = Steps { global, bars: Mutex::default() };
    check_place(&run_folder(args))?;
    let planned = plan_run(&args.recipe, &run_folder(args), &options, &|what, done, all| {
        steps.tell(what, done, all);
    });
    steps.finish();
    let planned = planned?;
    for note in &planned.drafted.notes {
        output.note(note);
    }
    if let Some(text) = planned.invalid_text() {
        output.warning(&text);
    }
    Ok(planned)
}

/// Returns the recipe's `[train]` table, if it has one, as JSON.
fn training(args: &PlanArgs) -> Result<Option<String>, Failure> {
    let bytes = render::input_file::read(&args.recipe).map_err(|e| {
        failure!(Exit::InvalidInput, "cannot read {}: {e}; check the path", args.recipe.display())
    })?;
    // A file that is not a recipe is a list of scenes and has no `[train]` table.
    let recipe = std::str::from_utf8(&bytes).ok().and_then(|text| Recipe::parse(text).ok());
    let Some(mut train) = recipe.and_then(|recipe| recipe.train) else {
        return Ok(None);
    };
    let folder = args.recipe.parent().unwrap_or(Path::new(""));
    train.resolve(folder).map_err(|e| Failure::new(Exit::Failed, e))?;
    let mut json =
        serde_json::to_string_pretty(&train).map_err(|e| Failure::new(Exit::Failed, e))?;
    json.push('\n');
    Ok(Some(json))
}

/// Progress bars of the planning steps.
struct Steps<'a> {
    global: &'a Global,
    bars: Mutex<BTreeMap<&'static str, Progress>>,
}

impl Steps<'_> {
    fn tell(&self, what: &'static str, done: usize, all: usize) {
        let mut bars = self.bars.lock().expect("no holder of this lock panics");
        let all = all as u64;
        match bars.get(what) {
            // The step starts again: extend its bar.
            Some(bar) if done == 0 => bar.set_length(bar.done() + all),
            Some(bar) => bar.add(1, false),
            None => drop(bars.insert(what, Progress::new(self.global, what, all))),
        }
    }

    fn finish(&self) {
        let bars = self.bars.lock().expect("no holder of this lock panics");
        bars.values().for_each(Progress::finish);
    }
}

pub(super) fn run(args: &PlanArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let (args, _recipe) = of_folder(args)?;
    let args = &args;
    let planned = plan_with(args, global, output)?;
    let folder = run_folder(args);
    let cost = cost(Estimate {
        lines: &planned.drafted.lines,
        tile_px: planned.spec.tile_px,
        threads: threads(global),
        input_bytes: planned.drafted.input_bytes,
        made_bytes: planned.made_bytes(),
        is_made: planned.existed,
        disk_available_bytes: available_bytes(&folder),
        calibration: try_out(&planned, &folder, isa(global)?)?,
    });
    if cost.is_too_large() {
        output.warning(&format!(
            "the disk of {} has {} left, but the run needs about {}: choose another disk with --out",
            folder.display(),
            bytes_text(cost.disk_available_bytes.unwrap_or(0) as f64),
            bytes_text(cost.disk_needed_bytes as f64)
        ));
    }
    let Planned { spec, drafted, existed } = planned;
    let summary = Summary {
        run: folder,
        dry_run: global.dry_run,
        existed,
        scenes: drafted.lines.len(),
        tile_px: spec.tile_px,
        cost,
        manifest_blake3: spec.manifest_blake3,
        invalid: drafted.invalid,
        left_out: spec.left_out,
        rejected: drafted.rejected.len(),
        notes: drafted.notes,
        parts: drafted.left_out_kind,
    };
    output.show("glasshouse.plan/1", &summary);
    Ok(Exit::Done)
}

/// Calibrates the estimate on this machine: reads, decodes and traces a part of some scenes.
fn try_out(planned: &Planned, run: &Path, isa: Isa) -> Result<Option<Calibration>, Failure> {
    let mut roots = Roots::default();
    for (name, folder) in &planned.spec.roots {
        // Relative paths start at the run's folder.
        let folder = if is_url(folder) { folder.clone() } else { run.join(folder) };
        roots.insert(name, folder)?;
    }
    let inputs = store_env::inputs();
    let read = |line: &SceneLine| read_files_by(line, &roots, run, &|path| inputs.read(path));
    Ok(calibrate(&planned.drafted.lines, &read, isa))
}

/// The plan and its estimated cost.
#[derive(Serialize)]
struct Summary {
    #[serde(serialize_with = "render::path_text::one")]
    run: PathBuf,
    dry_run: bool,
    existed: bool,
    scenes: usize,
    tile_px: u32,
    #[serde(flatten)]
    cost: Cost,
    manifest_blake3: String,
    invalid: Vec<InvalidInput>,
    left_out: Vec<String>,
    rejected: usize,
    notes: Vec<String>,
    /// Noun for `left_out`: photographs or scenes.
    #[serde(skip)]
    parts: &'static str,
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let verb = match (self.dry_run, self.existed) {
            (_, true) => "is already planned:",
            (true, false) => "would plan",
            (false, false) => "planned",
        };
        let cost = &self.cost;
        write!(
            f,
            "{} {verb} {} scenes in {} shards (tile {} px)",
            self.run.display(),
            self.scenes,
            cost.shards,
            self.tile_px
        )?;
        if !self.left_out.is_empty() {
            write!(f, "; {} left out: {}", self.parts, self.left_out.len())?;
        }
        let size = |bytes: u64| bytes_text(bytes as f64);
        let inputs = cost.input_bytes.map(size);
        let inputs =
            inputs.unwrap_or_else(|| "not checked, because the run is already planned".to_owned());
        let available =
            cost.disk_available_bytes.map(|bytes| format!(", {} available", size(bytes)));
        let available = available.unwrap_or_default();
        let how = match &cost.calibration {
            Some(c) => format!(
                "measured here on {} scenes: {:.1} ns per sample, {:.0} ms per load",
                c.scenes.len(),
                c.seconds_per_sample * 1e9,
                c.seconds_per_load * 1e3
            ),
            None => "of a typical machine, because no scene can be measured here yet".to_owned(),
        };
        write!(
            f,
            "\n  inputs    {inputs}\n  \
             tuples    about {}\n  \
             partials  up to {} at a time with one worker here; {} if all were written\n  \
             disk      about {} needed{available}\n  \
             time      about {} of one core ({how})",
            size(cost.tuple_bytes),
            size(cost.partial_bytes_at_a_time),
            size(cost.partial_bytes),
            size(cost.disk_needed_bytes),
            span_text(cost.core_s),
        )
    }
}

fn span_text(seconds: f64) -> String {
    match seconds {
        s if s < 120.0 => format!("{s:.0} s"),
        s if s < 7200.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_units() {
        assert_eq!(bytes_text(999.0), "1 kB");
        assert_eq!(bytes_text(8.86e9), "8.9 GB");
        assert_eq!(bytes_text(12_340_000.0), "12.3 MB");
        assert_eq!(span_text(7199.0), "120 min");
        assert_eq!(span_text(2.0 * 3600.0), "2.0 h");
    }
}
