//! Inputs, options and errors of planning.

use super::check::{InvalidInput, invalid_text};
use super::diode::IndexError;
use super::inputs::{InputFiles, StoreUnavailable};
use super::recipe_error::RecipeError;
use render::line::{ManifestError, RootError, Roots};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Inputs and options of [`crate::draft`].
pub struct Request<'a> {
    /// Folders by name, as given by the user.
    pub roots: &'a Roots,
    /// Reads input files and lists roots in object stores.
    pub inputs: &'a dyn InputFiles,
    /// The run's folder; procedural photographs are written below it.
    pub run: &'a Path,
    /// Photographs (of a manifest: scenes) that the plan leaves out from the start.
    pub left_out: BTreeSet<String>,
    /// The run exists: its plan stays, even if files cannot be used.
    pub is_planned: bool,
    /// Whether input files are checked.
    pub checks_files: bool,
    /// Whether the plan leaves out photographs (of a manifest: scenes) with unusable files; otherwise they are an error.
    pub skip_invalid: bool,
    /// Threads for checks and previews.
    pub threads: usize,
}

/// Receives progress: (step, done, all).
pub type Progress<'a> = dyn Fn(&'static str, usize, usize) + Sync + 'a;

#[derive(Debug, thiserror::Error)]
pub enum DraftError {
    #[error("cannot read {}: {source}; check the path", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error("{} is neither a recipe (.toml) nor a manifest (.jsonl)", path.display())]
    Kind { path: PathBuf },
    #[error("{}: {source}", path.display())]
    Recipe { path: PathBuf, source: Box<RecipeError> },
    #[error("{}: {source}", path.display())]
    Manifest { path: PathBuf, source: Box<ManifestError> },
    #[error("{} describes no scene: add scenes to it", path.display())]
    Empty { path: PathBuf },
    #[error(transparent)]
    Index(#[from] IndexError),
    #[error(transparent)]
    Store(#[from] StoreUnavailable),
    #[error(transparent)]
    Root(#[from] RootError),
    #[error("{}{remedy}", invalid_text(invalid, *files))]
    Invalid { invalid: Vec<InvalidInput>, files: usize, remedy: String },
}
