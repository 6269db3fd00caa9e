//! Inspects folders: a run, a tuple, a checkpoint, the training of a stage, an export.

use super::digests::{CheckpointDigests, Digested};
use super::facts::{Inspection, Problem, Whole};
use super::file::inspect_file;
use super::kind::Kind;
use super::tuple::PNGS_NOT_CHECKED;
use crate::develop::{PHOTOGRAPH_RECORD, REQUEST_FILE};
use crate::made::{DEPTH_RECORDS, Digests, Files, Made, depth_records};
use crate::run::{Control, ControlState, Counts, Run, Scope, Snapshot, keys};
use crate::store::Store;
use glasshouse_line::Roots;
use glasshouse_line::layer::Layer;
use rayon::prelude::*;
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

/// Inspects a file or folder. Every error, even of a missing file, becomes a problem of the inspection.
pub fn inspect_path(path: &Path) -> Inspection {
    if path.is_dir() { read(path) } else { inspect_file(path) }
}

fn read(folder: &Path) -> Inspection {
    let has = |name: &str| folder.join(name).is_file();
    if has(keys::SPEC) || (has(keys::MANIFEST) && folder.join(keys::TUPLES).is_dir()) {
        return run(folder);
    }
    if has("tuple.json") || has("tuple.exr") {
        return tuple(folder);
    }
    if has(REQUEST_FILE) {
        return developed(folder);
    }
    if has(DEPTH_RECORDS) {
        return depth(folder);
    }
    if has("state.json") || has("model.safetensors") {
        return checkpoint(folder);
    }
    let steps = checkpoints(folder);
    if !steps.is_empty() || has("train.lock") {
        return stage(folder, &steps);
    }
    if has("SHA256SUMS") {
        return inspect_file(&folder.join("SHA256SUMS"));
    }
    let mut found = Inspection::new(Kind::Unknown);
    found.wrong(Problem::new(
        "it is a folder, but neither a run (spec.json), nor a tuple (tuple.json), nor a checkpoint (state.json)",
        "give the folder of a run, or a file",
    ));
    found
}

/// Inspects a folder by the file that is written last.
fn of_file(folder: &Path, name: &str, kind: Kind, to_do: &str) -> Inspection {
    if !folder.join(name).is_file() {
        let mut found = Inspection::new(kind);
        let what = format!("{name}, which is written last, is missing");
        found.wrong(Problem::new(what, to_do));
        return found;
    }
    let mut found = inspect_file(&folder.join(name));
    (found.kind, found.bytes) = (kind, None);
    found
}

fn tuple(folder: &Path) -> Inspection {
    const AGAIN: &str = "`glasshouse work RUN` makes the tuple again";
    let mut found = of_file(folder, "tuple.json", Kind::TupleFolder, AGAIN);
    if found.is_sound() && !folder.join("tuple.exr").is_file() {
        found.wrong(Problem::new("tuple.exr is missing", AGAIN));
    }
    // The reader of tuple.json reports missing pictures.
    let pictures = Layer::NAMES.map(|layer| format!("{layer}.png"));
    for name in pictures.iter().filter(|name| folder.join(name).is_file()) {
        add_problems(&mut found, inspect_file(&folder.join(name)), name);
    }
    if found.whole != Whole::Unknown(PNGS_NOT_CHECKED.to_owned()) {
        found.is_whole("no file is missing, and every file matches its digest in tuple.json");
    }
    found
}

fn checkpoint(folder: &Path) -> Inspection {
    let to_do = CheckpointDigests::TO_DO;
    let mut found = of_file(folder, "state.json", Kind::CheckpointFolder, to_do);
    found.is_whole("the digests in state.json match weights and moments");
    found
}

fn add_problems(found: &mut Inspection, part: Inspection, place: &str) {
    for problem in part.problems {
        found.wrong(problem.at(place));
    }
}

/// Inspects the photographs of all scenes.
fn developed(folder: &Path) -> Inspection {
    let mut found = inspect_file(&folder.join(REQUEST_FILE));
    (found.kind, found.bytes) = (Kind::DevelopedFolder, None);
    let scenes = below(folder, PHOTOGRAPH_RECORD);
    found.facts.value("scenes", scenes.len());
    let of = |scene: &String| inspect_file(&folder.join(scene).join(PHOTOGRAPH_RECORD));
    let parts: Vec<Inspection> = scenes.par_iter().map(of).collect();
    for (scene, part) in scenes.iter().zip(parts) {
        add_problems(&mut found, part, scene);
    }
    found.is_whole("every photograph matches its digest in photograph.json");
    found
}

/// Inspects depth maps and the pictures beside them.
fn depth(folder: &Path) -> Inspection {
    let mut found = Inspection::new(Kind::DepthFolder);
    let again = "`glasshouse depth` makes it again";
    let results = Files::results(folder);
    let digests = Digests::open(folder, true);
    match depth_records(folder) {
        Err(error) => found.wrong(Problem::new(error.to_string(), "make the folder readable")),
        Ok(records) => {
            found.facts.value("pictures", records.len());
            for made in records.into_values() {
                let own = Made { files: made.files, ..Made::default() };
                match digests.differences(&own, &results, &results) {
                    Err(error) => found.wrong(Problem::new(error.to_string(), again)),
                    Ok(differences) => {
                        for difference in differences {
                            found.wrong(Problem::new(difference.to_string(), again));
                        }
                    }
                }
            }
        }
    }
    found.is_whole("every depth map and picture matches its digest in made.jsonl");
    found
}

/// Lists the folders in a folder that have a file of this name, sorted.
fn below(folder: &Path, file: &str) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let names = entries.filter_map(|entry| entry.file_name().into_string().ok());
    let mut found: Vec<String> =
        names.filter(|name| folder.join(name).join(file).is_file()).collect();
    found.sort();
    found
}

/// Lists names and folders of checkpoints, in the order of their steps.
fn checkpoints(folder: &Path) -> Vec<(String, PathBuf)> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let named =
        entries.filter_map(|entry| Some((entry.file_name().into_string().ok()?, entry.path())));
    let is_step = |(name, path): &(String, PathBuf)| step_of(name).is_some() && path.is_dir();
    let mut found: Vec<_> = named.filter(is_step).collect();
    found.sort();
    found
}

fn step_of(name: &str) -> Option<u64> {
    name.strip_prefix("step-")?.parse().ok()
}

fn stage(folder: &Path, steps: &[(String, PathBuf)]) -> Inspection {
    let mut found = Inspection::new(Kind::StageFolder);
    found.facts.value("checkpoints", steps.len());
    for (name, path) in steps {
        let step = checkpoint(path);
        let text = match &step.whole {
            Whole::Yes(how) | Whole::Unknown(how) => how,
            Whole::No => "damaged",
        };
        found.facts.say(name, text);
        add_problems(&mut found, step, name);
    }
    let metrics = folder.join("metrics.csv");
    if metrics.is_file() {
        let metrics = inspect_file(&metrics);
        found.facts.rows.extend(metrics.facts.rows.iter().cloned());
        add_problems(&mut found, metrics, "metrics.csv");
    }
    found.is_whole("all files of its checkpoints have the digests of their states");
    found
}

fn run(folder: &Path) -> Inspection {
    let mut found = Inspection::new(Kind::Run);
    let run = match Run::open_to_read(folder, &Roots::default()) {
        Ok(run) => run,
        Err(error) => {
            // The error's text ends with the remedy.
            let text = error.to_string();
            let parts = text.rsplit_once("; ");
            let (what, to_do) = parts.unwrap_or((&text, "plan again into a new folder"));
            found.wrong(Problem::new(what, to_do));
            return found;
        }
    };
    let snapshot = Store::local(folder).and_then(|s| Snapshot::take(&run, &s, Scope::COUNTS));
    let status = match snapshot {
        Ok(snapshot) => snapshot.counts(),
        Err(error) => {
            found.wrong(Problem::new(error.to_string(), "make the folder readable"));
            return found;
        }
    };
    say_status(&mut found, &run, &status);
    say_training(&mut found, folder);
    let has_report = folder.join("report/index.html").is_file();
    let report = if has_report { "report/index.html" } else { "none" };
    found.facts.fact("report", report, has_report);
    say_control(&mut found, folder);
    advise(&mut found, &status, folder, has_report);
    tuples(&mut found, folder);
    found
}

/// Inspects all tuples of a run. A folder without `tuple.json`, which is written last, is an unfinished one.
fn tuples(found: &mut Inspection, run: &Path) {
    let tuples = run.join(keys::TUPLES);
    let scenes = below(&tuples, "tuple.json");
    let parts: Vec<Inspection> =
        scenes.par_iter().map(|scene| tuple(&tuples.join(scene))).collect();
    let mut unknown = None;
    for (scene, part) in scenes.iter().zip(parts) {
        if let Whole::Unknown(why) = part.whole {
            unknown = Some(why);
        }
        for problem in part.problems {
            let place = format!("{}/{scene}", keys::TUPLES);
            let place = match &problem.place {
                Some(within) => format!("{place}, {within}"),
                None => place,
            };
            found.wrong(problem.at(place));
        }
    }
    match unknown {
        Some(why) => found.may_be_whole(why),
        None => found.is_whole(
            "spec and manifest match, and every file of its tuples its digest; `glasshouse audit RUN` traces scenes again and compares them",
        ),
    }
}

fn say_status(found: &mut Inspection, run: &Run, status: &Counts) {
    let facts = &mut found.facts;
    facts.value("name", run.spec.name.as_str());
    let text = format!(
        "{}: {} done, {} started, {} waiting, {} in quarantine",
        status.scenes,
        status.merged,
        status.started,
        status.waiting,
        status.quarantined.len()
    );
    facts.fact("scenes", text, json!(status));
    facts.say("shards", format!("{} of {}", status.shards_done, status.shards));
    for scene in status.quarantined.iter().take(3) {
        facts.say("quarantine", format!("{}: {}", scene.scene, scene.reason));
    }
}

fn say_training(found: &mut Inspection, folder: &Path) {
    let newest = |stage: &str| {
        let steps = checkpoints(&folder.join("train").join(stage));
        Some((stage.to_owned(), json!(step_of(&steps.last()?.0))))
    };
    let stages: Map<String, Value> =
        ["backtrack", "separation"].into_iter().filter_map(newest).collect();
    found.facts.value("training", stages);
}

/// Adds the state of a paused or cancelled run, or the damage of its `control.json`.
fn say_control(found: &mut Inspection, folder: &Path) {
    let resume = format!("`glasshouse resume {}`", folder.display());
    let bytes = render::input_file::read(&folder.join(keys::CONTROL)).ok();
    match bytes.map(|bytes| Control::read(&bytes)) {
        Some(Ok(control)) if control.state != ControlState::Running => {
            let text = format!("{}{}", control.state.name(), control.because());
            found.facts.fact("held", text, control.state.name());
            found.next.push(format!("{resume} continues the run"));
        }
        Some(Err(reason)) => {
            let what = format!("control.json is damaged ({reason}), which pauses the run");
            found.wrong(Problem::new(what, format!("{resume} removes the file")));
        }
        _ => {}
    }
}

fn advise(found: &mut Inspection, status: &Counts, folder: &Path, has_report: bool) {
    let (shown, next) = (folder.display(), &mut found.next);
    if !status.is_finished() {
        next.push(format!("`glasshouse work {shown}` makes the missing tuples"));
    }
    if let Some(scene) = status.quarantined.first() {
        next.push(format!(
            "`glasshouse explain {shown} {}` shows the error; `glasshouse retry {shown} --all` makes workers try again",
            scene.scene
        ));
    }
    if status.is_finished() && !has_report {
        next.push(format!("`glasshouse report {shown}` writes the report"));
    } else if status.is_finished() && next.is_empty() {
        next.push("none: the run is finished and has a report".to_owned());
    }
}
