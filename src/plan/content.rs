//! The content of a recipe or a manifest: scenes, roots of their files, notes.

use super::assign::spread;
use super::copies::{copies, number_shared};
use super::diode::{Index, SourceImage, from_paths, index_paths, index_source};
use super::draw_scenes::{DrawnScenes, PreviewContext, RejectedScene, draw_all};
use super::expand::{Expansion, expand_counted};
use super::folder::index_folder;
use super::inputs::list_objects;
use super::list::{LIST_NAME, index_list};
use super::places::{PlacesFolders, index_places};
use super::procedural_inputs::{
    COVER_ROOT, ProceduralBytes, ProceduralInput, ProceduralPicture, covers,
};
use super::recipe::Recipe;
use super::recipe_error::RecipeError;
use super::request::{DraftError, Progress, Request};
use super::rooting::root_paths;
use super::source::{Layout, Source};
use glasshouse_line::{Roots, SceneLine, is_url, parse_jsonl};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// A parsed recipe or manifest with its photographs listed; nothing is drawn or written yet.
pub(super) struct Content {
    pub(super) name: String,
    /// Root folders for the spec; relative paths are below the run's folder.
    pub(super) roots: BTreeMap<String, PathBuf>,
    /// Remarks about the listing of photographs.
    notes: Vec<String>,
    scenes: Scenes,
}

/// The scenes, or the recipe that draws them.
enum Scenes {
    /// A recipe with the photographs of its sources; `to_make` lists the procedural pictures.
    Drawn {
        path: PathBuf,
        recipe: Box<Recipe>,
        images: BTreeMap<String, Vec<SourceImage>>,
        to_make: Vec<ProceduralInput>,
    },
    /// The lines of a manifest.
    Lines(Vec<SceneLine>),
}

/// Scenes of a plan, with notes, rejected draws and procedural pictures.
pub(super) struct Draft {
    pub(super) lines: Vec<SceneLine>,
    pub(super) notes: Vec<String>,
    /// Draws that the previews rejected.
    pub(super) rejected: Vec<RejectedScene>,
    /// Procedural pictures that the scenes use.
    pub(super) to_make: Vec<ProceduralInput>,
}

impl Content {
    /// Returns the scenes of [`Self::draft`] before any preview.
    pub(super) fn first_lines(
        &self,
        left_out: &BTreeSet<String>,
        only: Option<usize>,
    ) -> Result<Vec<SceneLine>, DraftError> {
        match &self.scenes {
            Scenes::Drawn { path, recipe, images, .. } => {
                Ok(expand_counted(recipe, images, left_out, only)
                    .map_err(|source| recipe_error(path, source))?
                    .lines)
            }
            Scenes::Lines(all) => {
                let lines = spread(all.len(), only).map(|number| &all[number]);
                let stays = |line: &&SceneLine| !left_out.contains(line.id.as_str());
                Ok(lines.filter(stays).cloned().collect())
            }
        }
    }

    /// Draws the scenes, with substitutes for left-out photographs. For a manifest, drops the left-out scenes.
    pub(super) fn draft(
        &self,
        left_out: &BTreeSet<String>,
        request: &Request,
        on_progress: &Progress,
    ) -> Result<Draft, DraftError> {
        let mut notes = self.notes.clone();
        let Scenes::Drawn { path, recipe, images, to_make } = &self.scenes else {
            return Ok(Draft {
                lines: self.first_lines(left_out, request.only)?,
                notes,
                rejected: Vec::new(),
                to_make: Vec::new(),
            });
        };
        let bytes = ProceduralBytes::new(request, to_make);
        let mut folders = Roots::default();
        for (name, folder) in &self.roots {
            folders.insert(name, request.run.join(folder))?;
        }
        let context = PreviewContext {
            roots: &folders,
            base: request.run,
            read: &|path| bytes.read(path).unwrap_or_else(|| request.inputs.read(path)),
            planned: request.planned,
            only: request.only,
            threads: request.threads,
            on_scene: &|done, all| on_progress("scenes previewed", done, all),
        };
        let drawn = draw_all(recipe, images, left_out, &context)
            .map_err(|source| recipe_error(path, source))?;
        let DrawnScenes { expansion, rejected, scenes } = drawn;
        let Expansion { lines, same_place, same_scan, redrawn } = expansion;
        if lines.len() < scenes {
            return Err(DraftError::OtherScenes { name: self.name.clone(), lines, scenes });
        }
        if !rejected.is_empty() {
            let draws = lines.len() + rejected.len();
            notes.push(format!(
                "{} of {draws} previewed draws were rejected ({:.1} %) and drawn again",
                rejected.len(),
                100.0 * rejected.len() as f64 / draws as f64,
            ));
        }
        for (count, what) in [
            (
                same_place,
                "scenes pair two indoor or two outdoor photographs: no others were available",
            ),
            (same_scan, "scenes pair two photographs of one scan: no others were available"),
            (redrawn, "draws failed the geometry check and were repeated"),
        ] {
            if count > 0 {
                notes.push(format!("{count} {what}"));
            }
        }
        let used: BTreeSet<&str> =
            lines.iter().flat_map(SceneLine::paths).map(|(_, path)| path).collect();
        let is_used = |one: &ProceduralInput| used.contains(one.name().as_str());
        bytes.remove_unless(is_used);
        let to_make = to_make.iter().filter(|one| is_used(one)).cloned().collect();
        Ok(Draft { lines, notes, rejected, to_make })
    }

    /// Names the photographs of `line` (for a manifest: the scene) to leave out if the file `path` is unusable.
    pub(super) fn names_to_leave_out(&self, line: &SceneLine, path: &str) -> Vec<String> {
        if let Scenes::Lines(_) = self.scenes {
            return vec![line.id.to_string()];
        }
        let sides = [&line.front, &line.back].into_iter();
        sides
            .filter(|side| side.paths().iter().any(|(_, p)| *p == path))
            .map(|side| side.name().to_owned())
            .collect()
    }

    /// Returns the kind of entries that can be left out: "photographs" or "scenes".
    pub(super) fn left_out_kind(&self) -> &'static str {
        match self.scenes {
            Scenes::Drawn { .. } => "photographs",
            Scenes::Lines(_) => "scenes",
        }
    }

    /// Returns the kind of entries and the effect of leaving them out, for a message.
    pub(super) fn left_out_effect(&self) -> &'static str {
        match self.scenes {
            Scenes::Drawn { .. } => "photographs and draws others instead",
            Scenes::Lines(_) => "scenes",
        }
    }

    pub(super) fn is_manifest(&self) -> bool {
        matches!(self.scenes, Scenes::Lines(_))
    }

    /// Returns the roots of files that planning writes.
    pub(super) fn own_roots(&self) -> BTreeSet<&str> {
        match &self.scenes {
            Scenes::Drawn { to_make, .. } => to_make.iter().map(|m| m.root.as_str()).collect(),
            Scenes::Lines(_) => BTreeSet::new(),
        }
    }
}

fn recipe_error(path: &Path, source: RecipeError) -> DraftError {
    DraftError::Recipe { path: path.to_owned(), source: Box::new(source) }
}

/// Makes a path absolute; URLs stay unchanged.
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

/// Lists the photographs of a PLACES365 source, on a disk or in an object store.
fn places(
    name: &str,
    source: &Source,
    [color, depth]: [&Path; 2],
    base: &Path,
    request: &Request,
) -> Result<Index, DraftError> {
    let table = base.join(source.depth_ranges.as_deref().unwrap_or_default());
    let folders = PlacesFolders { color, depth, table: &table };
    let mut listed = BTreeMap::new();
    for folder in [color, depth] {
        if is_url(folder) {
            listed.insert(folder, list_objects(folder, request.inputs)?);
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
    let recipe = Recipe::parse(text).map_err(|source| recipe_error(path, source))?;
    let sources = recipe.sources.iter();
    let known = sources.flat_map(|(name, source)| {
        let depth = (source.layout == Layout::Places).then(|| format!("{name}-depth"));
        [Some(name.clone()), depth]
    });
    check_roots(path, request, known.flatten().collect())?;
    let folders = recipe.roots(&parent(path), request.roots);
    let mut roots: BTreeMap<String, PathBuf> =
        folders.iter().map(|(name, folder)| (name.to_owned(), absolute(folder))).collect();
    let mut images = BTreeMap::new();
    let mut notes = Vec::new();
    let mut to_make = Vec::new();
    for (name, source) in &recipe.sources {
        let mut index: Index = if source.layout == Layout::Sample {
            let seed = source.seed.unwrap_or(recipe.seed);
            let mut photographs = procedural::listing(source.count.unwrap_or(0) as usize, seed);
            let is_textured = source.textured.unwrap_or(false);
            for photograph in &mut photographs {
                photograph.is_textured = is_textured;
            }
            let paths: Vec<String> = photographs
                .iter()
                .flat_map(|p| [p.color_path(), p.depth_path(), p.mask_path()])
                .map(|p| p.to_string_lossy().into_owned())
                .collect();
            let size = source.sample_size();
            to_make.extend(photographs.into_iter().map(|photograph| ProceduralInput {
                root: name.clone(),
                picture: ProceduralPicture::Photograph { photograph, size },
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
            } else if source.layout == Layout::Folder {
                index_folder(name, &folder, source, request.inputs)?
            } else if source.layout == Layout::List {
                let list = match &source.list {
                    Some(list) => parent(path).join(list),
                    None => folder.join(LIST_NAME),
                };
                index_list(name, &list, request.inputs.read(&list))?
            } else if is_url(&folder) {
                index_paths(name, &folder, &list_objects(&folder, request.inputs)?)?
            } else {
                index_source(name, &folder)?
            }
        };
        if let Some(folder) = folders.get(name) {
            let copies = copies(folder, &mut index.images, |image| &image.color);
            index.notes.extend(copies.notes());
        }
        notes.extend(index.notes.iter().map(|note| format!("source {name}: {note}")));
        if let Some(first) = index.without_depth.first() {
            let count = index.without_depth.len();
            notes.push(format!(
                "source {name}: {count} images have no depth and are left out (first: {first})"
            ));
        }
        images.insert(name.clone(), index.images);
    }
    number_shared(&mut images, |name| folders.get(name));
    if recipe.cover.is_some() {
        to_make.extend(covers(&recipe));
        roots.insert(COVER_ROOT.to_owned(), Path::new("inputs").join(COVER_ROOT));
    }
    Ok(Content {
        name: recipe.name.clone(),
        roots,
        notes,
        scenes: Scenes::Drawn { path: path.to_owned(), recipe: Box::new(recipe), images, to_make },
    })
}

/// Refuses a root on the command line that nothing uses: its name is probably mistyped.
fn check_roots(path: &Path, request: &Request, known: BTreeSet<String>) -> Result<(), DraftError> {
    match request.roots.iter().find(|(name, _)| !known.contains(*name)) {
        None => Ok(()),
        Some((name, _)) => Err(DraftError::UnknownRoot {
            path: path.to_owned(),
            name: name.to_owned(),
            known: known.into_iter().collect(),
        }),
    }
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
    let mut roots: BTreeMap<String, PathBuf> =
        request.roots.iter().map(|(name, folder)| (name.to_owned(), absolute(folder))).collect();
    // Plans of older versions have absolute paths, new ones have roots.
    let is_absolute = |(_, path): (_, &str)| Path::new(path).is_absolute();
    let keeps_absolute =
        request.planned.iter().copied().flatten().flat_map(SceneLine::paths).any(is_absolute);
    root_paths(&mut lines, base, &mut roots, keeps_absolute);
    let name = path.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned());
    Ok(Content { name, roots, notes: Vec::new(), scenes: Scenes::Lines(lines) })
}
