//! The training of `run`, with the settings of the recipe's `[train]` table.

use crate::cli::args::Global;
use crate::cli::commands::evaluate::{evaluate_run, evaluation_folder};
use crate::cli::commands::train::{train, train_recipe, training_of};
use crate::cli::exit_code::{Exit, Failure, failure};
use crate::cli::freed_memory;
use crate::cli::output::Output;
use crate::run::Run;
use crate::store::Store;
use plan::{Recipe, SeededTraining, Stage, TrainSettings};
use serde::Serialize;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt;
use std::num::NonZeroU64;
use std::path::Path;
use train::{Evaluation, TrainSummary, Training};

/// Summaries of the trained stages, by their folders in `train`, and the scores.
#[derive(Serialize)]
pub(super) struct Trained {
    #[serde(flatten)]
    stages: BTreeMap<String, TrainSummary>,
    /// `None` if a signal stopped the training.
    #[serde(skip_serializing_if = "Option::is_none")]
    evaluation: Option<Scores>,
    #[serde(skip)]
    pub(super) exit: Exit,
}

#[derive(Serialize)]
#[serde(untagged)]
enum Scores {
    New(Box<Evaluation>),
    /// `evaluation.json` and `evaluation.md` of an earlier call.
    Kept {
        #[serde(flatten)]
        json: Value,
        #[serde(skip)]
        text: String,
    },
}

impl fmt::Display for Trained {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.evaluation {
            Some(Scores::New(evaluation)) => evaluation.fmt(f),
            Some(Scores::Kept { text, .. }) => f.write_str(text),
            None => {
                let steps = self.stages.values().filter_map(|s| s.trained.as_ref());
                let stopped = steps.filter(|trained| trained.stopped).map(|trained| trained.step);
                let step = stopped.max().unwrap_or(0);
                write!(f, "training stopped at step {step}; run the same command to resume")
            }
        }
    }
}

/// Trains the stages that have steps in the recipe, and scores the networks; returns `None` without `[train]`.
pub(super) fn training(
    folder: &Path,
    run: &Run,
    global: &Global,
    output: &Output,
) -> Result<Option<Trained>, Failure> {
    let Some(trainings) = train_recipe(folder)? else {
        return Ok(None);
    };
    let store = Store::local(folder)?;
    let mut trained = Trained { stages: BTreeMap::new(), evaluation: None, exit: Exit::Done };
    let mut steps_taken = 0;
    for (training, stage, steps) in trainings.seeded().iter().flat_map(stages) {
        if let Some(name) = &training.name {
            output.note(&format!("training {name}, {}", stage.name()));
        }
        let settings = |_: Option<&TrainSettings>| training.settings.clone();
        let of_stage = Training {
            name: training.name.clone(),
            features: training.features.clone(),
            // A validation takes longer than a step of small networks, so only about four take place.
            checkpoint_every: Some(
                training.checkpoint_every.map_or((steps / 4).max(1), NonZeroU64::get),
            ),
            ..training_of(run, &store, stage, steps, &settings)
        };
        let (summary, exit) = train(of_stage, global, output)?;
        freed_memory::release();
        steps_taken += summary.trained.as_ref().map_or(0, |trained| trained.taken);
        let name = training.name.iter().map(String::as_str).chain([stage.name()]);
        trained.stages.insert(name.collect::<Vec<_>>().join("/"), summary);
        if exit != Exit::Done {
            trained.exit = exit;
            return Ok(Some(trained));
        }
    }
    trained.evaluation = if steps_taken == 0 { earlier_scores(folder) } else { None };
    if trained.evaluation.is_none() {
        let (evaluation, exit) = evaluate_run(folder, global, output)?;
        trained.evaluation = Some(Scores::New(Box::new(evaluation)));
        trained.exit = exit;
    }
    Ok(Some(trained))
}

/// Fails if a training of the recipe needs a file of features that does not exist, before any scene is traced.
pub(super) fn check_features(recipe: &Path) -> Result<(), Failure> {
    // Planning reports a recipe that cannot be read, and a list of scenes has no trainings.
    let text = render::input_file::read_to_string(recipe).unwrap_or_default();
    let Some(trainings) = Recipe::parse(&text).ok().and_then(|recipe| recipe.train) else {
        return Ok(());
    };
    let folder = recipe.parent().unwrap_or(Path::new(""));
    for features in trainings.0.iter().filter_map(|training| training.features.as_ref()) {
        let path = folder.join(features);
        if !path.is_file() {
            return Err(failure!(
                Exit::InvalidInput,
                "{} is missing, and [train] of {} needs it: docs/training.md shows how to make VGG-19's weights; `glasshouse plan` and `glasshouse work` make tuples without training",
                path.display(),
                recipe.display()
            ));
        }
    }
    Ok(())
}

/// Lists the stages of a training that have steps.
fn stages(training: &SeededTraining) -> impl Iterator<Item = (&SeededTraining, Stage, u64)> {
    let SeededTraining { backtrack_steps, separation_steps, .. } = training;
    [(Stage::Backtrack, *backtrack_steps), (Stage::Separation, *separation_steps)]
        .into_iter()
        .filter(|(_, steps)| *steps > 0)
        .map(move |(stage, steps)| (training, stage, steps))
}

/// Reads the scores of an earlier call; `None` if files are missing or the scores are incomplete.
fn earlier_scores(run: &Path) -> Option<Scores> {
    let file = |ending: &str| {
        render::input_file::read_to_string(
            &evaluation_folder(run).join(format!("evaluation.{ending}")),
        )
    };
    let json: Value = serde_json::from_str(&file("json").ok()?).ok()?;
    // Pictures that were unreadable may be readable now, so `run` must score again.
    if !json["left_out"].as_array()?.is_empty() {
        return None;
    }
    let text = file("md").ok()?.trim_start_matches("# Evaluation").trim().to_owned();
    Some(Scores::Kept { json, text })
}
