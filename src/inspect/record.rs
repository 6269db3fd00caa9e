//! Inspects small files with one JSON object or TOML table: checks their type and shows a table of keys and values.

use super::digests::{CheckpointDigests, Digested, hold_record};
use super::facts::{Inspection, Problem, text_of};
use super::input::{AGAIN, Input};
use super::kind::{Kind, schema_of};
use crate::develop::{DevelopRequest, PhotographsRecord};
use crate::run::{AttemptRecord, Control, PartialsProvenance, Provenance, QuarantineRecord, keys};
use plan::{DepthRanges, Recipe, Trainings};
use render::shard::Spec;
use render::trace::TRACER_VERSION;
use serde::de::{DeserializeOwned, IgnoredAny};
use serde_json::{Map, Value, json};

/// Inspects a record of a kind without a special reader.
pub(super) fn read(kind: Kind, input: &Input) -> Inspection {
    let mut found = Inspection::new(kind);
    let object = match kind {
        Kind::Spec => held::<Spec>(&mut found, input),
        Kind::CheckpointState => held::<CheckpointDigests>(&mut found, input).map(|mut state| {
            let psnr = state.remove("validation_psnr_db");
            state.insert("validation".to_owned(), psnr.unwrap_or_default());
            state
        }),
        Kind::Photographs => held::<PhotographsRecord>(&mut found, input),
        Kind::Developed => keys_of::<DevelopRequest>(&mut found, input),
        Kind::Quarantine => keys_of::<QuarantineRecord>(&mut found, input),
        Kind::Attempt => keys_of::<AttemptRecord>(&mut found, input),
        Kind::Receipt => keys_of::<Provenance>(&mut found, input),
        Kind::MadeBy => keys_of::<PartialsProvenance>(&mut found, input),
        Kind::Finished | Kind::Best | Kind::DepthMaps => keys_of::<IgnoredAny>(&mut found, input),
        Kind::TrainRecipe => keys_of::<Trainings>(&mut found, input),
        Kind::Control => {
            let object = keys_of::<IgnoredAny>(&mut found, input);
            if let (Some(_), Err(reason)) = (&object, Control::read(input.bytes)) {
                found.wrong(Problem::new(format!("it cannot be read: {reason}"), to_do(kind)));
            }
            object
        }
        Kind::Recipe => toml_table(&mut found, input, |text| Recipe::parse(text).map(drop)),
        Kind::DepthRanges => {
            toml_table(&mut found, input, |text| DepthRanges::parse(text).map(drop))
        }
        _ => keys_of::<IgnoredAny>(&mut found, input).map(|object| summary(kind, object)),
    };
    if let Some(object) = object {
        tell(&mut found, &object);
        check_name(&mut found, input.name, &object);
        advise(&mut found, &object);
        if !matches!(kind, Kind::Spec | Kind::CheckpointState | Kind::Photographs) {
            found.may_be_whole("it can be read; files of this kind have no digest");
        }
    }
    found
}

/// Parses a JSON file with the schema of `found`'s kind. Errors become problems of `found`.
pub(super) fn typed<T: DeserializeOwned>(
    found: &mut Inspection,
    input: &Input,
    to_do: &str,
) -> Option<(T, Map<String, Value>)> {
    let problem = match serde_json::from_slice::<Map<String, Value>>(input.bytes) {
        Err(error) => json_problem(&error, to_do),
        Ok(object) => {
            let schema = object.get("schema").unwrap_or(&Value::Null);
            let is_older = schema == render::merge::TUPLE_SCHEMA_1;
            match schema_of(found.kind).filter(|expected| schema != expected && !is_older) {
                Some(expected) => Problem::new(
                    format!("its schema is {schema}, but this program reads {expected:?}"),
                    "use the version of the program that wrote it",
                ),
                None => match serde_json::from_slice(input.bytes) {
                    Ok(record) => return Some((record, object)),
                    Err(error) => json_problem(&error, to_do),
                },
            }
        }
    };
    found.wrong(problem);
    None
}

fn json_problem(error: &serde_json::Error, to_do: &str) -> Problem {
    let text = error.to_string();
    let reason = text.rsplit_once(" at line ").map_or(text.as_str(), |(reason, _)| reason);
    let what = if error.is_eof() { "it is truncated" } else { "it cannot be read" };
    let place = format!("line {}, column {}", error.line(), error.column());
    Problem::new(format!("{what}: {reason}"), to_do).at(place)
}

/// Parses a record and compares the files beside it with their digests in it.
fn held<D: Digested>(found: &mut Inspection, input: &Input) -> Option<Map<String, Value>> {
    let (record, object) = typed::<D>(found, input, D::TO_DO)?;
    hold_record(found, input, &record);
    Some(object)
}

fn keys_of<T: DeserializeOwned>(
    found: &mut Inspection,
    input: &Input,
) -> Option<Map<String, Value>> {
    let to_do = to_do(found.kind);
    typed::<T>(found, input, to_do).map(|(_, object)| object)
}

/// Parses a TOML table. Replaces nested tables by their keys, and lists of tables by their lengths.
fn toml_table<E: std::fmt::Display>(
    found: &mut Inspection,
    input: &Input,
    parse: impl Fn(&str) -> Result<(), E>,
) -> Option<Map<String, Value>> {
    let text = input.text(found)?;
    if let Err(error) = parse(text) {
        found.wrong(Problem::new(error.to_string(), to_do(found.kind)));
        return None;
    }
    let table: Map<String, Value> = toml::from_str(text).ok()?;
    let keys = |value: Value| match value {
        Value::Object(object) => json!(object.keys().collect::<Vec<_>>()),
        Value::Array(all) if all.iter().any(Value::is_object) => json!(all.len()),
        value => value,
    };
    Some(table.into_iter().map(|(key, value)| (key, keys(value))).collect())
}

/// Summarises a command's output by its keys, or a data set's description by its texts.
fn summary(kind: Kind, object: Map<String, Value>) -> Map<String, Value> {
    if kind == Kind::Croissant {
        let texts = object.into_iter().filter(|(_, value)| value.is_string());
        return texts.collect();
    }
    let keys = json!(object.keys().collect::<Vec<_>>());
    let schema = object.get("schema").cloned().unwrap_or_default();
    [("schema".to_owned(), schema), ("keys".to_owned(), keys)].into_iter().collect()
}

/// Adds keys and values; the rows of a nested object start with its key.
pub(super) fn tell<'a>(
    found: &mut Inspection,
    object: impl IntoIterator<Item = (&'a String, &'a Value)>,
) {
    let known = schema_of(found.kind).is_some();
    for (key, value) in object.into_iter().filter(|(key, _)| !(known && *key == "schema")) {
        let Value::Object(inside) = value else {
            found.facts.value(key, value.clone());
            continue;
        };
        for (name, value) in inside {
            found.facts.say(format!("{key} {name}").replace('_', " "), text_of(value));
        }
        found.facts.put(key, value.clone());
    }
}

/// Checks that the name of an attempt's record matches its content.
fn check_name(found: &mut Inspection, name: &str, object: &Map<String, Value>) {
    let is_other = |(shards, n): ([u32; 2], u32)| {
        object.get("shards") != Some(&json!(shards)) || object.get("n") != Some(&json!(n))
    };
    if found.kind == Kind::Attempt && keys::attempt_of(name).is_some_and(is_other) {
        found.wrong(Problem::new(
            "its name and its content have different shards or numbers",
            "delete it; workers then ignore the attempt",
        ));
    }
}

/// Returns the remedy for a damaged record.
fn to_do(kind: Kind) -> &'static str {
    match kind {
        Kind::Quarantine => "delete it, so that workers try the scene again",
        Kind::Attempt => "nothing: it counts as a lost attempt",
        Kind::Control => "`glasshouse resume RUN` removes it; until then the run is paused",
        Kind::Photographs | Kind::Developed => {
            "delete this folder: `glasshouse develop` makes it again"
        }
        Kind::DepthMaps => "delete this folder: `glasshouse depth` makes it again",
        Kind::Receipt | Kind::MadeBy => "delete it: nothing depends on it",
        Kind::TrainRecipe => "plan the run again into a new folder",
        Kind::Recipe | Kind::DepthRanges => {
            "correct it; manifests/README.md has every key with its range"
        }
        _ => AGAIN,
    }
}

fn advise(found: &mut Inspection, object: &Map<String, Value>) {
    let scene = object.get("scene").and_then(Value::as_str).unwrap_or("SCENE");
    let next = match found.kind {
        Kind::Spec if object["tracer_version"] != TRACER_VERSION => format!(
            "it was planned with tracer version {}, but this program has {TRACER_VERSION}: finish the run with the \
             version that planned it, or plan again into a new folder",
            object["tracer_version"]
        ),
        Kind::Quarantine => format!(
            "correct the cause, then `glasshouse retry RUN {scene}`; `glasshouse explain RUN {scene}` has details"
        ),
        Kind::Attempt => {
            format!("`glasshouse explain RUN {scene}` shows the state of its shards")
        }
        Kind::Control => "`glasshouse resume RUN` continues the run".to_owned(),
        Kind::Recipe => "`glasshouse plan RECIPE -n` estimates the cost of a run".to_owned(),
        Kind::Output => "docs/formats.md describes its fields".to_owned(),
        _ => return,
    };
    found.next.push(next);
}
