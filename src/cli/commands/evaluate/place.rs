//! The pictures of a run, of a folder of pairs or of an index.

use super::EvaluateArgs;
use crate::cli::args::SplitName;
use crate::cli::exit_code::{Exit, Failure, failure};
use crate::cli::network::is_run;
use crate::cli::output::Output;
use crate::cli::target;
use compose::{IndexedPairs, LeftOut, Pair, Subject, find_pairs, read_index};
use glasshouse_line::Roots;
use plan::PixelSource;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use train::{TrainedOn, TupleSource};

/// A run or a folder of pairs.
#[derive(Clone, Copy)]
pub(super) struct Place<'a> {
    pub(super) folder: &'a Path,
    store: Option<&'a str>,
    pub(super) is_run: bool,
}

pub(super) struct Pictures {
    of: Source,
    /// Files, folders and rows of an index that are no pair to score.
    pub(super) left_out: Vec<LeftOut>,
}

enum Source {
    Run(TupleSource),
    Pairs(Vec<Pair>),
    Index(IndexedPairs),
}

impl Pictures {
    pub(super) fn subject(&self) -> &dyn Subject {
        match &self.of {
            Source::Run(source) => source,
            Source::Pairs(pairs) => pairs,
            Source::Index(pairs) => pairs,
        }
    }

    /// Fails if a tuple of the run changed since a network of the run was trained with it.
    pub(super) fn check_trainings(&self, run: &Path, networks: &[&Path]) -> Result<(), Failure> {
        let Source::Run(source) = &self.of else { return Ok(()) };
        let real = |path: &Path| path.canonicalize().unwrap_or_else(|_| path.to_owned());
        let run = real(run);
        let stages: BTreeSet<PathBuf> =
            networks.iter().filter_map(|path| real(path).parent().map(Path::to_owned)).collect();
        for stage in stages.iter().filter(|stage| stage.starts_with(&run)) {
            if let Some(tuples) = TrainedOn::read(stage)? {
                tuples.check(stage, &*source.files)?;
            }
        }
        Ok(())
    }

    pub(super) fn keep_first(&mut self, count: usize) {
        match &mut self.of {
            Source::Run(source) => source.lines.truncate(count),
            Source::Pairs(pairs) => pairs.truncate(count),
            Source::Index(pairs) => pairs.truncate(count),
        }
    }

    /// Reads an index. Its paths start from `folder` or, without one, from the index's own folder.
    pub(super) fn of_index(
        index: &Path,
        folder: Option<&Path>,
        output: &Output,
    ) -> Result<Self, Failure> {
        let root = folder.or(index.parent()).unwrap_or(Path::new(""));
        let (pairs, left_out) =
            read_index(index, root).map_err(|e| Failure::new(Exit::InvalidInput, e))?;
        say_left_out(&left_out, "rows of the index are not real and aligned", output);
        Ok(Self { of: Source::Index(pairs), left_out })
    }
}

impl<'a> Place<'a> {
    /// Returns the run or folder on the command line; `None` for an index alone.
    pub(super) fn of_args(args: &'a EvaluateArgs) -> Option<Self> {
        let (folder, store) = (args.place.as_deref()?, args.store.as_deref());
        // The spec and manifest of a run that exists only in the store are copied later.
        let is_in_store = store.is_some() && !folder.exists();
        Some(Self { folder, store, is_run: is_run(folder) || is_in_store })
    }

    pub(super) fn new(folder: &'a Path) -> Self {
        Self { folder, store: None, is_run: is_run(folder) }
    }

    /// Finds the pictures of a run's split, in the files `pixels` of its tuples, or those of a folder.
    pub(super) fn pictures(
        &self,
        split: SplitName,
        pixels: PixelSource,
        output: &Output,
    ) -> Result<Pictures, Failure> {
        if self.is_run {
            let (run, store) = target::open(self.folder, self.store, &Roots::default())?;
            let lines = run.lines.iter().filter(|line| split.has(line.split));
            let source =
                TupleSource { files: Arc::new(store), lines: lines.cloned().collect(), pixels };
            return Ok(Pictures { of: Source::Run(source), left_out: Vec::new() });
        }
        let found = find_pairs(self.folder).map_err(|e| Failure::new(Exit::InvalidInput, e))?;
        let left_out = found.left_out.into_iter().map(|(path, reason)| {
            let path = path.strip_prefix(self.folder).unwrap_or(&path);
            let image = path.display().to_string();
            LeftOut { image, reason, is_damaged: false }
        });
        let left_out: Vec<LeftOut> = left_out.collect();
        say_left_out(&left_out, "pictures belong to no pair", output);
        Ok(Pictures { of: Source::Pairs(found.pairs), left_out })
    }
}

fn say_left_out(left_out: &[LeftOut], what: &str, output: &Output) {
    if !left_out.is_empty() {
        let more = if output.verbose { ":" } else { "; -v prints why" };
        output.note(&format!("{} {what}{more}", left_out.len()));
    }
    if output.verbose {
        for LeftOut { image, reason, .. } in left_out {
            output.note(&format!("{image}: {reason}"));
        }
    }
}

/// Finds the pictures that the command line names.
pub(super) fn pictures(args: &EvaluateArgs, output: &Output) -> Result<Pictures, Failure> {
    let place = Place::of_args(args);
    let mut pictures = match (&args.index, &place) {
        (Some(index), place) => {
            // A run has networks and training examples, but no folder of an index's pictures.
            let folder = place.filter(|place| !place.is_run).map(|place| place.folder);
            Pictures::of_index(index, folder, output)?
        }
        (None, Some(place)) => place.pictures(args.split, args.pixels.into(), output)?,
        (None, None) => return Err(failure!(Exit::Usage, "give RUN, DIR or --index FILE.csv")),
    };
    if let Some(limit) = args.limit {
        pictures.keep_first(limit as usize);
    }
    if pictures.subject().count() == 0 {
        return Err(failure!(
            Exit::InvalidInput,
            "{} has no scenes of the split {:?}; give another --split",
            name(args),
            args.split.name()
        ));
    }
    Ok(pictures)
}

/// Returns what is scored as text.
pub(super) fn name(args: &EvaluateArgs) -> String {
    let path = args.index.as_deref().or(args.place.as_deref());
    path.unwrap_or(Path::new("")).display().to_string()
}

/// Returns the folder for the scores; `None` if they are only printed.
pub(super) fn out(args: &EvaluateArgs) -> Option<PathBuf> {
    let of_run = || {
        let run = Place::of_args(args).filter(|place| place.is_run && args.index.is_none());
        run.map(|run| evaluation_folder(run.folder))
    };
    args.out.clone().or_else(of_run)
}

pub(in crate::cli::commands) fn evaluation_folder(run: &Path) -> PathBuf {
    run.join("train").join("evaluation")
}
