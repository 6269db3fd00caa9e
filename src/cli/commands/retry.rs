//! `retry RUN SCENE…`: takes scenes out of quarantine or resets them.

use crate::cli::args::{Global, StoreArgs, parse_scene_id};
use crate::cli::exit_code::{Exit, Failure};
use crate::cli::output::Output;
use crate::cli::target;
use crate::run::{Retried, RetryScenes, retry};
use clap::Args as ClapArgs;
use glasshouse_line::Roots;
use glasshouse_line::ids::SceneId;
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};

#[derive(Debug, ClapArgs)]
pub(super) struct RetryArgs {
    /// Folder of the run
    run: PathBuf,
    /// Scenes to try again
    #[arg(value_name = "SCENE", value_parser = parse_scene_id, required_unless_present = "all")]
    scenes: Vec<SceneId>,
    /// Try all scenes in quarantine again
    #[arg(long, conflicts_with = "scenes")]
    all: bool,
    /// Reset the named scenes, even finished ones: remove all their results, so that workers make them again
    #[arg(long, conflicts_with = "all")]
    anew: bool,
    #[command(flatten)]
    store: StoreArgs,
}

/// Largest number of printed scenes.
const SHOWN: usize = 20;

pub(super) fn run(args: &RetryArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let (run, store) =
        target::open_to_work(&args.run, args.store.store.as_deref(), &Roots::default())?;
    let manifest: Vec<_> = run.lines.iter().map(|line| line.id.clone()).collect();
    let which = if args.all {
        RetryScenes::All
    } else if args.anew {
        RetryScenes::Anew(&args.scenes)
    } else {
        RetryScenes::These(&args.scenes)
    };
    let retried = retry(&store, &manifest, which, global.dry_run)?;
    let shown = Shown {
        run: &args.run,
        dry_run: global.dry_run,
        retried,
        is_anew: args.anew,
        is_local: args.store.store.is_none(),
    };
    output.show("glasshouse.retry/1", &shown);
    Ok(Exit::Done)
}

#[derive(Serialize)]
struct Shown<'a> {
    #[serde(serialize_with = "render::path_text::one")]
    run: &'a Path,
    dry_run: bool,
    #[serde(flatten)]
    retried: Retried,
    #[serde(skip)]
    is_anew: bool,
    #[serde(skip)]
    is_local: bool,
}

impl fmt::Display for Shown<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Retried { scenes, attempts, results, was_finished } = &self.retried;
        if scenes.is_empty() {
            return f.write_str("the quarantine is empty");
        }
        let were = if self.dry_run { "would be" } else { "were" };
        write!(f, "{} {were} ", scenes.len())?;
        if self.is_anew {
            write!(f, "reset, with {results} files of tuples, partials and receipts")?;
        } else {
            f.write_str("taken out of quarantine")?;
        }
        write!(f, ", with {attempts} records of attempts:")?;
        for scene in scenes.iter().take(SHOWN) {
            write!(f, " {scene}")?;
        }
        if let Some(more @ 1..) = scenes.len().checked_sub(SHOWN) {
            write!(f, " and {more} more")?;
        }
        f.write_str(if *was_finished || self.is_local {
            "\nstart `glasshouse work` again (in a farm, also `coordinate`)"
        } else {
            "\na running coordinator publishes these scenes within seconds; if none is running, start one"
        })
    }
}
