//! What a recipe or a manifest says: scenes, where their files are, and what can be left out of it.

use super::drafting::{DraftError, Request, Tell};
use super::draw_scenes::{Looked, RejectedScene, Surroundings, draw_all};
use super::sample_bytes::SampleBytes;
use crate::{
    Index, LIST_NAME, Layout, PlacesFolders, Recipe, RecipeError, Source, SourceImage,
    expand_counted, from_paths, index_list, index_paths, index_places, index_source,
};
use procedural::SamplePhotograph;
use render::line::{Roots, SceneLine, is_url, parse_jsonl};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};

/// Name of the root under which a `.jsonl`'s own relative paths lie.
const MANIFEST_ROOT: &str = "manifest";

/// A procedural photograph that planning makes.
#[derive(Clone, Debug)]
pub struct Made {
    /// The root that it lies under.
    pub root: String,
    /// The photograph.
    pub photograph: SamplePhotograph,
    /// Pixels across and down.
    pub size: [u32; 2],
}

/// What the recipe or manifest says, before anything is compared or written.
pub(super) struct Content {
    pub(super) name: String,
    /// Root folders for the spec; relative ones are the run's own.
    pub(super) roots: BTreeMap<String, PathBuf>,
    /// What was noticed while photographs were listed.
    notes: Vec<String>,
    scenes: Scenes,
}

/// Where the scenes are from.
enum Scenes {
    /// Drawn by a recipe from the photographs of its sources, some of which are to be made.
    Drawn {
        path: PathBuf,
        recipe: Box<Recipe>,
        images: BTreeMap<String, Vec<SourceImage>>,
        made: Vec<Made>,
    },
    /// Written down.
    Lines(Vec<SceneLine>),
}

/// Scenes, and what belongs to them.
pub(super) struct Draft {
    pub(super) lines: Vec<SceneLine>,
    pub(super) notes: Vec<String>,
    /// Draws that were looked at and not kept.
    pub(super) rejected: Vec<RejectedScene>,
    /// Photographs to make that the scenes use.
    pub(super) made: Vec<Made>,
}

impl Content {
    /// The scenes before any was looked at: see [`Self::draft`].
    pub(super) fn first_lines(
        &self,
        left_out: &BTreeSet<String>,
    ) -> Result<Vec<SceneLine>, DraftError> {
        match &self.scenes {
            Scenes::Drawn {
                path,
                recipe,
                images,
                ..
            } => Ok(expand_counted(recipe, images, left_out)
                .map_err(|source| wrong(path, source))?
                .lines),
            Scenes::Lines(all) => {
                let stays = |line: &&SceneLine| !left_out.contains(line.id.as_str());
                Ok(all.iter().filter(stays).cloned().collect())
            }
        }
    }

    /// The scenes, with other photographs in place of those that are left out; of a manifest, without the scenes that are.
    pub(super) fn draft(
        &self,
        left_out: &BTreeSet<String>,
        request: &Request,
        on_progress: &Tell,
    ) -> Result<Draft, DraftError> {
        let mut notes = self.notes.clone();
        let Scenes::Drawn {
            path,
            recipe,
            images,
            made,
        } = &self.scenes
        else {
            return Ok(Draft {
                lines: self.first_lines(left_out)?,
                notes,
                rejected: Vec::new(),
                made: Vec::new(),
            });
        };
        let bytes = SampleBytes::new(request.run, made);
        let mut folders = Roots::default();
        for (name, folder) in &self.roots {
            folders.insert(name, request.run.join(folder))?;
        }
        let around = Surroundings {
            roots: &folders,
            base: request.run,
            read: &|path| {
                bytes
                    .read(path)
                    .unwrap_or_else(|| request.inputs.read(path))
            },
            threads: request.threads,
            on_scene: &|done, all| on_progress("scenes looked at", done, all),
        };
        let Looked {
            lines,
            rejected,
            same_place,
            same_scan,
            redrawn,
        } = draw_all(recipe, images, left_out, &around).map_err(|source| wrong(path, source))?;
        if !rejected.is_empty() {
            let looks = lines.len() + rejected.len();
            notes.push(format!(
                "{} of {looks} draws that were looked at were not kept ({:.1} %); others took their places",
                rejected.len(),
                100.0 * rejected.len() as f64 / looks as f64,
            ));
        }
        for (count, what) in [
            (
                same_place,
                "scenes pair two photographs of the same kind of place: no others were left",
            ),
            (
                same_scan,
                "scenes pair two photographs of the same scan: no others were left",
            ),
            (
                redrawn,
                "draws were refused by the geometry and drawn again",
            ),
        ] {
            if count > 0 {
                notes.push(format!("{count} {what}"));
            }
        }
        let used: BTreeSet<&str> = lines
            .iter()
            .flat_map(|l| [l.front.name(), l.back.name()])
            .collect();
        let is_used = |made: &&Made| {
            let path = made.photograph.color_path();
            used.contains(format!("{}:{}", made.root, path.display()).as_str())
        };
        let made = made.iter().filter(is_used).cloned().collect();
        Ok(Draft {
            lines,
            notes,
            rejected,
            made,
        })
    }

    /// What is to be left out, so that `line` does without the file `path`: the photograph, or the scene of a manifest.
    pub(super) fn names_without(&self, line: &SceneLine, path: &str) -> Vec<String> {
        if let Scenes::Lines(_) = self.scenes {
            return vec![line.id.to_string()];
        }
        let sides = [&line.front, &line.back].into_iter();
        sides
            .filter(|side| side.paths().iter().any(|(_, p)| *p == path))
            .map(|side| side.name().to_owned())
            .collect()
    }

    /// What is left out, in a word.
    pub(super) fn parts(&self) -> &'static str {
        match self.scenes {
            Scenes::Drawn { .. } => "photographs",
            Scenes::Lines(_) => "scenes",
        }
    }

    /// The same, and what becomes of them.
    pub(super) fn parts_replaced(&self) -> &'static str {
        match self.scenes {
            Scenes::Drawn { .. } => "photographs and draws others in their place",
            Scenes::Lines(_) => "scenes",
        }
    }

    /// It names scenes, and draws none.
    pub(super) fn is_manifest(&self) -> bool {
        matches!(self.scenes, Scenes::Lines(_))
    }

    /// Roots whose files planning writes itself.
    pub(super) fn own_roots(&self) -> BTreeSet<&str> {
        match &self.scenes {
            Scenes::Drawn { made, .. } => made.iter().map(|m| m.root.as_str()).collect(),
            Scenes::Lines(_) => BTreeSet::new(),
        }
    }
}

/// Of the recipe in the file `path`.
fn wrong(path: &Path, source: RecipeError) -> DraftError {
    DraftError::Recipe {
        path: path.to_owned(),
        source: Box::new(source),
    }
}

/// A path that means the same from everywhere; URLs do.
fn absolute(path: &Path) -> PathBuf {
    if is_url(path) {
        return path.to_owned();
    }
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}

fn parent(path: &Path) -> PathBuf {
    let parent = path.parent().filter(|p| !p.as_os_str().is_empty());
    absolute(parent.unwrap_or(Path::new(".")))
}

/// Lists a source of PLACES365, on disk or in a bucket.
fn places(
    name: &str,
    source: &Source,
    [color, depth]: [&Path; 2],
    base: &Path,
    request: &Request,
) -> Result<Index, DraftError> {
    let table = base.join(source.depth_ranges.as_deref().unwrap_or_default());
    let folders = PlacesFolders {
        color,
        depth,
        table: &table,
    };
    let mut listed = BTreeMap::new();
    for folder in [color, depth] {
        if is_url(folder) {
            listed.insert(folder, request.inputs.list(folder)?);
        }
    }
    let list = |folder: &Path| listed.get(folder).cloned();
    Ok(index_places(name, &folders, &list)?)
}

pub(super) fn from_recipe(
    path: &Path,
    text: &str,
    request: &Request,
) -> Result<Content, DraftError> {
    let recipe = Recipe::parse(text).map_err(|source| wrong(path, source))?;
    let folders = recipe.roots(&parent(path), request.roots);
    let mut roots: BTreeMap<String, PathBuf> = folders
        .iter()
        .map(|(name, folder)| (name.to_owned(), absolute(folder)))
        .collect();
    let mut images = BTreeMap::new();
    let mut notes = Vec::new();
    let mut made = Vec::new();
    for (name, source) in &recipe.sources {
        let index: Index = if source.layout == Layout::Sample {
            let seed = source.seed.unwrap_or(recipe.seed);
            let photographs = procedural::listing(source.count.unwrap_or(0) as usize, seed);
            let paths: Vec<String> = photographs
                .iter()
                .flat_map(|p| [p.color_path(), p.depth_path(), p.mask_path()])
                .map(|p| p.to_string_lossy().into_owned())
                .collect();
            made.extend(photographs.into_iter().map(|photograph| Made {
                root: name.clone(),
                photograph,
                size: source.sample_size(),
            }));
            roots.insert(name.clone(), Path::new("inputs").join(name));
            from_paths(&paths)
        } else {
            let folder_of =
                |root: &str| folders.get(root).map_or_else(PathBuf::new, Path::to_owned);
            let folder = folder_of(name);
            if source.layout == Layout::Places {
                places(
                    name,
                    source,
                    [&folder, &folder_of(&format!("{name}-depth"))],
                    &parent(path),
                    request,
                )?
            } else if source.layout == Layout::List {
                let list = match &source.list {
                    Some(list) => parent(path).join(list),
                    None => folder.join(LIST_NAME),
                };
                index_list(name, &list, request.inputs.read(&list))?
            } else if is_url(&folder) {
                index_paths(name, &folder, &request.inputs.list(&folder)?)?
            } else {
                index_source(name, &folder)?
            }
        };
        if let Some(first) = index.without_depth.first() {
            let count = index.without_depth.len();
            notes.push(format!(
                "source {name}: {count} images have no depth and are left out (first: {first})"
            ));
        }
        images.insert(name.clone(), index.images);
    }
    Ok(Content {
        name: recipe.name.clone(),
        roots,
        notes,
        scenes: Scenes::Drawn {
            path: path.to_owned(),
            recipe: Box::new(recipe),
            images,
            made,
        },
    })
}

pub(super) fn from_manifest(
    path: &Path,
    text: &str,
    request: &Request,
) -> Result<Content, DraftError> {
    let mut lines = parse_jsonl(text).map_err(|source| DraftError::Manifest {
        path: path.to_owned(),
        source: Box::new(source),
    })?;
    let base = parent(path);
    let mut roots: BTreeMap<String, PathBuf> = request
        .roots
        .iter()
        .map(|(name, folder)| (name.to_owned(), absolute(folder)))
        .collect();
    for line in &mut lines {
        for side in [&mut line.front, &mut line.back] {
            for text in side.paths_mut() {
                let is_rooted = text
                    .split_once(':')
                    .is_some_and(|(name, _)| roots.contains_key(name));
                if is_rooted || is_url(&*text) || Path::new(text.as_str()).is_absolute() {
                    continue;
                }
                let inside = Path::new(text.as_str())
                    .components()
                    .all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
                *text = if inside {
                    format!("{MANIFEST_ROOT}:{text}")
                } else {
                    base.join(text.as_str()).to_string_lossy().into_owned()
                };
            }
        }
    }
    roots.entry(MANIFEST_ROOT.to_owned()).or_insert(base);
    let name = path
        .file_stem()
        .map_or_else(String::new, |s| s.to_string_lossy().into_owned());
    Ok(Content {
        name,
        roots,
        notes: Vec::new(),
        scenes: Scenes::Lines(lines),
    })
}
