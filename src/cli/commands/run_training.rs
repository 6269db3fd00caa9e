//! `run`, after the tuples: what the recipe's `[train]` says.

use crate::cli::args::Global;
use crate::cli::commands::evaluate::{evaluate_run, evaluation_folder};
use crate::cli::commands::train::{train, train_recipe, training_of};
use crate::cli::exit_code::{Exit, Failure};
use crate::cli::output::Output;
use crate::farm::Run;
use crate::manifest::{Stage, TrainSettings};
use crate::store::Store;
use crate::train::Training;
use serde_json::{Value, json};
use std::path::Path;

/// What `run` says of its training.
pub(super) struct Lesson {
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
) -> Result<Option<Lesson>, Failure> {
    let Some(recipe) = train_recipe(folder)? else {
        return Ok(None);
    };
    let store = Store::local(folder)?;
    let mut object = json!({});
    let stages = [
        (Stage::Backtrack, recipe.backtrack_steps),
        (Stage::Separation, recipe.separation_steps),
    ];
    let mut taken = 0;
    for (stage, steps) in stages {
        if steps == 0 {
            continue;
        }
        let settings = |_: Option<&TrainSettings>| recipe.settings.clone();
        let training = Training {
            // Validation takes longer than a step of small networks.
            checkpoint_every: Some((steps / 4).max(1)),
            ..training_of(run, &store, stage, steps, &settings)
        };
        let (summary, exit) = train(training, global, output)?;
        let (step, of_stage) = summary
            .trained
            .as_ref()
            .map_or((0, 0), |t| (t.step, t.taken));
        object[stage.name()] = json!(summary);
        taken += of_stage;
        if exit != Exit::Done {
            return Ok(Some(Lesson {
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
        return Ok(Some(Lesson {
            object,
            text,
            exit: Exit::Done,
        }));
    }
    let (evaluation, exit) = evaluate_run(folder, global, output)?;
    object["evaluation"] = json!(evaluation);
    Ok(Some(Lesson {
        object,
        text: evaluation.to_string(),
        exit,
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
