//! Lists, one JSON object a line: photographs for a recipe, scenes that were not kept, samples of an exported set.

use super::facts::{Inspection, Problem, first_of, many};
use super::kind::Kind;
use super::look::{AGAIN, Input};
use plan::RejectedScene;
use plan::parse_list;
use serde_json::{Value, json};
use std::collections::BTreeMap;

pub(super) fn read(kind: Kind, input: &Input) -> Inspection {
    let mut found = Inspection::new(kind);
    let Some(text) = input.text(&mut found) else {
        return found;
    };
    match kind {
        Kind::PhotographList => match parse_list(text) {
            Ok(images) => found.facts.fact(
                "photographs",
                many(images.len() as u64, "photograph"),
                images.len(),
            ),
            Err(error) => found.wrong(Problem::new(error.to_string(), "correct that line")),
        },
        Kind::Rejected => rejected(&mut found, text),
        _ => samples(&mut found, text),
    }
    found.may_be_whole("every line can be read; lists have no digest");
    found
}

/// The lines of a list, each parsed; the first bad one is a problem.
fn lines<T: serde::de::DeserializeOwned>(found: &mut Inspection, text: &str) -> Vec<T> {
    let mut read = Vec::new();
    for (index, line) in text
        .lines()
        .enumerate()
        .filter(|(_, line)| !line.trim().is_empty())
    {
        match serde_json::from_str(line) {
            Ok(value) => read.push(value),
            Err(error) => {
                let problem = Problem::new(format!("it cannot be read: {error}"), AGAIN);
                found.wrong(problem.at(format!("line {}", index + 1)));
                break;
            }
        }
    }
    read
}

fn rejected(found: &mut Inspection, text: &str) {
    let scenes: Vec<RejectedScene> = lines(found, text);
    let mut rules: BTreeMap<&str, u64> = BTreeMap::new();
    for scene in &scenes {
        *rules.entry(&scene.rule).or_default() += 1;
    }
    found
        .facts
        .fact("draws", many(scenes.len() as u64, "draw"), scenes.len());
    for (rule, count) in &rules {
        found.facts.say("rule", format!("{rule}: {count}"));
    }
    found.facts.put("rules", json!(rules));
}

fn samples(found: &mut Inspection, text: &str) {
    let samples: Vec<Value> = lines(found, text);
    found.facts.fact(
        "samples",
        many(samples.len() as u64, "sample"),
        samples.len(),
    );
    let columns: Vec<&String> = samples
        .first()
        .and_then(Value::as_object)
        .map(|o| o.keys().collect())
        .unwrap_or_default();
    found
        .facts
        .fact("columns", first_of(&columns, 12), json!(columns));
    let odd = samples.iter().position(|sample| {
        let keys = sample.as_object().map(serde_json::Map::len);
        keys != Some(columns.len())
    });
    if let Some(odd) = odd {
        let problem = Problem::new("it has other columns than the first sample", AGAIN);
        found.wrong(problem.at(format!("sample {}", odd + 1)));
    }
}
