//! Recipes, hard cases and tables of depth ranges: what is written by hand, in TOML.

use super::facts::{Inspection, Problem, many};
use super::kind::Kind;
use super::look::Input;
use plan::cases::CaseFile;
use plan::{DepthRanges, Recipe};
use serde_json::json;

/// What to do about a mistake.
const CORRECT: &str = "correct it; manifests/README.md has every key with its range";

pub(super) fn read(kind: Kind, input: &Input) -> Inspection {
    let mut found = Inspection::new(kind);
    let Some(text) = input.text(&mut found) else {
        return found;
    };
    let read = match kind {
        Kind::HardCases => cases(&mut found, text),
        Kind::DepthRanges => ranges(&mut found, text),
        _ => recipe(&mut found, text),
    };
    match read {
        Ok(()) => found.may_be_whole(
            "every key is known and in its range; what is written by hand has no digest",
        ),
        Err(reason) => found.wrong(Problem::new(reason, CORRECT)),
    }
    found
}

fn recipe(found: &mut Inspection, text: &str) -> Result<(), String> {
    let recipe = Recipe::parse(text).map_err(|e| e.to_string())?;
    let facts = &mut found.facts;
    facts.fact("name", recipe.name.as_str(), recipe.name.as_str());
    facts.fact("seed", recipe.seed.to_string(), recipe.seed);
    for split in &recipe.splits {
        let scenes: u64 = split.pairs.values().map(|&n| u64::from(n)).sum();
        let pairs: Vec<String> = split
            .pairs
            .iter()
            .map(|(name, n)| format!("{n} of {name}"))
            .collect();
        let text = format!("{}: {}", many(scenes, "scene"), pairs.join(", "));
        facts.fact(&split.name.to_string(), text, json!(split.pairs));
    }
    for (name, source) in &recipe.sources {
        let layout = format!("{:?}", source.layout).to_lowercase();
        facts.say("source", format!("{name}, layout {layout}"));
    }
    facts.put("sources", json!(recipe.sources.keys().collect::<Vec<_>>()));
    let drawn: Vec<String> = recipe.params().into_iter().map(|(name, _)| name).collect();
    facts.put("parameters", json!(drawn));
    if let Some(train) = &recipe.train {
        let text = format!(
            "{} steps of BT-net, {} of SP-net",
            train.backtrack_steps, train.separation_steps
        );
        facts.fact(
            "training",
            text,
            json!([train.backtrack_steps, train.separation_steps]),
        );
    }
    found
        .next
        .push("`glasshouse plan RECIPE -n` says what a run of it takes".to_owned());
    Ok(())
}

fn cases(found: &mut Inspection, text: &str) -> Result<(), String> {
    let file = CaseFile::parse(text).map_err(|e| e.to_string())?;
    found
        .facts
        .fact("name", file.name.as_str(), file.name.as_str());
    found
        .facts
        .fact("cases", file.cases.len().to_string(), file.cases.len());
    found.next.push(
        "`glasshouse run FILE` renders them and holds them against what is expected".to_owned(),
    );
    Ok(())
}

fn ranges(found: &mut Inspection, text: &str) -> Result<(), String> {
    let table = DepthRanges::parse(text).map_err(|e| e.to_string())?;
    let names: Vec<&String> = table.category.keys().collect();
    found
        .facts
        .fact("categories", names.len().to_string(), json!(names));
    Ok(())
}
