//! `merge RUN`

use super::args::{Global, MergeArgs};
use super::exit_code::{Exit, Failure};
use super::output::Output;
use super::progress::Progress;
use super::store_env::store_options;
use super::target;
use crate::farm::merge_run;
use crate::run::Run;
use crate::store::Store;
use render::line::Roots;
use serde_json::json;

/// Scenes whose reasons are printed.
const SHOWN: usize = 10;

pub(super) fn run(args: &MergeArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let address = args.store.as_ref();
    let store = address.map(|address| Store::open(address, &store_options()));
    let store = store.transpose()?;
    if let Some(store) = &store {
        target::fetch(&args.run, store)?;
    }
    let run = Run::open(&args.run, &Roots::default())?;
    let progress = Progress::new(global, "scenes", run.lines.len() as u64);
    let outcome = merge_run(&run, store.as_ref(), global.dry_run, &|| {
        progress.add(1, false);
    });
    progress.finish();
    let outcome = outcome?;
    for (_, reason) in outcome.refused.iter().take(SHOWN) {
        output.warning(reason);
    }
    if outcome.refused.len() > SHOWN {
        output.warning(&format!(
            "... and {} more; --json lists all",
            outcome.refused.len() - SHOWN
        ));
    }
    let verb = if global.dry_run {
        "would be merged"
    } else {
        "merged"
    };
    let refused: Vec<_> = outcome
        .refused
        .iter()
        .map(|(s, r)| json!({ "scene": s, "reason": r }))
        .collect();
    output.result(
        "glasshouse.merge/1",
        json!({
            "run": args.run, "dry_run": global.dry_run, "merged": outcome.merged,
            "already_merged": outcome.already_merged, "refused": refused,
        }),
        &format!(
            "{} scenes {verb}, {} were before, {} cannot be",
            outcome.merged.len(),
            outcome.already_merged,
            outcome.refused.len()
        ),
    );
    Ok(if outcome.refused.is_empty() {
        Exit::Done
    } else {
        Exit::Incomplete
    })
}
