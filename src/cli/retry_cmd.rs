//! `retry RUN SCENE…`

use super::args::Global;
use super::exit_code::{Exit, Failure};
use super::farm_args::RetryArgs;
use super::output::Output;
use super::target;
use crate::run::{RetryScenes, retry};
use render::ids::SceneId;
use render::line::Roots;
use serde_json::json;

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
