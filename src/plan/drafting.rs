//! A recipe or a manifest becomes scene lines whose input files are sound.

use super::check::{Checker, InvalidInput, invalid_text};
use super::content::{self, Content, Draft, Made};
use super::draw_scenes::RejectedScene;
use super::inputs::{InputFiles, StoreUnavailable};
use super::{IndexError, RecipeError};
use render::ids::SceneId;
use render::line::{ManifestError, RootError, Roots, SceneLine};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// How to draft.
pub struct Request<'a> {
    /// Folders by name, as the user gave them.
    pub roots: &'a Roots,
    /// Reads input files and lists roots that are in an object store.
    pub inputs: &'a dyn InputFiles,
    /// The run's folder: procedural photographs are made below it.
    pub run: &'a Path,
    /// Photographs (of a manifest: scenes) that are left out from the start.
    pub left_out: BTreeSet<String>,
    /// The run exists: its plan stays as it is, whatever is wrong with the files.
    pub is_planned: bool,
    /// Check input files.
    pub checks_files: bool,
    /// Leave out photographs whose files cannot be used (of a manifest: scenes), and go on.
    pub skip_invalid: bool,
    /// Threads that check input files and make procedural photographs.
    pub threads: usize,
}

/// Receives progress: (what, done, all).
pub type Tell<'a> = dyn Fn(&'static str, usize, usize) + Sync + 'a;

/// Scenes with their files checked; nothing is written yet.
#[derive(Debug)]
pub struct Drafted {
    /// The recipe's name, or the manifest's.
    pub name: String,
    /// Root folders; relative ones lie below the run's folder.
    pub roots: BTreeMap<String, PathBuf>,
    /// The scenes.
    pub lines: Vec<SceneLine>,
    /// What a reader should know: images without depth, scenes paired less well than wished.
    pub notes: Vec<String>,
    /// Draws that a preview rejected.
    pub rejected: Vec<RejectedScene>,
    /// Files that cannot be used, by path.
    pub invalid: Vec<InvalidInput>,
    /// Number of input files that were checked.
    pub files: usize,
    /// What `left_out` names: "photographs" or "scenes".
    pub parts: &'static str,
    /// Photographs or scenes that are left out.
    pub left_out: BTreeSet<String>,
    /// Size of the input files together; `None` if they were not checked.
    pub input_bytes: Option<u64>,
    /// Procedural photographs to make.
    pub made: Vec<Made>,
}

/// A recipe or manifest that gives no scenes.
#[derive(Debug, thiserror::Error)]
pub enum DraftError {
    /// The recipe or manifest cannot be read.
    #[error("cannot read {}: {source}; check the path", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Neither recipe nor manifest.
    #[error("{} is neither a recipe (.toml) nor a manifest (.jsonl)", path.display())]
    Kind {
        /// The file.
        path: PathBuf,
    },
    /// The recipe is wrong.
    #[error("{}: {source}", path.display())]
    Recipe {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: Box<RecipeError>,
    },
    /// The manifest is wrong.
    #[error("{}: {source}", path.display())]
    Manifest {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: Box<ManifestError>,
    },
    /// No scene at all.
    #[error("{} describes no scene: add scenes to it", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// A source cannot be listed.
    #[error(transparent)]
    Index(#[from] IndexError),
    /// A source's store cannot be listed.
    #[error(transparent)]
    Store(#[from] StoreUnavailable),
    /// A root is wrong.
    #[error(transparent)]
    Root(#[from] RootError),
    /// Input files cannot be used.
    #[error("{}{remedy}", invalid_text(invalid, *files))]
    Invalid {
        /// The files, by path.
        invalid: Vec<InvalidInput>,
        /// Number of files that were checked.
        files: usize,
        /// What to do.
        remedy: String,
    },
}

/// Drafts the scenes of `source`, a recipe (`.toml`) or a manifest (`.jsonl`). Writes nothing.
pub fn draft(source: &Path, request: &Request, on_progress: &Tell) -> Result<Drafted, DraftError> {
    let content = read(source, request)?;
    let on_file = |done, all| on_progress("inputs checked", done, all);
    let mut checker = Checker::new(&content, request, &on_file)?;
    let mut left_out = request.left_out.clone();
    let mut invalid = Vec::new();
    let chosen = choose(
        source,
        &content,
        request,
        on_progress,
        &mut checker,
        &mut left_out,
        &mut invalid,
    )?;
    invalid.sort_by(|a, b| a.path.cmp(&b.path));
    let draft = match chosen {
        Ok(draft) if !draft.lines.is_empty() => draft,
        Ok(_) | Err(None) => {
            return Err(DraftError::Invalid {
                invalid,
                files: checker.files(),
                remedy: format!(
                    "correct them, or go on without them: --skip-invalid leaves out these {}",
                    content.parts_replaced()
                ),
            });
        }
        Err(Some(remedy)) => {
            return Err(DraftError::Invalid {
                invalid,
                files: checker.files(),
                remedy,
            });
        }
    };
    Ok(Drafted {
        input_bytes: request.checks_files.then(|| checker.bytes(&draft.lines)),
        files: checker.files(),
        parts: content.parts(),
        lines: draft.lines,
        notes: draft.notes,
        rejected: draft.rejected,
        made: draft.made,
        invalid,
        left_out,
        name: content.name.clone(),
        roots: content.roots.clone(),
    })
}

fn read(source: &Path, request: &Request) -> Result<Content, DraftError> {
    let text = std::fs::read_to_string(source).map_err(|e| DraftError::Read {
        path: source.to_owned(),
        source: e,
    })?;
    match source.extension().and_then(|e| e.to_str()) {
        Some("toml") => content::from_recipe(source, &text, request),
        Some("jsonl") => content::from_manifest(source, &text, request),
        _ => Err(DraftError::Kind {
            path: source.to_owned(),
        }),
    }
}

/// Draws scenes until those that are left need no file that cannot be used. The inner error is a remedy other than
/// `--skip-invalid`.
fn choose(
    source: &Path,
    content: &Content,
    request: &Request,
    on_progress: &Tell,
    checker: &mut Checker,
    left_out: &mut BTreeSet<String>,
    invalid: &mut Vec<InvalidInput>,
) -> Result<Result<Draft, Option<String>>, DraftError> {
    // A manifest names its scenes: each that cannot be made is quarantined with its reason. A recipe's photographs can be
    // replaced by others.
    let keeps = content.is_manifest() && !request.skip_invalid;
    loop {
        let mut check = |lines: &[SceneLine]| {
            if request.checks_files {
                checker.check(lines)
            } else {
                Ok(Vec::new())
            }
        };
        // Files first, previews second: previews take longer, and may draw other photographs.
        let first = match content.first_lines(left_out) {
            Err(error) if !invalid.is_empty() => {
                let remedy = format!("correct them; without them it does not go: {error}");
                return Ok(Err(Some(remedy)));
            }
            first => first?,
        };
        if first.is_empty() && invalid.is_empty() {
            return Err(DraftError::Empty {
                path: source.to_owned(),
            });
        }
        let mut found = check(&first)?;
        let mut draft = None;
        if found.is_empty() || request.is_planned || keeps {
            let drawn = content.draft(left_out, request, on_progress)?;
            found = check(&drawn.lines)?;
            draft = Some(drawn);
        }
        let lines = draft.as_ref().map_or(&first, |draft| &draft.lines);
        let names = names(content, lines, &found);
        let is_sound = found.is_empty();
        invalid.extend(found);
        match draft {
            Some(draft) if keeps => return Ok(Ok(draft)),
            _ if !is_sound && !request.skip_invalid => return Ok(Err(None)),
            Some(draft) if is_sound || request.is_planned => return Ok(Ok(draft)),
            _ => left_out.extend(names),
        }
    }
}

/// What to leave out, so that the scenes do without the files `found`.
fn names(content: &Content, lines: &[SceneLine], found: &[InvalidInput]) -> BTreeSet<String> {
    let by_id: BTreeMap<&SceneId, &SceneLine> = lines.iter().map(|line| (&line.id, line)).collect();
    let needs = found
        .iter()
        .flat_map(|input| input.scenes.iter().map(|id| (by_id[id], &input.path)));
    needs
        .flat_map(|(line, path)| content.names_without(line, path))
        .collect()
}
