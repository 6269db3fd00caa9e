//! Folders: a run at a glance, a tuple, a checkpoint, the training of a stage.

use super::facts::{Inspection, Problem, Whole, many};
use super::kind::Kind;
use super::open::inspect_path;
use crate::run::{Control, ControlState, Run, RunStatus, keys, run_status};
use render::line::Roots;
use serde_json::json;
use std::path::{Path, PathBuf};

pub(super) fn read(folder: &Path) -> Inspection {
    let has = |name: &str| folder.join(name).is_file();
    if has(keys::SPEC) || (has(keys::MANIFEST) && folder.join(keys::TUPLES).is_dir()) {
        return run(folder);
    }
    if has("tuple.json") || has("tuple.exr") {
        return of_file(folder, "tuple.json", Kind::TupleFolder);
    }
    if has("state.json") || has("model.safetensors") {
        return of_file(folder, "state.json", Kind::CheckpointFolder);
    }
    let steps = checkpoints(folder);
    if !steps.is_empty() || has("train.lock") {
        return stage(folder, &steps);
    }
    if has("SHA256SUMS") {
        return inspect_path(&folder.join("SHA256SUMS"));
    }
    let mut found = Inspection::new(Kind::Unknown);
    found.wrong(Problem::new(
        "it is a folder, but neither a run (spec.json), nor a tuple (tuple.json), nor a checkpoint (state.json)",
        "give the folder of a run, or a file",
    ));
    found
}

/// A folder that one of its files tells about.
fn of_file(folder: &Path, name: &str, kind: Kind) -> Inspection {
    if !folder.join(name).is_file() {
        let mut found = Inspection::new(kind);
        let to_do = match kind {
            Kind::TupleFolder => "`glasshouse work RUN` makes the tuple again",
            _ => "delete the folder: `glasshouse train` goes on from the checkpoint before it",
        };
        found.wrong(Problem::new(
            format!("{name} is missing: it is written last"),
            to_do,
        ));
        return found;
    }
    let mut found = inspect_path(&folder.join(name));
    found.kind = kind;
    found.bytes = None;
    if kind == Kind::TupleFolder {
        for layer in render::trace::LAYERS {
            let path = folder.join(format!("{layer}.png"));
            // One that is missing was told by the record.
            let problems = if path.is_file() {
                inspect_path(&path).problems
            } else {
                Vec::new()
            };
            for problem in problems {
                found.wrong(problem.at(format!("{layer}.png")));
            }
        }
    }
    found.is_whole(match kind {
        Kind::TupleFolder => "all files are there, and the digests in tuple.json fit every layer",
        _ => "the digests in state.json fit weights and moments",
    });
    found
}

/// Folders of checkpoints, in the order of their steps.
fn checkpoints(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let is_step = |path: &PathBuf| {
        let name = path
            .file_name()
            .and_then(|name| name.to_str())
            .unwrap_or_default();
        let digits = name.strip_prefix("step-").unwrap_or_default();
        !digits.is_empty() && digits.bytes().all(|b| b.is_ascii_digit()) && path.is_dir()
    };
    let mut found: Vec<PathBuf> = entries.map(|entry| entry.path()).filter(is_step).collect();
    found.sort();
    found
}

fn stage(folder: &Path, steps: &[PathBuf]) -> Inspection {
    let mut found = Inspection::new(Kind::StageFolder);
    found
        .facts
        .fact("checkpoints", steps.len().to_string(), steps.len());
    for step in steps {
        let name = step
            .file_name()
            .map(|name| name.to_string_lossy().into_owned())
            .unwrap_or_default();
        let inspection = read(step);
        let text = match &inspection.whole {
            Whole::Yes(how) | Whole::Unknown(how) => how.clone(),
            Whole::No => "damaged".to_owned(),
        };
        found.facts.say(name.as_str(), text);
        for problem in inspection.problems {
            found.wrong(problem.at(name.clone()));
        }
    }
    let metrics = folder.join("metrics.csv");
    if metrics.is_file() {
        let inspection = inspect_path(&metrics);
        for (label, text) in inspection.facts.rows() {
            found.facts.say(label.clone(), text.clone());
        }
        for problem in inspection.problems {
            found.wrong(problem.at("metrics.csv"));
        }
    }
    found.is_whole("all files of its checkpoints have the digests of their states");
    found
}

fn run(folder: &Path) -> Inspection {
    let mut found = Inspection::new(Kind::Run);
    let run = match Run::open(folder, &Roots::default()) {
        Ok(run) => run,
        Err(error) => {
            // The text ends with what to do.
            let text = error.to_string();
            let (what, to_do) = text
                .rsplit_once("; ")
                .unwrap_or((&text, "plan again into a new folder"));
            found.wrong(Problem::new(what, to_do));
            return found;
        }
    };
    let status = run_status(&run);
    say_status(&mut found, &run, &status);
    say_training(&mut found, folder);
    let report = folder.join("report/index.html").is_file();
    found.facts.fact(
        "report",
        if report { "report/index.html" } else { "none" },
        report,
    );
    let control = std::fs::read(folder.join(keys::CONTROL))
        .ok()
        .map(|bytes| Control::read(&bytes));
    let shown = folder.display();
    match control {
        Some(Ok(control)) if control.state != ControlState::Running => {
            found.facts.fact(
                "held",
                format!("{}{}", control.state.name(), control.because()),
                control.state.name(),
            );
            found
                .next
                .push(format!("`glasshouse resume {shown}` lets it go on"));
        }
        Some(Err(reason)) => {
            let what = format!("control.json is damaged ({reason}), which pauses the run");
            found.wrong(Problem::new(
                what,
                format!("`glasshouse resume {shown}` removes it"),
            ));
        }
        _ => {}
    }
    next(&mut found, &status, folder, report);
    found.may_be_whole(
        "spec and manifest fit each other; `glasshouse audit RUN` traces scenes again and compares",
    );
    found
}

fn say_status(found: &mut Inspection, run: &Run, status: &RunStatus) {
    let facts = &mut found.facts;
    facts.fact("name", run.spec.name.as_str(), run.spec.name.as_str());
    let text = format!(
        "{}: {} done, {} begun, {} waiting, {} in quarantine",
        status.scenes,
        status.merged,
        status.started,
        status.waiting,
        status.quarantined.len()
    );
    facts.say("scenes", text);
    facts.put("scenes", json!(status));
    facts.say(
        "shards",
        format!("{} of {}", status.shards_done, status.shards),
    );
    for scene in status.quarantined.iter().take(3) {
        facts.say("quarantine", format!("{}: {}", scene.scene, scene.reason));
    }
}

fn say_training(found: &mut Inspection, folder: &Path) {
    let mut stages = serde_json::Map::new();
    for stage in ["backtrack", "separation"] {
        let steps = checkpoints(&folder.join("train").join(stage));
        let Some(last) = steps
            .last()
            .and_then(|path| path.file_name())
            .map(|name| name.to_string_lossy().into_owned())
        else {
            continue;
        };
        let step: u64 = last.trim_start_matches("step-").parse().unwrap_or(0);
        found.facts.say(
            "training",
            format!(
                "{stage}: {}, newest {last}",
                many(steps.len() as u64, "checkpoint")
            ),
        );
        stages.insert(stage.to_owned(), json!(step));
    }
    found.facts.put("training", stages);
}

fn next(found: &mut Inspection, status: &RunStatus, folder: &Path, report: bool) {
    let shown = folder.display();
    if !status.is_finished() {
        found
            .next
            .push(format!("`glasshouse work {shown}` does what is left"));
    }
    if let Some(scene) = status.quarantined.first() {
        found.next.push(format!(
            "`glasshouse explain {shown} {}` says what is wrong; `glasshouse retry {shown} --all` tries again",
            scene.scene
        ));
    }
    if status.is_finished() && !report {
        found
            .next
            .push(format!("`glasshouse report {shown}` writes the report"));
    }
    if status.is_finished() && report && found.next.is_empty() {
        found.next.push("nothing is left to do".to_owned());
    }
}
