//! `plan RECIPE --out RUN`

use super::args::{Global, PlanArgs};
use super::exit_code::{Exit, Failure};
use super::output::Output;
use super::plan_cost::{Cost, bytes_text};
use super::progress::Progress;
use super::store_env;
use super::work_cmd::threads;
use crate::run::{PlanOptions, Planned, plan_run};
use plan::Recipe;
use render::line::Roots;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Mutex;

/// Where a run keeps its recipe's `[train]`.
pub(super) const TRAIN_RECIPE: &str = "train.json";

/// The run's folder: as given, or `runs/NAME` by the recipe's file name.
pub(super) fn run_folder(args: &PlanArgs) -> PathBuf {
    args.out.clone().unwrap_or_else(|| {
        PathBuf::from("runs").join(args.recipe.file_stem().unwrap_or(args.recipe.as_os_str()))
    })
}

/// Plans with progress, notes and warnings.
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
        skip_invalid: args.skip_invalid,
        threads: threads(global),
    };
    let steps = Steps {
        global,
        bars: Mutex::default(),
    };
    let planned = plan_run(
        &args.recipe,
        &run_folder(args),
        &options,
        &|what, done, all| {
            steps.tell(what, done, all);
        },
    );
    steps.finish();
    let planned = planned?;
    if !global.dry_run {
        keep_training(args)?;
    }
    for note in &planned.notes {
        output.note(note);
    }
    if let Some(text) = planned.invalid_text() {
        output.warning(&text);
    }
    Ok(planned)
}

/// Leaves the recipe's `[train]` in the run, for `train`.
fn keep_training(args: &PlanArgs) -> Result<(), Failure> {
    let text = std::fs::read_to_string(&args.recipe).unwrap_or_default();
    // What is no recipe has been planned as scene lines.
    let Some(train) = Recipe::parse(&text).ok().and_then(|recipe| recipe.train) else {
        return Ok(());
    };
    let mut json =
        serde_json::to_string_pretty(&train).map_err(|e| Failure::new(Exit::Failed, e))?;
    json.push('\n');
    render::atomic_file::write(&run_folder(args).join(TRAIN_RECIPE), json.as_bytes())?;
    Ok(())
}

/// Progress of what planning does, a bar each.
struct Steps<'a> {
    global: &'a Global,
    bars: Mutex<BTreeMap<&'static str, Progress>>,
}

impl Steps<'_> {
    fn tell(&self, what: &'static str, done: usize, all: usize) {
        let mut bars = self.bars.lock().expect("no holder of this lock panics");
        let all = all as u64;
        match bars.get(what) {
            // A step that is taken again.
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
    let planned = plan_with(args, global, output)?;
    let folder = run_folder(args);
    let cost = Cost::of(&planned, &folder, global)?;
    if cost.is_too_large() {
        output.warning(&format!(
            "the disk of {} has {} left, the run needs about {}: choose another with --out",
            folder.display(),
            bytes_text(cost.disk_available_bytes.unwrap_or(0) as f64),
            bytes_text(cost.disk_needed_bytes)
        ));
    }
    let verb = match (global.dry_run, planned.existed) {
        (_, true) => "is planned already:",
        (true, false) => "would plan",
        (false, false) => "planned",
    };
    let scenes = planned.lines.len();
    let mut object = json!({
        "run": folder,
        "dry_run": global.dry_run,
        "existed": planned.existed,
        "scenes": scenes,
        "tile_px": planned.spec.tile_px,
    });
    if let (Value::Object(object), Value::Object(cost)) = (&mut object, cost.json()) {
        object.extend(cost);
    }
    object["manifest_blake3"] = json!(planned.spec.manifest_blake3);
    object["invalid"] = json!(planned.invalid);
    object["left_out"] = json!(planned.spec.left_out);
    object["rejected"] = json!(planned.rejected.len());
    object["notes"] = json!(planned.notes);
    let left_out = match planned.spec.left_out.len() {
        0 => String::new(),
        n => format!("; {} left out: {n}", planned.parts),
    };
    output.result(
        "glasshouse.plan/1",
        object,
        &format!(
            "{} {verb} {scenes} scenes in {} shards (tile {} px){left_out}\n{}",
            folder.display(),
            cost.shards,
            planned.spec.tile_px,
            cost.text(),
        ),
    );
    Ok(Exit::Done)
}
