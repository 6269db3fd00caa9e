//! `retry RUN SCENE…`

use crate::cli::args::{Global, StoreArgs, parse_scene_id};
use crate::cli::exit_code::{Exit, Failure};
use crate::cli::output::Output;
use crate::cli::target;
use crate::farm::{RetryScenes, retry};
use crate::ids::SceneId;
use crate::manifest::Roots;
use clap::Args as ClapArgs;
use serde_json::json;
use std::path::PathBuf;

#[derive(Debug, ClapArgs)]
pub(super) struct RetryArgs {
    /// Folder of the run
    run: PathBuf,
    /// Scenes to try again
    #[arg(value_name = "SCENE", value_parser = parse_scene_id, required_unless_present = "all")]
    scenes: Vec<SceneId>,
    /// All that are in quarantine
    #[arg(long, conflicts_with = "scenes")]
    all: bool,
    /// The scenes named, also those that are done: what was made of them is removed, and they are traced from nothing
    #[arg(long, conflicts_with = "all")]
    anew: bool,
    #[command(flatten)]
    store: StoreArgs,
}

/// Scenes whose names are printed.
const SHOWN: usize = 20;

pub(super) fn run(args: &RetryArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let (run, store) = target::open(&args.run, args.store.store.as_deref(), &Roots::default())?;
    let manifest: Vec<_> = run.lines.iter().map(|line| line.id.clone()).collect();
    let which = if args.all {
        RetryScenes::All
    } else if args.anew {
        RetryScenes::Anew(&args.scenes)
    } else {
        RetryScenes::These(&args.scenes)
    };
    let retried = retry(&store, &manifest, which, global.dry_run)?;
    let names: Vec<&str> = retried.scenes.iter().map(SceneId::as_str).collect();
    let text = if names.is_empty() {
        "nothing is in quarantine".to_owned()
    } else {
        let more = match names.len().saturating_sub(SHOWN) {
            0 => String::new(),
            n => format!(" and {n} more"),
        };
        let next = if retried.was_finished || args.store.store.is_none() {
            "start `glasshouse work` (of a farm `coordinate`, too) again"
        } else {
            "a coordinator that runs publishes them within seconds, else start it again"
        };
        let what = if args.anew {
            format!(
                "reset, with {} files of tuples, partials and receipts",
                retried.results
            )
        } else {
            "taken out of quarantine".to_owned()
        };
        format!(
            "{} {} {what}, with {} records of attempts: {}{more}\n{next}",
            names.len(),
            if global.dry_run { "would be" } else { "were" },
            retried.attempts,
            names[..names.len().min(SHOWN)].join(" "),
        )
    };
    output.result(
        "glasshouse.retry/1",
        json!({
            "run": args.run, "dry_run": global.dry_run, "retried": retried.scenes,
            "attempts_removed": retried.attempts, "results_removed": retried.results, "was_finished": retried.was_finished,
        }),
        &text,
    );
    Ok(Exit::Done)
}
