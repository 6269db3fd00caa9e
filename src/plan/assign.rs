//! Assigns ids and photographs (front and back) to scenes, and replaces excluded photographs.

use super::diode::SourceImage;
use super::draw::keyed;
use super::expand::draw_line;
use super::pair::{Pair, pairs, pairs_between};
use super::recipe::Recipe;
use super::recipe_error::RecipeError;
use super::split::split_photographs;
use glasshouse_line::ids::SceneId;
use glasshouse_line::{SceneLine, Split};
use std::collections::{BTreeMap, BTreeSet};

/// Photographs by split and source, for the sources that have pairs.
type Subsets<'a> = BTreeMap<(Split, &'a str), Vec<&'a SourceImage>>;

/// The scenes of a recipe with their photographs, before any parameter is drawn.
pub(crate) struct Assignment<'a> {
    /// Scenes in the order of the recipe's splits, then of the keys of `pairs`.
    scenes: Vec<AssignedScene<'a>>,
    recipe: &'a Recipe,
    subsets: Subsets<'a>,
    excluded: &'a BTreeSet<String>,
}

/// A scene's id and photographs.
#[derive(Clone, Debug)]
pub(super) struct AssignedScene<'a> {
    pub(super) id: SceneId,
    pub(super) split: Split,
    /// Source names of front and back.
    pub(super) sources: [&'a str; 2],
    pair: Pair<'a>,
}

impl AssignedScene<'_> {
    pub(super) fn is_same_place(&self, pair: &Pair<'_>) -> bool {
        self.sources[0] == self.sources[1] && pair.is_same_place()
    }

    pub(super) fn is_same_scan(&self, pair: &Pair<'_>) -> bool {
        self.sources[0] == self.sources[1] && pair.is_same_scan()
    }
}

/// One draw of a scene.
#[derive(Clone, Debug)]
pub(crate) struct Drawn {
    pub line: SceneLine,
    /// Number of the attempt that passed the geometry check.
    pub attempt: u32,
    /// True if both photographs are from one source, and both indoors or both outdoors.
    pub same_place: bool,
    /// True if both photographs are from one scan.
    pub same_scan: bool,
}

/// Returns the name under which a photograph is excluded: `SOURCE:PATH`, with the path of the colour image.
pub(crate) fn photograph_name(source: &str, image: &SourceImage) -> String {
    format!("{source}:{}", image.color)
}

/// Returns the numbers of `only` of `count` scenes, at equal distances; without it, of all.
pub(super) fn spread(count: usize, only: Option<usize>) -> impl ExactSizeIterator<Item = usize> {
    let some = only.unwrap_or(count).min(count);
    (0..some).map(move |k| k * count / some)
}

impl<'a> Assignment<'a> {
    /// Splits and pairs all photographs. [`Self::draw`] replaces those in `excluded` (see [`photograph_name`]) later,
    /// so that excluding a photograph changes only the scenes that use it.
    pub(crate) fn new(
        recipe: &'a Recipe,
        sources: &'a BTreeMap<String, Vec<SourceImage>>,
        excluded: &'a BTreeSet<String>,
    ) -> Result<Self, RecipeError> {
        let subsets = split_all(recipe, sources)?;
        let mut scenes = Vec::new();
        for split in &recipe.splits {
            for (key, &count) in &split.pairs {
                if count == 0 {
                    continue;
                }
                let names = sides(key);
                let split_name = split.name.to_string();
                let [front, back] = names.map(|name| subsets[&(split.name, name)].as_slice());
                let shuffle = [split_name.as_str(), key.as_str()];
                let made = if names[0] == names[1] {
                    pairs(recipe.seed, shuffle, front, count)
                } else {
                    pairs_between(recipe.seed, shuffle, [front, back], count)
                };
                let label = key.replace('/', "-");
                scenes.extend(made.into_iter().enumerate().map(|(number, pair)| {
                    AssignedScene {
                        id: SceneId::new(format!("{split_name}-{label}-{number:06}"))
                            .expect("names and digits form a valid id"),
                        split: split.name,
                        sources: names,
                        pair,
                    }
                }));
            }
        }
        Ok(Self { scenes, recipe, subsets, excluded })
    }

    pub(crate) fn len(&self) -> usize {
        self.scenes.len()
    }

    /// Draws scene `number`, starting with attempt `from`. Each `change` above 0 is a new random selection of both
    /// photographs.
    pub(crate) fn draw(&self, number: usize, change: u32, from: u32) -> Result<Drawn, RecipeError> {
        let scene = &self.scenes[number];
        let pair = self.pair(scene, change)?;
        let (line, attempt) = draw_line(self.recipe, scene, pair, from)?;
        Ok(Drawn {
            line,
            attempt,
            same_place: scene.is_same_place(&pair),
            same_scan: scene.is_same_scan(&pair),
        })
    }

    /// Returns the photographs of a scene: the assigned ones, or a new selection for each `change` above 0. Replaces an
    /// excluded photograph with another of its subset.
    fn pair(&self, scene: &AssignedScene<'a>, change: u32) -> Result<Pair<'a>, RecipeError> {
        let is_out = |side: usize, image: &SourceImage| {
            self.excluded.contains(&photograph_name(scene.sources[side], image))
        };
        let mut pair = scene.pair;
        if change > 0 || is_out(0, pair.front) {
            pair.front = self.substitute(scene, 0, change, pair.back, scene.pair.front)?;
        }
        if change > 0 || is_out(1, pair.back) {
            pair.back = self.substitute(scene, 1, change, pair.front, scene.pair.back)?;
        }
        Ok(pair)
    }

    /// Selects a photograph for one side: if possible, from a different scan than the partner, and of the same place as
    /// the original. May select the original again if it is not excluded. Rendezvous hashing keeps the choice when the
    /// subset loses other photographs.
    fn substitute(
        &self,
        scene: &AssignedScene<'a>,
        side: usize,
        change: u32,
        partner: &SourceImage,
        original: &SourceImage,
    ) -> Result<&'a SourceImage, RecipeError> {
        let source = scene.sources[side];
        let subset = &self.subsets[&(scene.split, source)];
        let same_source = scene.sources[0] == scene.sources[1];
        let is_partner = |image: &SourceImage| {
            same_source && image.color == partner.color || image.is_shared_with(partner)
        };
        let number = change.to_string();
        let side_name = ["front", "back"][side];
        let fitness = |image: &SourceImage| {
            let key = ["stand-in", scene.id.as_str(), side_name, &number, &image.color];
            (
                same_source && Pair::scan_of(image) == Pair::scan_of(partner),
                image.place != original.place,
                keyed(self.recipe.seed, &key),
            )
        };
        subset
            .iter()
            .filter(|image| !self.excluded.contains(&photograph_name(source, image)))
            .filter(|image| !is_partner(image))
            .min_by_key(|image| fitness(image))
            .copied()
            .ok_or_else(|| RecipeError::NoSubstitute {
                id: scene.id.clone(),
                source_name: source.to_owned(),
                split: scene.split,
            })
    }
}

/// Returns the sources of a pair's front and back. `key` is `NAME`, or `FRONT/BACK`.
pub(super) fn sides(key: &str) -> [&str; 2] {
    match key.split_once('/') {
        Some((front, back)) => [front, back],
        None => [key, key],
    }
}

fn split_all<'a>(
    recipe: &'a Recipe,
    sources: &'a BTreeMap<String, Vec<SourceImage>>,
) -> Result<Subsets<'a>, RecipeError> {
    let mut subsets: Subsets<'a> = BTreeMap::new();
    // Splits of the photographs that several sources have.
    let mut split_of: BTreeMap<usize, Split> = BTreeMap::new();
    for name in recipe.sources.keys() {
        let uses = |key: &str| sides(key).contains(&name.as_str());
        let wanted: Vec<(Split, f64)> = recipe
            .splits
            .iter()
            .filter(|split| split.pairs.iter().any(|(key, n)| *n > 0 && uses(key)))
            .map(|split| (split.name, split.photographs()))
            .collect();
        if wanted.is_empty() {
            continue;
        }
        let images = sources
            .get(name)
            .ok_or_else(|| RecipeError::NotIndexed { source_name: name.clone() })?;
        let shares: Vec<f64> = wanted.iter().map(|(_, share)| *share).collect();
        let split = split_photographs(recipe.seed, name, images, &shares)?;
        for ((own, _), subset) in wanted.iter().zip(split) {
            for image in subset {
                let split = image.shared.map_or(*own, |n| *split_of.entry(n).or_insert(*own));
                // A photograph of another source's split stays out of a source without that split.
                if wanted.iter().any(|(wanted, _)| *wanted == split) {
                    subsets.entry((split, name.as_str())).or_default().push(image);
                }
            }
        }
        for (split, _) in wanted {
            if subsets.get(&(split, name.as_str())).is_none_or(|subset| subset.len() < 2) {
                return Err(RecipeError::SharedPhotographs { source_name: name.clone(), split });
            }
        }
    }
    Ok(subsets)
}
