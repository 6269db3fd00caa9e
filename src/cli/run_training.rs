//! `run`, after the tuples: what the recipe's `[train]` says.

use super::args::Global;
use super::evaluate_cmd::{evaluate, evaluation_folder};
use super::exit_code::{Exit, Failure};
use super::output::Output;
use super::train_args::{EvaluateArgs, StageName, TrainArgs};
use super::train_cmd::{train, train_recipe};
use crate::run::Run;
use crate::store::Store;
use serde_json::{Value, json};
use std::path::Path;

/// What `run` says of its training.
pub(super) struct Training {
    pub(super) object: Value,
    pub(super) text: String,
    pub(super) exit: Exit,
}

/// Both stages and the scores; `None` if the recipe has no `[train]`.
pub(super) fn training(
    folder: &Path,
    run: &Run,
    global: &Global,
    output: &Output,
) -> Result<Option<Training>, Failure> {
    let Some(recipe) = train_recipe(folder)? else {
        return Ok(None);
    };
    let store = Store::local(folder)?;
    let mut object = json!({});
    let stages = [
        (StageName::Backtrack, recipe.backtrack_steps),
        (StageName::Separation, recipe.separation_steps),
    ];
    let mut taken = 0;
    for (stage, steps) in stages {
        if steps == 0 {
            continue;
        }
        let args = TrainArgs::of_recipe(folder, stage, steps, &recipe.settings);
        let (trained, of_stage, exit) = train(&args, run, &store, global, output)?;
        let name = of_stage["stage"].as_str().unwrap_or_default().to_owned();
        object[name] = of_stage;
        taken += trained.as_ref().map_or(0, |trained| trained.taken);
        if exit != Exit::Done {
            let step = trained.map_or(0, |trained| trained.step);
            return Ok(Some(Training {
                object,
                text: format!("training stopped at step {step}; the same command goes on"),
                exit,
            }));
        }
    }
    if taken == 0
        && let Some((evaluation, text)) = scored_before(folder)
    {
        object["evaluation"] = evaluation;
        return Ok(Some(Training {
            object,
            text,
            exit: Exit::Done,
        }));
    }
    let evaluated = evaluate(&EvaluateArgs::of_run(folder), global, output)?;
    object["evaluation"] = evaluated.object;
    Ok(Some(Training {
        object,
        text: evaluated.text,
        exit: evaluated.exit,
    }))
}

/// What was scored when the training ended.
fn scored_before(run: &Path) -> Option<(Value, String)> {
    let file = |ending: &str| {
        std::fs::read_to_string(evaluation_folder(run).join(format!("evaluation.{ending}")))
    };
    let json: Value = serde_json::from_str(&file("json").ok()?).ok()?;
    // What was left out may be there now.
    if !json["left_out"].as_array()?.is_empty() {
        return None;
    }
    let text = file("md").ok()?;
    Some((
        json,
        text.trim_start_matches("# Evaluation").trim().to_owned(),
    ))
}
