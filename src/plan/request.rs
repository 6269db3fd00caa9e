//! Inputs, options and errors of planning.

use super::check::{InvalidInput, invalid_text};
use super::diode::IndexError;
use super::inputs::{InputFiles, StoreUnavailable};
use super::recipe_error::RecipeError;
use glasshouse_line::{ManifestError, RootError, Roots, SceneLine};
use std::collections::BTreeSet;
use std::io;
use std::path::{Path, PathBuf};

/// Inputs and options of [`crate::draft`].
pub struct Request<'a> {
    /// Root folders by name, from the command line.
    pub roots: &'a Roots,
    /// Access to input files, and to roots in object stores.
    pub inputs: &'a dyn InputFiles,
    /// The run's folder, which gets the procedural photographs.
    pub run: &'a Path,
    /// Called before previews write procedural pictures into the run's folder, which the plan keeps. Without it, previews
    /// write nothing, and hold these pictures in memory.
    pub begin_writing: Option<&'a BeginWriting<'a>>,
    /// Names of photographs (for a manifest: ids of scenes) that the plan leaves out from the start.
    pub left_out: BTreeSet<String>,
    /// The run's lines, if it exists. Its plan stays unchanged, even if files cannot be used.
    pub planned: Option<&'a [SceneLine]>,
    /// True if planning checks the input files.
    pub checks_files: bool,
    /// True if the plan leaves out photographs (for a manifest: scenes) with unusable files; if false, a recipe fails.
    pub skip_invalid: bool,
    /// Number of scenes to draw, spread over all, for measurements; `None` draws all.
    pub only: Option<usize>,
    /// Number of threads for checks and previews.
    pub threads: usize,
}

/// A function that prepares the run's folder for writing. Later calls do nothing.
pub type BeginWriting<'a> = dyn Fn() -> io::Result<()> + Sync + 'a;

/// A function that receives progress: (step, done, all).
pub type Progress<'a> = dyn Fn(&'static str, usize, usize) + Sync + 'a;

#[derive(Debug, thiserror::Error)]
pub enum DraftError {
    #[error("cannot read {}: {source}; check the path", path.display())]
    Read { path: PathBuf, source: io::Error },
    #[error("{} is neither a recipe (.toml) nor a manifest (.jsonl)", path.display())]
    Kind { path: PathBuf },
    #[error("{}: {source}", path.display())]
    Recipe { path: PathBuf, source: Box<RecipeError> },
    #[error("{}: {source}", path.display())]
    Manifest { path: PathBuf, source: Box<ManifestError> },
    #[error(
        "{} needs files below {}, but a plan cannot hold this path, because it is not UTF-8: rename the folder, or make \
         a link with another name and give --root {root}=LINK",
        path.display(),
        folder.display()
    )]
    NotText { path: PathBuf, root: String, folder: PathBuf },
    #[error(
        "--root {name}: nothing in {} has this name; it has {}",
        path.display(),
        if known.is_empty() { "no roots".to_owned() } else { known.join(", ") }
    )]
    UnknownRoot { path: PathBuf, name: String, known: Vec<String> },
    /// Drawing ended at the first scenes that differ from those of the run.
    #[error("the recipe {name} describes other scenes than the run")]
    OtherScenes {
        name: String,
        /// The scenes that were drawn.
        lines: Vec<SceneLine>,
        /// Number of scenes in the recipe.
        scenes: usize,
    },
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
