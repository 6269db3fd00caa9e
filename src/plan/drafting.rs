//! Turns a recipe or a manifest into scene lines with checked input files.

use super::check::{Checker, InvalidInput};
use super::content::{self, Content, Draft};
use super::draw_scenes::RejectedScene;
use super::procedural_inputs::ProceduralInput;
use super::request::{DraftError, Progress, Request};
use glasshouse_line::ids::SceneId;
use glasshouse_line::{Roots, SceneLine};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Scenes with checked files; nothing is written yet.
#[derive(Debug)]
pub struct Drafted {
    /// Name of the recipe or manifest.
    pub name: String,
    /// Root folders; relative paths are below the run's folder.
    pub roots: BTreeMap<String, PathBuf>,
    pub lines: Vec<SceneLine>,
    /// Remarks for the user, such as images without depth, pairs of one place or scan, and rejected previews.
    pub notes: Vec<String>,
    /// Draws that the previews rejected.
    pub rejected: Vec<RejectedScene>,
    /// Unusable input files, sorted by path.
    pub invalid: Vec<InvalidInput>,
    /// Number of checked input files.
    pub files: usize,
    /// Kind of the entries of `left_out`: "photographs" or "scenes".
    pub left_out_kind: &'static str,
    /// Names of the photographs or scenes that the plan leaves out.
    pub left_out: BTreeSet<String>,
    /// Total size of the input files; `None` if planning does not check them.
    pub input_bytes: Option<u64>,
    /// Procedural pictures that the scenes use.
    pub to_make: Vec<ProceduralInput>,
}

/// Drafts the scenes of `source`, a recipe (`.toml`) or a manifest (`.jsonl`). Writes nothing, except for the procedural
/// pictures of previews if the request allows it.
pub fn draft(
    source: &Path,
    request: &Request,
    on_progress: &Progress,
) -> Result<Drafted, DraftError> {
    let content = read(source, request)?;
    let on_file = |done, all| on_progress("inputs checked", done, all);
    let mut roots = Roots::default();
    for (name, folder) in &content.roots {
        if folder.to_str().is_none() {
            let (path, root) = (source.to_owned(), name.clone());
            return Err(DraftError::NotText { path, root, folder: folder.clone() });
        }
        roots.insert(name, folder.clone())?;
    }
    let mut checker =
        Checker::new(roots, content.own_roots(), request.inputs, request.threads, &on_file);
    let mut left_out = request.left_out.clone();
    let mut invalid = Vec::new();
    let chosen =
        choose(source, &content, request, on_progress, &mut checker, &mut left_out, &mut invalid)?;
    invalid.sort_by(|a, b| a.path.cmp(&b.path));
    let draft = match chosen {
        Ok(draft) if !draft.lines.is_empty() => draft,
        Ok(_) | Err(None) => {
            return Err(DraftError::Invalid {
                invalid,
                files: checker.files(),
                remedy: format!(
                    "correct them, or leave them out: --skip-invalid leaves out these {}",
                    content.left_out_effect()
                ),
            });
        }
        Err(Some(remedy)) => {
            return Err(DraftError::Invalid { invalid, files: checker.files(), remedy });
        }
    };
    let mut notes = draft.notes;
    if request.checks_files {
        notes.extend(checker.depth_remarks(&draft.lines));
        notes.extend(checker.other_aspects(&draft.lines));
        notes.extend(checker.odd_views(&draft.lines));
    }
    Ok(Drafted {
        input_bytes: request.checks_files.then(|| checker.bytes(&draft.lines)),
        files: checker.files(),
        left_out_kind: content.left_out_kind(),
        lines: draft.lines,
        notes,
        rejected: draft.rejected,
        to_make: draft.to_make,
        invalid,
        left_out,
        name: content.name.clone(),
        roots: content.roots.clone(),
    })
}

fn read(source: &Path, request: &Request) -> Result<Content, DraftError> {
    let text = render::input_file::read_to_string(source)
        .map_err(|e| DraftError::Read { path: source.to_owned(), source: e })?;
    match source.extension().and_then(|e| e.to_str()) {
        Some("toml") => content::from_recipe(source, &text, request),
        Some("jsonl") => content::from_manifest(source, &text, request),
        _ => Err(DraftError::Kind { path: source.to_owned() }),
    }
}

/// Drafts the scenes. With `skip_invalid`, leaves out photographs or scenes until no scene needs an invalid file,
/// unless the run is already planned. The inner error is the remedy; `None` stands for `--skip-invalid`.
fn choose(
    source: &Path,
    content: &Content,
    request: &Request,
    on_progress: &Progress,
    checker: &mut Checker,
    left_out: &mut BTreeSet<String>,
    invalid: &mut Vec<InvalidInput>,
) -> Result<Result<Draft, Option<String>>, DraftError> {
    // Photographs of a recipe have substitutes. Scenes of a manifest have none: a scene with invalid files stays in the
    // plan, and a worker quarantines it. A path to a pipe or a device is an error of the manifest.
    let keeps = content.is_manifest() && !request.skip_invalid;
    loop {
        let mut check = |lines: &[SceneLine]| {
            if request.checks_files { checker.check(lines) } else { Ok(Vec::new()) }
        };
        // Files are checked before previews, because previews take longer and may draw other photographs.
        let first = match content.first_lines(left_out, request.only) {
            Err(error) if !invalid.is_empty() => {
                let remedy = format!("correct them: the recipe cannot do without them ({error})");
                return Ok(Err(Some(remedy)));
            }
            first => first?,
        };
        if first.is_empty() && invalid.is_empty() {
            return Err(DraftError::Empty { path: source.to_owned() });
        }
        let mut found = check(&first)?;
        let mut draft = None;
        if found.is_empty() || request.planned.is_some() || keeps {
            let drawn = content.draft(left_out, request, on_progress)?;
            found = check(&drawn.lines)?;
            draft = Some(drawn);
        }
        let lines = draft.as_ref().map_or(&first, |draft| &draft.lines);
        let names = names(content, lines, &found);
        let is_sound = found.is_empty();
        invalid.extend(found);
        match draft {
            Some(draft) if keeps && !checker.has_refused() => return Ok(Ok(draft)),
            _ if !is_sound && !request.skip_invalid => return Ok(Err(None)),
            Some(draft) if is_sound || request.planned.is_some() => return Ok(Ok(draft)),
            _ => left_out.extend(names),
        }
    }
}

/// Names the photographs or scenes to leave out, so that no scene needs the files `found`.
fn names(content: &Content, lines: &[SceneLine], found: &[InvalidInput]) -> BTreeSet<String> {
    let by_id: BTreeMap<&SceneId, &SceneLine> = lines.iter().map(|line| (&line.id, line)).collect();
    let needs =
        found.iter().flat_map(|input| input.scenes.iter().map(|id| (by_id[id], &input.path)));
    needs.flat_map(|(line, path)| content.names_to_leave_out(line, path)).collect()
}
