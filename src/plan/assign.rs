//! Who is in which scene: every scene's id and its two photographs, and who stands in for whom.

use super::diode::SourceImage;
use super::split::divide;
use super::draw::keyed;
use super::expand::draw_line;
use super::pair::{Pair, pairs, pairs_between};
use super::recipe::Recipe;
use super::recipe_error::RecipeError;
use render::ids::SceneId;
use render::line::{SceneLine, Split};
use std::collections::{BTreeMap, BTreeSet};

/// The photographs of each split and source that has pairs.
type Parts<'a> = BTreeMap<(Split, &'a str), Vec<&'a SourceImage>>;

/// The scenes of a recipe, before anything is drawn.
pub struct Cast<'a> {
    /// Splits in the recipe's order, sources by name.
    roles: Vec<Role<'a>>,
    recipe: &'a Recipe,
    parts: Parts<'a>,
    excluded: &'a BTreeSet<String>,
}

/// A scene and its photographs.
#[derive(Clone, Debug)]
pub(super) struct Role<'a> {
    pub(super) id: SceneId,
    pub(super) split: Split,
    /// Names of the sources of the front and of the back.
    pub(super) sources: [&'a str; 2],
    pair: Pair<'a>,
}

impl Role<'_> {
    pub(super) fn is_of_one_place(&self, pair: &Pair<'_>) -> bool {
        self.sources[0] == self.sources[1] && pair.is_of_one_place()
    }

    pub(super) fn is_of_one_scan(&self, pair: &Pair<'_>) -> bool {
        self.sources[0] == self.sources[1] && pair.is_of_one_scan()
    }
}

/// A scene as it was drawn.
#[derive(Clone, Debug)]
pub struct Drawn {
    /// The scene.
    pub line: SceneLine,
    /// The attempt that the geometry did not refuse.
    pub attempt: u32,
    /// Its photographs are both indoors or both outdoors, of one source.
    pub same_place: bool,
    /// Its photographs are from one scan.
    pub same_scan: bool,
}

/// The name under which a photograph can be left out: `source:path of its colour image`.
pub fn photograph_name(source: &str, image: &SourceImage) -> String {
    format!("{source}:{}", image.color)
}

impl<'a> Cast<'a> {
    /// Divides the photographs among the splits and pairs them. Those `excluded` (see [`photograph_name`]) keep their places
    /// until the end, so that leaving one out changes only the scenes that it is in.
    pub fn new(
        recipe: &'a Recipe,
        sources: &'a BTreeMap<String, Vec<SourceImage>>,
        excluded: &'a BTreeSet<String>,
    ) -> Result<Self, RecipeError> {
        let parts = divide_all(recipe, sources)?;
        let mut roles = Vec::new();
        for split in &recipe.splits {
            for (key, &count) in &split.pairs {
                if count == 0 {
                    continue;
                }
                let names = sides(key);
                let split_name = split.name.to_string();
                let [front, back] = names.map(|name| parts[&(split.name, name)].as_slice());
                let shuffle = [split_name.as_str(), key.as_str()];
                let made = if names[0] == names[1] {
                    pairs(recipe.seed, shuffle, front, count)
                } else {
                    pairs_between(recipe.seed, shuffle, [front, back], count)
                };
                let label = key.replace('/', "-");
                roles.extend(made.into_iter().enumerate().map(|(number, pair)| {
                    Role {
                        id: SceneId::new(format!("{split_name}-{label}-{number:06}"))
                            .expect("names and digits make an id"),
                        split: split.name,
                        sources: names,
                        pair,
                    }
                }));
            }
        }
        Ok(Self {
            roles,
            recipe,
            parts,
            excluded,
        })
    }

    /// How many scenes there are.
    pub fn len(&self) -> usize {
        self.roles.len()
    }

    /// True of a recipe without scenes, which is refused.
    pub fn is_empty(&self) -> bool {
        self.roles.is_empty()
    }

    /// Draws scene `number` from attempt `from` on, with its photographs or, with `change` above 0, with two others.
    pub fn draw(&self, number: usize, change: u32, from: u32) -> Result<Drawn, RecipeError> {
        let role = &self.roles[number];
        let pair = self.pair(role, change)?;
        let (line, attempt) = draw_line(self.recipe, role, pair, from)?;
        Ok(Drawn {
            line,
            attempt,
            same_place: role.is_of_one_place(&pair),
            same_scan: role.is_of_one_scan(&pair),
        })
    }

    /// The photographs of a scene: those that the cast has for it, or with `change` above 0 two others. Photographs that
    /// are left out are stood in for, each by another of its part.
    fn pair(&self, role: &Role<'a>, change: u32) -> Result<Pair<'a>, RecipeError> {
        let is_out = |side: usize, image: &SourceImage| {
            self.excluded
                .contains(&photograph_name(role.sources[side], image))
        };
        let mut pair = role.pair;
        if change > 0 || is_out(0, pair.front) {
            pair.front = self.stand_in(role, 0, change, pair.back, role.pair.front)?;
        }
        if change > 0 || is_out(1, pair.back) {
            pair.back = self.stand_in(role, 1, change, pair.front, role.pair.back)?;
        }
        Ok(pair)
    }

    /// Another photograph for one side: of the place of the one that it stands in for, from another scan than its partner,
    /// where there is one. By rendezvous: which one it is depends on no other photograph.
    fn stand_in(
        &self,
        role: &Role<'a>,
        side: usize,
        change: u32,
        partner: &SourceImage,
        original: &SourceImage,
    ) -> Result<&'a SourceImage, RecipeError> {
        let source = role.sources[side];
        let part = &self.parts[&(role.split, source)];
        let same_source = role.sources[0] == role.sources[1];
        let number = change.to_string();
        let side_name = ["front", "back"][side];
        let fitness = |image: &SourceImage| {
            let key = [
                "stand-in",
                role.id.as_str(),
                side_name,
                &number,
                &image.color,
            ];
            (
                same_source && Pair::scan_of(image) == Pair::scan_of(partner),
                image.place != original.place,
                keyed(self.recipe.seed, &key),
            )
        };
        part.iter()
            .filter(|image| !self.excluded.contains(&photograph_name(source, image)))
            .filter(|image| !(same_source && image.color == partner.color))
            .min_by_key(|image| fitness(image))
            .copied()
            .ok_or_else(|| RecipeError::NoStandIn {
                id: role.id.clone(),
                source_name: source.to_owned(),
                split: role.split,
            })
    }
}

/// The sources of a pair's front and back: `NAME`, or `FRONT/BACK`.
pub(super) fn sides(key: &str) -> [&str; 2] {
    match key.split_once('/') {
        Some((front, back)) => [front, back],
        None => [key, key],
    }
}

fn divide_all<'a>(
    recipe: &'a Recipe,
    sources: &'a BTreeMap<String, Vec<SourceImage>>,
) -> Result<Parts<'a>, RecipeError> {
    let mut parts = BTreeMap::new();
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
        let images = sources.get(name).ok_or_else(|| RecipeError::NotIndexed {
            source_name: name.clone(),
        })?;
        let shares: Vec<f64> = wanted.iter().map(|(_, share)| *share).collect();
        let divided = divide(recipe.seed, name, images, &shares)?;
        for ((split, _), part) in wanted.into_iter().zip(divided) {
            parts.insert((split, name.as_str()), part);
        }
    }
    Ok(parts)
}
