//! `merge RUN`: merges partials into tuples.

use crate::cli::args::{FARM, Global};
use crate::cli::exit_code::{Exit, Failure};
use crate::cli::output::{Output, reasons};
use crate::cli::progress::Progress;
use crate::cli::queue;
use crate::cli::store_env::store_options;
use crate::cli::target;
use crate::farm::{MergeOutcome, merge_run};
use crate::run::{Run, WorkerName};
use crate::store::Store;
use clap::Args as ClapArgs;
use glasshouse_line::Roots;
use glasshouse_line::ids::SceneId;
use serde::Serialize;
use std::borrow::Cow;
use std::fmt;
use std::path::PathBuf;

#[derive(Debug, ClapArgs)]
pub(super) struct MergeArgs {
    /// Folder of the run
    run: PathBuf,
    /// Store of the run's objects, if not RUN: a folder, or s3://BUCKET/PREFIX
    #[arg(long, value_name = "URL", env = "GLASSHOUSE_STORE", help_heading = FARM)]
    store: Option<String>,
}

/// Largest number of printed reasons.
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
    let who = WorkerName { worker: queue::worker_name(), host: queue::host_name() };
    let outcome = merge_run(&run, store.as_ref(), global.dry_run, &who, &|| {
        progress.add(1, false);
    });
    progress.finish();
    let MergeOutcome { merged, already_merged, refused } = outcome?;
    for (_, reason) in refused.iter().take(SHOWN) {
        output.warning(reason);
    }
    if let Some(more @ 1..) = refused.len().checked_sub(SHOWN) {
        output.warning(&format!("... and {more} more; --json lists all"));
    }
    let exit = if refused.is_empty() { Exit::Done } else { Exit::Incomplete };
    let summary = Summary {
        run: args.run.to_string_lossy(),
        dry_run: global.dry_run,
        merged,
        already_merged,
        refused,
    };
    output.show("glasshouse.merge/1", &summary);
    Ok(exit)
}

#[derive(Serialize)]
struct Summary<'a> {
    run: Cow<'a, str>,
    dry_run: bool,
    merged: Vec<SceneId>,
    already_merged: u64,
    #[serde(serialize_with = "reasons")]
    refused: Vec<(SceneId, String)>,
}

impl fmt::Display for Summary<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} scenes {}merged, {} already merged, {} refused",
            self.merged.len(),
            if self.dry_run { "would be " } else { "" },
            self.already_merged,
            self.refused.len()
        )
    }
}
