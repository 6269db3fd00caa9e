//! Small JSON files: quarantine, attempts, control, receipts, notes, and what commands print.

use super::facts::{Inspection, Problem, many};
use super::kind::{Kind, schema_of};
use super::look::{AGAIN, Input};
use crate::run::{AttemptRecord, Control, QuarantineRecord, Receipt, keys};
use plan::TrainRecipe;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

/// Parses a JSON file of the schema of `found`'s kind; what is wrong with it is added to `found`.
pub(super) fn typed<T: DeserializeOwned>(
    found: &mut Inspection,
    input: &Input,
    to_do: &str,
) -> Option<T> {
    let value = value(found, input, to_do)?;
    if let Some(expected) = schema_of(found.kind)
        && value["schema"] != expected
    {
        let what = format!(
            "its schema is {}, this program reads {expected:?}",
            value["schema"]
        );
        found.wrong(Problem::new(
            what,
            "use the version of the program that wrote it",
        ));
        return None;
    }
    match serde_json::from_slice(input.bytes) {
        Ok(record) => Some(record),
        Err(error) => {
            found.wrong(json_problem(&error, to_do));
            None
        }
    }
}

fn value(found: &mut Inspection, input: &Input, to_do: &str) -> Option<Value> {
    match serde_json::from_slice::<Value>(input.bytes) {
        Ok(value) => Some(value),
        Err(error) => {
            found.wrong(json_problem(&error, to_do));
            None
        }
    }
}

fn json_problem(error: &serde_json::Error, to_do: &str) -> Problem {
    let text = error.to_string();
    let reason = text
        .rsplit_once(" at line ")
        .map_or(text.as_str(), |(reason, _)| reason);
    let what = if error.is_eof() {
        format!("it is cut: {reason}")
    } else {
        format!("it cannot be read: {reason}")
    };
    Problem::new(what, to_do).at(format!("line {}, column {}", error.line(), error.column()))
}

/// Nothing in these files tells whether a letter of them was changed.
const NO_DIGEST: &str = "it can be read; files of this kind have no digest";

pub(super) fn read(kind: Kind, input: &Input) -> Inspection {
    let mut found = Inspection::new(kind);
    let known = match kind {
        Kind::Quarantine => quarantine(&mut found, input),
        Kind::Attempt => attempt(&mut found, input),
        Kind::Control => control(&mut found, input),
        Kind::Receipt => receipt(&mut found, input),
        Kind::MadeBy => made_by(&mut found, input),
        Kind::Finished => numbers(&mut found, input, &["scenes", "quarantined"]),
        Kind::Best => numbers(&mut found, input, &["step", "validation_psnr_db"]),
        Kind::TrainRecipe => train(&mut found, input),
        Kind::Croissant => croissant(&mut found, input),
        _ => output(&mut found, input),
    };
    if known.is_some() {
        found.may_be_whole(NO_DIGEST);
    }
    found
}

/// The scene in a record is that of its name.
fn check_name(found: &mut Inspection, input: &Input, scene: &str) {
    let stem = input.name.strip_suffix(".json").unwrap_or(input.name);
    found.facts.fact("scene", scene, scene);
    if stem != scene {
        found.next.push(format!(
            "its name in a run is {scene}.json: under another one the run takes it for that scene's"
        ));
    }
}

fn quarantine(found: &mut Inspection, input: &Input) -> Option<()> {
    let to_do = "delete it to have the scene tried again";
    let record: QuarantineRecord = typed(found, input, to_do)?;
    check_name(found, input, record.scene.as_str());
    found
        .facts
        .fact("reason", record.reason.as_str(), record.reason.as_str());
    found.next.push(format!(
        "mend what it says, then `glasshouse retry RUN {0}`; `glasshouse explain RUN {0}` tells more",
        record.scene
    ));
    Some(())
}

fn attempt(found: &mut Inspection, input: &Input) -> Option<()> {
    let record: AttemptRecord = typed(found, input, "nothing: it counts as a lost attempt")?;
    let [start, end] = record.shards;
    let facts = &mut found.facts;
    facts.fact("scene", record.scene.as_str(), record.scene.as_str());
    let text = format!(
        "{start} to {}, attempt {} at them",
        end.saturating_sub(1),
        record.n
    );
    facts.fact("shards", text, json!(record.shards));
    facts.put("n", record.n);
    facts.fact(
        "worker",
        format!("{} on {}", record.worker, record.host),
        record.worker.as_str(),
    );
    facts.put("host", record.host.as_str());
    let text = match &record.ended {
        None => "not yet, or nobody knows better".to_owned(),
        Some(end) => format!(
            "{}: {}",
            format!("{:?}", end.kind).to_lowercase(),
            end.reason
        ),
    };
    facts.fact("ended", text, json!(record.ended));
    if let Some(end) = record.ended.as_ref().filter(|end| !end.log_tail.is_empty()) {
        facts.say("last lines", end.log_tail.trim_end());
    }
    let named = keys::attempt_of(input.name);
    if named.is_some_and(|named| named != (record.shards, record.n)) {
        let what = format!(
            "its name says other shards than it does, {start}-{end}.{}",
            record.n
        );
        found.wrong(Problem::new(
            what,
            "delete it: the attempt is then not counted",
        ));
    }
    found.next.push(format!(
        "`glasshouse explain RUN {}` tells what becomes of them",
        record.scene
    ));
    Some(())
}

fn control(found: &mut Inspection, input: &Input) -> Option<()> {
    let to_do = "`glasshouse resume RUN` removes it; until then the run is paused";
    let _: Value = typed(found, input, to_do)?;
    match Control::read(input.bytes) {
        Ok(control) => {
            found
                .facts
                .fact("state", control.state.name(), control.state.name());
            let reason = control.reason.as_deref();
            found
                .facts
                .fact("reason", reason.unwrap_or("none was given"), json!(reason));
            found
                .next
                .push("`glasshouse resume RUN` lets the run go on".to_owned());
            Some(())
        }
        Err(reason) => {
            found.wrong(Problem::new(format!("it cannot be read: {reason}"), to_do));
            None
        }
    }
}

fn receipt(found: &mut Inspection, input: &Input) -> Option<()> {
    let record: Receipt = typed(
        found,
        input,
        "delete it: only looks of a coordinator depend on it",
    )?;
    if let Some(scene) = &record.scene {
        check_name(found, input, scene.as_str());
    }
    let host = record.host.as_deref().unwrap_or("an unknown host");
    found.facts.fact(
        "worker",
        format!("{}, on {host}", record.makers()),
        json!(record.worker),
    );
    found.facts.put("with", json!(record.with));
    found.facts.put("host", json!(record.host));
    let version = record.version.as_deref();
    found
        .facts
        .fact("version", version.unwrap_or("unknown"), json!(version));
    Some(())
}

fn made_by(found: &mut Inspection, input: &Input) -> Option<()> {
    let note: Value = typed(found, input, "nothing: nothing depends on it")?;
    let shards: Option<[u32; 2]> = serde_json::from_value(note["shards"].clone()).ok();
    let (Some([start, end]), Some(worker), Some(host)) =
        (shards, note["worker"].as_str(), note["host"].as_str())
    else {
        found.wrong(Problem::new(
            "it lacks `shards`, `worker` or `host`",
            "nothing: nothing depends on it",
        ));
        return None;
    };
    let text = format!("{start} to {}", end.saturating_sub(1));
    found.facts.fact("shards", text, json!([start, end]));
    found
        .facts
        .fact("worker", format!("{worker} on {host}"), worker);
    Some(())
}

/// A flat object with these numbers.
fn numbers(found: &mut Inspection, input: &Input, names: &[&str]) -> Option<()> {
    let object: Value = typed(found, input, AGAIN)?;
    for name in names {
        if !object[*name].is_number() {
            found.wrong(Problem::new(format!("it has no number `{name}`"), AGAIN));
            return None;
        }
        found
            .facts
            .fact(name, object[*name].to_string(), object[*name].clone());
    }
    Some(())
}

fn train(found: &mut Inspection, input: &Input) -> Option<()> {
    let recipe: TrainRecipe = typed(found, input, "plan the run again into a new folder")?;
    let text = format!(
        "{} of BT-net, {} of SP-net",
        recipe.backtrack_steps, recipe.separation_steps
    );
    found.facts.fact(
        "steps",
        text,
        json!([recipe.backtrack_steps, recipe.separation_steps]),
    );
    found.facts.put("settings", json!(recipe.settings));
    Some(())
}

fn croissant(found: &mut Inspection, input: &Input) -> Option<()> {
    let object: Value = typed(found, input, AGAIN)?;
    for key in ["name", "description", "license", "conformsTo"] {
        if let Some(text) = object[key].as_str() {
            found.facts.fact(key, text, text);
        }
    }
    let count = |key: &str| object[key].as_array().map_or(0, Vec::len);
    let (files, sets) = (count("distribution"), count("recordSet"));
    found
        .facts
        .fact("distribution", many(files as u64, "part"), files);
    found.facts.fact("record_sets", sets.to_string(), sets);
    if object["@type"].as_str().is_none() {
        found.wrong(Problem::new("it has no `@type`", AGAIN));
    }
    Some(())
}

/// Keys of an output that are shown.
const SHOWN: usize = 12;

fn output(found: &mut Inspection, input: &Input) -> Option<()> {
    let object = value(found, input, AGAIN)?;
    let schema = object["schema"].as_str().unwrap_or("none").to_owned();
    found.facts.fact("schema", schema.as_str(), schema.as_str());
    let keys: Vec<&String> = object
        .as_object()
        .map(|o| o.keys().collect())
        .unwrap_or_default();
    found
        .facts
        .fact("keys", super::facts::first_of(&keys, SHOWN), json!(keys));
    found.next.push("docs/formats.md has its fields".to_owned());
    Some(())
}
