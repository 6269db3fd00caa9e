//! Draws all scenes of a recipe. If the recipe needs previews, computes exposures and white balance from a preview of
//! each scene, and draws a scene again if it is black, cannot be assembled or violates the recipe's `[reject]` bounds.

use super::assign::{Assignment, Drawn, spread};
use super::diode::SourceImage;
use super::expand::{Expansion, expand_counted};
use super::recipe::Recipe;
use super::recipe_error::RecipeError;
use crate::preview::{ExposureError, auto_expose};
use glasshouse_line::{Roots, SceneLine, Side};
use rayon::iter::{IndexedParallelIterator, IntoParallelRefIterator, ParallelIterator};
use render::scene::{SceneFiles, read_files_by};
use render::trace::Isa;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// Largest number of previews of one scene, after which planning fails.
const MAX_PREVIEWS: u32 = 64;

/// Number of rejected previews after which a scene gets other photographs.
const PREVIEWS_PER_PAIR: u32 = 4;

/// A rejected draw of a scene: one line of `RUN/rejected.jsonl`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RejectedScene {
    /// Id of the scene in the manifest.
    pub id: String,
    /// Number of the draw, from 0.
    pub attempt: u32,
    /// `scene` (the scene cannot be assembled), `black`, or a measure of `[reject]`.
    pub rule: String,
    pub reason: String,
    /// Path of the front's image or mesh.
    pub front: String,
    /// Path of the back's image or mesh.
    pub back: String,
}

/// Reads `RUN/rejected.jsonl`; a missing file counts as empty. The error has the path and the reason.
pub fn read_rejected(path: PathBuf) -> Result<Vec<RejectedScene>, (PathBuf, String)> {
    let text = match render::input_file::read_to_string(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err((path, error.to_string())),
    };
    let lines = text.lines().map(serde_json::from_str);
    lines.collect::<Result<_, _>>().map_err(|error| (path, error.to_string()))
}

/// All scenes of a recipe, and the draws that the previews rejected.
pub(super) struct DrawnScenes {
    pub(super) expansion: Expansion,
    pub(super) rejected: Vec<RejectedScene>,
    /// Number of scenes in the recipe. Fewer are drawn if some differ from those of the run.
    pub(super) scenes: usize,
}

/// A function that reads a photograph's file by path or URL.
pub(super) type Read<'a> = dyn Fn(&Path) -> std::io::Result<Vec<u8>> + Sync + 'a;

/// The inputs of previews besides the recipe.
pub(super) struct PreviewContext<'a> {
    pub(super) roots: &'a Roots,
    pub(super) base: &'a Path,
    pub(super) read: &'a Read<'a>,
    /// The run's lines, if it exists.
    pub(super) planned: Option<&'a [SceneLine]>,
    /// Number of scenes to draw, spread over all; `None` draws all.
    pub(super) only: Option<usize>,
    pub(super) threads: usize,
    pub(super) on_scene: &'a (dyn Fn(usize, usize) + Sync),
}

/// Formats the lines of `RUN/rejected.jsonl`.
pub fn rejected_lines(rejected: &[RejectedScene]) -> String {
    let line = |one| serde_json::to_string(one).expect("strings and numbers are JSON") + "\n";
    rejected.iter().map(line).collect()
}

/// Draws all scenes of a recipe, with previews if the recipe needs them.
pub(super) fn draw_all(
    recipe: &Recipe,
    images: &BTreeMap<String, Vec<SourceImage>>,
    excluded: &BTreeSet<String>,
    context: &PreviewContext,
) -> Result<DrawnScenes, RecipeError> {
    if recipe.needs_preview() {
        return preview_all(recipe, images, excluded, context);
    }
    let expansion = expand_counted(recipe, images, excluded, context.only)?;
    let scenes = expansion.lines.len();
    Ok(DrawnScenes { expansion, rejected: Vec::new(), scenes })
}

/// Draws and previews every scene. Scenes are independent: the number of threads does not change the result. If the run
/// exists, ends at the first scene that differs from the run's, because the recipe has changed and other previews would
/// only take time.
fn preview_all(
    recipe: &Recipe,
    images: &BTreeMap<String, Vec<SourceImage>>,
    excluded: &BTreeSet<String>,
    context: &PreviewContext,
) -> Result<DrawnScenes, RecipeError> {
    let assignment = Assignment::new(recipe, images, excluded)?;
    let numbers: Vec<usize> = spread(assignment.len(), context.only).collect();
    let done = AtomicUsize::new(0);
    (context.on_scene)(0, numbers.len());
    let has_changed =
        AtomicBool::new(context.planned.is_some_and(|lines| lines.len() != numbers.len()));
    let preview = |(at, &number): (usize, &usize)| {
        if done.load(Ordering::Relaxed) > 0 && has_changed.load(Ordering::Relaxed) {
            return None;
        }
        let kept = preview_scene(recipe, &assignment, number, context);
        (context.on_scene)(done.fetch_add(1, Ordering::Relaxed) + 1, numbers.len());
        if let (Ok(kept), Some(planned)) = (&kept, context.planned)
            && planned.get(at) != Some(&kept.drawn.line)
        {
            has_changed.store(true, Ordering::Relaxed);
        }
        Some(kept)
    };
    let all = || -> Vec<Result<KeptScene, RecipeError>> {
        numbers.par_iter().enumerate().filter_map(preview).collect()
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(context.threads);
    let kept = match pool.build() {
        Ok(pool) => pool.install(all),
        // If the system cannot start threads, the caller's pool does the work.
        Err(_) => all(),
    };
    let mut scenes = DrawnScenes {
        expansion: Expansion::default(),
        rejected: Vec::new(),
        scenes: numbers.len(),
    };
    for kept in kept {
        let KeptScene { drawn, rejected, redrawn } = kept?;
        scenes.expansion.add(drawn, redrawn);
        scenes.rejected.extend(rejected);
    }
    Ok(scenes)
}

struct KeptScene {
    drawn: Drawn,
    rejected: Vec<RejectedScene>,
    /// Number of draws that failed the geometry check.
    redrawn: u32,
}

fn preview_scene(
    recipe: &Recipe,
    assignment: &Assignment,
    number: usize,
    context: &PreviewContext,
) -> Result<KeptScene, RecipeError> {
    let rules = recipe.reject.clone().unwrap_or_default();
    let mut rejected = Vec::new();
    let mut next = 0;
    // The files of the last draw, with their paths: other draws have other photographs, or other covers.
    let mut files: Option<(Vec<String>, SceneFiles)> = None;
    for preview in 0..MAX_PREVIEWS {
        let change = preview / PREVIEWS_PER_PAIR;
        let mut drawn = assignment.draw(number, change, next)?;
        next = drawn.attempt + 1;
        let kept = |drawn: Drawn, rejected: Vec<RejectedScene>| {
            // Every earlier attempt failed the geometry check or was rejected after its preview.
            let redrawn = drawn.attempt - rejected.len() as u32;
            Ok(KeptScene { drawn, rejected, redrawn })
        };
        let sides = [&drawn.line.front, &drawn.line.back].into_iter();
        let paths: Vec<String> =
            sides.flat_map(Side::paths).map(|(_, path)| path.to_owned()).collect();
        if files.as_ref().is_none_or(|(of, _)| *of != paths) {
            let read = read_files_by(&drawn.line, context.roots, context.base, context.read);
            // The plan keeps a scene with unreadable files; the worker that loads the scene quarantines it.
            let Ok(read) = read else {
                return kept(drawn, rejected);
            };
            files = Some((paths, read));
        }
        let (_, read) = files.as_ref().expect("the files were just read");
        let exposed = auto_expose(&drawn.line, read, &recipe.light, &rules, Isa::detect());
        let (rule, reason) = match exposed {
            Ok(exposed) => {
                drawn.line = exposed.line;
                match exposed.rejected {
                    None => return kept(drawn, rejected),
                    Some(violation) => (violation.measure.to_owned(), violation.to_string()),
                }
            }
            Err(ExposureError::Load(_)) => return kept(drawn, rejected),
            Err(ExposureError::Refused(error)) => ("scene".to_owned(), error.to_string()),
            Err(error @ ExposureError::Black) => ("black".to_owned(), error.to_string()),
        };
        rejected.push(RejectedScene {
            id: drawn.line.id.to_string(),
            attempt: drawn.attempt,
            rule,
            reason,
            front: drawn.line.front.name().to_owned(),
            back: drawn.line.back.name().to_owned(),
        });
    }
    let last = rejected.last().expect("there was at least one preview");
    Err(RecipeError::NoneKept {
        id: last.id.clone(),
        previews: MAX_PREVIEWS,
        reason: last.reason.clone(),
    })
}
