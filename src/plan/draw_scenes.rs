//! Scenes of a recipe that asks for it are looked at before they are farmed: their light is settled, and those that nobody
//! would want are replaced.

use crate::preview::{SettleError, settle};
use crate::{Cast, Drawn, Recipe, RecipeError, SourceImage, expand_counted};
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use render::line::{Roots, SceneLine};
use render::scene::{SceneFiles, read_files_by};
use render::trace::Isa;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

/// How often a scene is drawn before its recipe is given up.
const MAX_LOOKS: u32 = 64;

/// After so many looks in vain, other photographs are tried.
const LOOKS_A_PAIR: u32 = 4;

/// A scene that was drawn and not kept, as a line of `RUN/rejected.jsonl`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RejectedScene {
    /// The scene that another draw took the place of.
    pub id: String,
    /// Which draw it was.
    pub attempt: u32,
    /// The rule: `scene` (it refuses what was drawn), `black`, or a measure of `[reject]`.
    pub rule: String,
    /// Why, in words.
    pub reason: String,
    /// Its front photograph.
    pub front: String,
    /// Its back photograph.
    pub back: String,
}

/// The lines of the file `path`, a `RUN/rejected.jsonl`; none if there is no such file. An error names the file and says
/// what is wrong.
pub fn read_rejected(path: PathBuf) -> Result<Vec<RejectedScene>, (PathBuf, String)> {
    let text = match std::fs::read_to_string(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err((path, error.to_string())),
    };
    let lines = text.lines().map(serde_json::from_str);
    lines
        .collect::<Result<_, _>>()
        .map_err(|error| (path, error.to_string()))
}

/// What became of a recipe's scenes.
pub(super) struct Looked {
    pub(super) lines: Vec<SceneLine>,
    pub(super) rejected: Vec<RejectedScene>,
    pub(super) same_place: u32,
    pub(super) same_scan: u32,
    pub(super) redrawn: u32,
}

/// Reads a photograph's file, wherever it is.
pub(super) type Read<'a> = dyn Fn(&Path) -> std::io::Result<Vec<u8>> + Sync + 'a;

/// Where scenes' files are, and how fast to look.
pub(super) struct Surroundings<'a> {
    pub(super) roots: &'a Roots,
    pub(super) base: &'a Path,
    pub(super) read: &'a Read<'a>,
    pub(super) threads: usize,
    pub(super) on_scene: &'a (dyn Fn(usize, usize) + Sync),
}

/// The lines of `RUN/rejected.jsonl`.
pub fn rejected_lines(rejected: &[RejectedScene]) -> String {
    let line = |one| serde_json::to_string(one).expect("strings and numbers are JSON") + "\n";
    rejected.iter().map(line).collect()
}

/// Draws every scene of a recipe; looks at it, too, where the recipe asks for what only a look can tell.
pub(super) fn draw_all(
    recipe: &Recipe,
    images: &BTreeMap<String, Vec<SourceImage>>,
    excluded: &BTreeSet<String>,
    around: &Surroundings,
) -> Result<Looked, RecipeError> {
    if recipe.needs_preview() {
        return look_at_all(recipe, images, excluded, around);
    }
    let drawn = expand_counted(recipe, images, excluded)?;
    Ok(Looked {
        lines: drawn.lines,
        rejected: Vec::new(),
        same_place: drawn.same_place,
        same_scan: drawn.same_scan,
        redrawn: drawn.redrawn,
    })
}

/// Draws, looks at and settles every scene. The result depends on no number of threads: each scene is drawn for itself.
fn look_at_all(
    recipe: &Recipe,
    images: &BTreeMap<String, Vec<SourceImage>>,
    excluded: &BTreeSet<String>,
    around: &Surroundings,
) -> Result<Looked, RecipeError> {
    let cast = Cast::new(recipe, images, excluded)?;
    let done = AtomicUsize::new(0);
    (around.on_scene)(0, cast.len());
    let all = || -> Vec<Result<Kept, RecipeError>> {
        let scenes = (0..cast.len()).into_par_iter();
        scenes
            .map(|number| {
                let kept = look_at(recipe, &cast, number, around);
                (around.on_scene)(done.fetch_add(1, Ordering::Relaxed) + 1, cast.len());
                kept
            })
            .collect()
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(around.threads);
    let kept = match pool.build() {
        Ok(pool) => pool.install(all),
        // No thread to be had: the caller's own will do.
        Err(_) => all(),
    };
    let mut looked = Looked {
        lines: Vec::new(),
        rejected: Vec::new(),
        same_place: 0,
        same_scan: 0,
        redrawn: 0,
    };
    for kept in kept {
        let Kept {
            drawn,
            rejected,
            redrawn,
        } = kept?;
        looked.same_place += u32::from(drawn.same_place);
        looked.same_scan += u32::from(drawn.same_scan);
        looked.redrawn += redrawn;
        looked.lines.push(drawn.line);
        looked.rejected.extend(rejected);
    }
    Ok(looked)
}

struct Kept {
    drawn: Drawn,
    rejected: Vec<RejectedScene>,
    /// Draws that the geometry refused.
    redrawn: u32,
}

fn look_at(
    recipe: &Recipe,
    cast: &Cast,
    number: usize,
    around: &Surroundings,
) -> Result<Kept, RecipeError> {
    let rules = recipe.reject.clone().unwrap_or_default();
    let mut rejected = Vec::new();
    let mut next = 0;
    let mut files: Option<(u32, SceneFiles)> = None;
    for look in 0..MAX_LOOKS {
        let change = look / LOOKS_A_PAIR;
        let mut drawn = cast.draw(number, change, next)?;
        next = drawn.attempt + 1;
        let kept = |drawn: Drawn, rejected: Vec<RejectedScene>| {
            // Every attempt before this one was refused by the geometry or rejected by a look.
            let redrawn = drawn.attempt - rejected.len() as u32;
            Ok(Kept {
                drawn,
                rejected,
                redrawn,
            })
        };
        if files.as_ref().is_none_or(|(of, _)| *of != change) {
            let read = read_files_by(&drawn.line, around.roots, around.base, around.read);
            // Files that cannot be read are quarantined when the scene is farmed, like any others.
            let Ok(read) = read else {
                return kept(drawn, rejected);
            };
            files = Some((change, read));
        }
        let (_, read) = files.as_ref().expect("they were just read");
        let settled = settle(&drawn.line, read, &recipe.light, &rules, Isa::detect());
        let (rule, reason) = match settled {
            Ok(settled) => {
                drawn.line = settled.line;
                match settled.rejected {
                    None => {
                        return kept(drawn, rejected);
                    }
                    Some(bound) => (bound.measure.to_string(), bound.to_string()),
                }
            }
            Err(SettleError::Load(_)) => {
                return kept(drawn, rejected);
            }
            Err(SettleError::Refused(error)) => ("scene".to_owned(), error.to_string()),
            Err(error @ SettleError::Black) => ("black".to_owned(), error.to_string()),
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
    let last = rejected.last().expect("there was at least one look");
    Err(RecipeError::NoneKept {
        id: last.id.clone(),
        looks: MAX_LOOKS,
        reason: last.reason.clone(),
    })
}
