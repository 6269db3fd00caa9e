//! `plan`: a recipe or a `.jsonl` becomes `RUN/manifest.jsonl` and `RUN/spec.json`, frozen.

use crate::run::run_dir::{Run, RunDir, RunError};
use crate::store::{Inputs, StoreError};
use plan::check::{Checker, InvalidInput, invalid_text};
use plan::content::{self, Content, Made};
use plan::draw_scenes::{RejectedScene, rejected_lines};
use plan::make::make_photographs;
use plan::{IndexError, RecipeError};
use procedural::SampleError;
use render::atomic_file::{self, WriteError};
use render::ids::SceneId;
use render::line::{ManifestError, RootError, Roots, SceneLine, to_jsonl};
use render::shard::{SPEC_SCHEMA, Spec, SpecMismatch, choose_tile_px, golden, manifest_digest};
use render::trace::{Isa, TRACER_VERSION};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// How to plan.
pub struct PlanOptions<'a> {
    /// `--root NAME=DIR`.
    pub roots: &'a Roots,
    /// Lists roots that are in an object store.
    pub inputs: &'a Inputs,
    /// Side of a tile, px; chosen if `None`.
    pub tile_px: Option<u32>,
    /// Write nothing.
    pub dry_run: bool,
    /// Leave out photographs whose files cannot be used (of a manifest: scenes), and go on.
    pub skip_invalid: bool,
    /// Threads that look at input files and make procedural photographs.
    pub threads: usize,
}

/// Is told what is being done, and how much of it: (what, done, all).
pub(super) type Tell<'a> = dyn Fn(&'static str, usize, usize) + Sync + 'a;

/// A plan, written or not.
#[derive(Debug)]
pub struct Planned {
    /// The run's rules.
    pub spec: Spec,
    /// Its scenes.
    pub lines: Vec<SceneLine>,
    /// The run was there already, with the same plan.
    pub existed: bool,
    /// What a reader should know: images without depth, scenes paired less well than wished.
    pub notes: Vec<String>,
    /// Draws that were looked at and not kept.
    pub rejected: Vec<RejectedScene>,
    /// Files that cannot be used, by path.
    pub invalid: Vec<InvalidInput>,
    /// Input files that were looked at.
    pub files: usize,
    /// What is left out, in a word: photographs, or scenes.
    pub parts: &'static str,
    /// Size of the input files together; `None` where they were not looked at, as the run was there already.
    pub input_bytes: Option<u64>,
    /// About what procedural photographs take in the run's folder, bytes.
    pub made_bytes: u64,
}

impl Planned {
    /// What of the input files is wrong, as a table, and what was done about it; nothing if all is well.
    pub fn invalid_text(&self) -> Option<String> {
        if self.invalid.is_empty() {
            return None;
        }
        let table = invalid_text(&self.invalid, self.files);
        let (count, parts) = (self.spec.left_out.len(), self.parts);
        let done = match self.parts {
            _ if self.existed => {
                "the run is planned and stays as it is: scenes that cannot be made will be set aside".to_owned()
            }
            _ if count == 0 => {
                "scenes that need them will be set aside with these reasons; --skip-invalid leaves them out".to_owned()
            }
            "photographs" => format!("{parts} left out: {count}; others were drawn in their place"),
            _ => format!("{parts} left out: {count}"),
        };
        Some(format!("{table}{done}"))
    }
}

/// A recipe that cannot be planned.
#[derive(Debug, thiserror::Error)]
pub enum PlanError {
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
    Store(#[from] StoreError),
    /// A root is wrong.
    #[error(transparent)]
    Root(#[from] RootError),
    /// Input files cannot be used.
    #[error("{}{remedy}", invalid_text(invalid, *files))]
    Invalid {
        /// The files, by path.
        invalid: Vec<InvalidInput>,
        /// Files that were looked at.
        files: usize,
        /// What to do.
        remedy: String,
    },
    /// The run is another one.
    #[error(transparent)]
    Mismatch(#[from] SpecMismatch),
    /// The run that is there cannot be opened.
    #[error(transparent)]
    Run(#[from] RunError),
    /// The disk.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// Procedural photographs cannot be written.
    #[error(transparent)]
    Sample(#[from] SampleError),
}

/// Plans `source` into the folder `out`. `on_progress` is told (what, done, all) as files are checked, scenes looked at and
/// photographs made.
pub fn plan(
    source: &Path,
    out: &Path,
    options: &PlanOptions,
    on_progress: &(dyn Fn(&'static str, usize, usize) + Sync),
) -> Result<Planned, PlanError> {
    let text = std::fs::read_to_string(source).map_err(|e| PlanError::Read {
        path: source.to_owned(),
        source: e,
    })?;
    let content = match source.extension().and_then(|e| e.to_str()) {
        Some("toml") => content::from_recipe(source, &text, options)?,
        Some("jsonl") => content::from_manifest(source, &text, options)?,
        _ => {
            return Err(PlanError::Kind {
                path: source.to_owned(),
            });
        }
    };
    let dir = RunDir::new(out);
    let existing = match Run::open(out, options.roots) {
        Ok(run) => Some(run),
        Err(RunError::Missing { .. }) => None,
        Err(error) => return Err(error.into()),
    };
    // A run keeps what was left out of it, whatever has become of the files.
    let left_out = existing.iter().flat_map(|run| run.spec.left_out.clone());
    let mut left_out: BTreeSet<String> = left_out.collect();
    let on_file = |done, all| on_progress("inputs checked", done, all);
    let mut checker = Checker::new(&content, options, &on_file)?;
    let is_checked = existing.is_none() || options.dry_run;
    let mut invalid = Vec::new();
    let mut remedy = format!(
        "correct them, or go on without them: --skip-invalid leaves out these {}",
        content.parts_replaced()
    );
    // Whoever names scenes gets them, or for each that cannot be made a reason: the farm sets it aside. Of a recipe's
    // photographs others can take the place.
    let keeps = content.is_manifest() && !options.skip_invalid;
    let draft = loop {
        let mut check = |lines: &[SceneLine]| {
            if is_checked {
                checker.check(lines)
            } else {
                Ok(Vec::new())
            }
        };
        // First as scenes are before they are looked at, which takes longer; then again, as others may be drawn by it.
        let first = match content.first_lines(&left_out) {
            Err(error) if !invalid.is_empty() => {
                remedy = format!("correct them; without them it does not go: {error}");
                break None;
            }
            first => first?,
        };
        if first.is_empty() && invalid.is_empty() {
            return Err(PlanError::Empty {
                path: source.to_owned(),
            });
        }
        let mut found = check(&first)?;
        let mut draft = None;
        if found.is_empty() || existing.is_some() || keeps {
            let drawn = content.draft(&left_out, &dir, options, on_progress)?;
            found = check(&drawn.lines)?;
            draft = Some(drawn);
        }
        let lines = draft.as_ref().map_or(&first, |draft| &draft.lines);
        let names = names(&content, lines, &found);
        let is_sound = found.is_empty();
        invalid.extend(found);
        match draft {
            Some(draft) if keeps => break Some(draft),
            _ if !is_sound && !options.skip_invalid => break None,
            Some(draft) if is_sound || existing.is_some() => break Some(draft),
            _ => left_out.extend(names),
        }
    };
    invalid.sort_by(|a, b| a.path.cmp(&b.path));
    let Some(draft) = draft.filter(|draft| !draft.lines.is_empty()) else {
        return Err(PlanError::Invalid {
            invalid,
            files: checker.files(),
            remedy,
        });
    };
    let input_bytes = is_checked.then(|| checker.bytes(&draft.lines));
    let manifest = to_jsonl(&draft.lines);
    let tile_px = options
        .tile_px
        .or(existing.as_ref().map(|run| run.spec.tile_px))
        .unwrap_or_else(|| choose_tile_px(&draft.lines));
    let spec = Spec {
        schema: SPEC_SCHEMA.to_owned(),
        name: content.name.clone(),
        scenes: draft.lines.len() as u32,
        manifest_blake3: manifest_digest(&manifest),
        tile_px,
        tracer_version: TRACER_VERSION,
        golden: golden(Isa::detect(), options.threads),
        roots: content.roots.clone(),
        left_out: left_out.into_iter().collect(),
    };
    if let Some(run) = &existing {
        let diff = run.spec.diff(&run.lines, &spec, &draft.lines);
        if !diff.is_empty() {
            return Err(SpecMismatch {
                run: out.to_owned(),
                diff,
            }
            .into());
        }
    }
    if !options.dry_run {
        atomic_file::create_dir(out)?;
        let on_photograph = |done, all| on_progress("photographs", done, all);
        make_photographs(&dir, &draft.made, options.threads, &on_photograph)?;
        if existing.is_none() {
            if !draft.rejected.is_empty() {
                let lines = rejected_lines(&draft.rejected);
                atomic_file::write(&dir.rejected(), lines.as_bytes())?;
            }
            atomic_file::write(&dir.manifest(), manifest.as_bytes())?;
            // Last: its presence says that the run is planned.
            let mut json = serde_json::to_string_pretty(&spec).expect("a spec is JSON");
            json.push('\n');
            atomic_file::write(&dir.spec(), json.as_bytes())?;
        }
    }
    Ok(Planned {
        spec,
        existed: existing.is_some(),
        notes: draft.notes,
        rejected: draft.rejected,
        invalid,
        files: checker.files(),
        parts: content.parts(),
        input_bytes,
        made_bytes: draft.made.iter().map(Made::about_bytes).sum(),
        lines: draft.lines,
    })
}

/// What is to be left out, so that the scenes do without the files `found`.
fn names(content: &Content, lines: &[SceneLine], found: &[InvalidInput]) -> BTreeSet<String> {
    let by_id: BTreeMap<&SceneId, &SceneLine> = lines.iter().map(|line| (&line.id, line)).collect();
    let needs = found
        .iter()
        .flat_map(|input| input.scenes.iter().map(|id| (by_id[id], &input.path)));
    needs
        .flat_map(|(line, path)| content.names_without(line, path))
        .collect()
}
