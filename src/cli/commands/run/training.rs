//! `run`, after the tuples: what the recipe's `[train]` says.

use crate::cli::args::Global;
use crate::cli::commands::evaluate::{evaluate_run, evaluation_folder};
use crate::cli::commands::train::{train, train_recipe, training_of};
use crate::cli::exit_code::{Exit, Failure};
use crate::cli::output::Output;
use crate::run::Run;
use crate::store::Store;
use plan::{Stage, TrainSettings};
use serde::{Serialize, Serializer};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;
use train::{Evaluation, TrainSummary, Training};

/// What `run` says of its training.
#[derive(Serialize)]
pub(super) struct Lesson {
    #[serde(flatten)]
    stages: BTreeMap<&'static str, TrainSummary>,
    /// `None` where a signal stopped the training.
    #[serde(skip_serializing_if = "Option::is_none")]
    evaluation: Option<Scores>,
    #[serde(skip)]
    pub(super) exit: Exit,
}

enum Scores {
    New(Box<Evaluation>),
    /// `evaluation.json` and `evaluation.md` of an earlier call.
    Kept(Value, String),
}

impl Serialize for Scores {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::New(evaluation) => evaluation.serialize(serializer),
            Self::Kept(json, _) => json.serialize(serializer),
        }
    }
}

impl fmt::Display for Lesson {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.evaluation {
            Some(Scores::New(evaluation)) => evaluation.fmt(f),
            Some(Scores::Kept(_, text)) => f.write_str(text),
            None => {
                let steps = self.stages.values().filter_map(|s| s.trained.as_ref());
                let stopped = steps.filter(|trained| trained.stopped).map(|trained| trained.step);
                let step = stopped.max().unwrap_or(0);
                write!(f, "training stopped at step {step}; the same command goes on")
            }
        }
    }
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
    let mut lesson = Lesson { stages: BTreeMap::new(), evaluation: None, exit: Exit::Done };
    let stages =
        [(Stage::Backtrack, recipe.backtrack_steps), (Stage::Separation, recipe.separation_steps)];
    let mut taken = 0;
    for (stage, steps) in stages.into_iter().filter(|(_, steps)| *steps > 0) {
        let settings = |_: Option<&TrainSettings>| recipe.settings.clone();
        let training = Training {
            // Validation takes longer than a step of small networks.
            checkpoint_every: Some((steps / 4).max(1)),
            ..training_of(run, &store, stage, steps, &settings)
        };
        let (summary, exit) = train(training, global, output)?;
        taken += summary.trained.as_ref().map_or(0, |trained| trained.taken);
        lesson.stages.insert(stage.name(), summary);
        if exit != Exit::Done {
            lesson.exit = exit;
            return Ok(Some(lesson));
        }
    }
    lesson.evaluation = if taken == 0 { scored_before(folder) } else { None };
    if lesson.evaluation.is_none() {
        let (evaluation, exit) = evaluate_run(folder, global, output)?;
        lesson.evaluation = Some(Scores::New(Box::new(evaluation)));
        lesson.exit = exit;
    }
    Ok(Some(lesson))
}

/// What was scored when the training ended.
fn scored_before(run: &Path) -> Option<Scores> {
    let file = |ending: &str| {
        std::fs::read_to_string(evaluation_folder(run).join(format!("evaluation.{ending}")))
    };
    let json: Value = serde_json::from_str(&file("json").ok()?).ok()?;
    // What was left out may be there now.
    if !json["left_out"].as_array()?.is_empty() {
        return None;
    }
    let text = file("md").ok()?;
    let text = text.trim_start_matches("# Evaluation").trim();
    Some(Scores::Kept(json, text.to_owned()))
}
