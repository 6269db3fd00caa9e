//! Checks ranges, names and conflicting keys of a recipe before any scene is drawn. `source_check.rs` checks sources.

use super::assign::sides;
use super::glass_check::check_glass;
use super::limits::limit_of;
use super::places::depth_root;
use super::procedural_inputs::COVER_ROOT;
use super::recipe::{RECIPE_SCHEMA, Recipe};
use super::recipe_error::RecipeError;
use super::source::Layout;
use super::train_recipe::TrainRecipe;
use super::training::{FeatureSource, NetworkKind, ScheduleKind};
use glasshouse_line::ids::SceneId;
use glasshouse_line::layer::Layer;
use glasshouse_line::limits::Limit;
use glasshouse_line::param::Param;
use glasshouse_line::{CameraRecipe, is_root_name};
use std::collections::BTreeMap;

/// Largest number of pairs in a split: ids have six digits.
const MAX_PAIRS: u64 = 1_000_000;

impl Recipe {
    /// Checks everything that the TOML parser does not check.
    pub(super) fn check(&self) -> Result<(), RecipeError> {
        if self.schema != RECIPE_SCHEMA {
            return bad("schema", format!("is {:?}, but must be {RECIPE_SCHEMA:?}", self.schema));
        }
        if SceneId::new(self.name.as_str()).is_err() {
            return bad(
                "name",
                format!("is {:?}, but must be 1 to 128 characters of [A-Za-z0-9_-]", self.name),
            );
        }
        self.check_params()?;
        self.check_sources()?;
        self.check_splits()?;
        self.check_train()
    }

    /// Reports errors of `[train]` before any scene is traced.
    fn check_train(&self) -> Result<(), RecipeError> {
        let Some(trainings) = &self.train else {
            return Ok(());
        };
        trainings.check_names().or_else(|problem| bad("train", problem))?;
        trainings.0.iter().try_for_each(|training| self.check_training(training))
    }

    fn check_training(&self, training: &TrainRecipe) -> Result<(), RecipeError> {
        let TrainRecipe { name, settings, backtrack_steps, separation_steps, .. } = training;
        let table = name.as_ref().map_or("train".to_owned(), |name| format!("train[{name}]"));
        let key = |name: &str| format!("{table}.{name}");
        settings.validate().map_err(|e| RecipeError::Key {
            key: key(&format!("settings.{}", e.name)),
            problem: format!("is {}, but must be {}", e.value, e.expected),
        })?;
        match (settings.features, &training.features) {
            (FeatureSource::File, None) => {
                return bad(
                    &key("settings.features"),
                    "is \"file\", so that the training needs features = \"FILE\", the file of VGG-19's weights",
                );
            }
            (FeatureSource::None | FeatureSource::Random, Some(_)) => {
                return bad(
                    &key("features"),
                    "names a file of weights, but settings.features is not \"file\": set it, or remove the file",
                );
            }
            _ => {}
        }
        if settings.network == NetworkKind::Unet && *backtrack_steps > 0 {
            return bad(
                &key("backtrack_steps"),
                format!("is {backtrack_steps}, but a U-Net has no BT-net: set it to 0"),
            );
        }
        let last = settings.schedule_steps;
        if settings.schedule == ScheduleKind::Cosine && (1..*separation_steps).contains(&last) {
            return bad(
                &key("settings.schedule_steps"),
                format!(
                    "is {last}, but separation_steps is {separation_steps}: the rate is 0 after the cosine"
                ),
            );
        }
        if settings.real_share > 0.0 {
            return bad(
                &key("settings.real_share"),
                "is above 0, but a recipe has no real pairs: remove [train] and run `glasshouse train --real DIR`",
            );
        }
        for (side_key, side) in [("width", &self.film.width), ("height", &self.film.height)] {
            let (least, _) = side.bounds();
            if least < settings.crop_px as f64 {
                return bad(
                    &key("settings.crop_px"),
                    format!(
                        "is {}, but film.{side_key} can be {least}: set crop_px to {least} or less",
                        settings.crop_px
                    ),
                );
            }
        }
        Ok(())
    }

    fn check_params(&self) -> Result<(), RecipeError> {
        for number in self.numbers() {
            number_within(&number.path, number.param, number.limit)?;
        }
        let constants = [
            (
                "light.auto_exposure.percentile",
                self.light.auto_exposure.map(|auto| auto.percentile),
            ),
            ("light.auto_exposure.level", self.light.auto_exposure.map(|auto| auto.level)),
        ];
        for (key, value) in constants {
            if let Some(value) = value {
                within(key, &Param::Constant(value))?;
            }
        }
        let camera = &self.camera;
        if camera.f_number.is_some()
            && camera.aperture_radius_m != CameraRecipe::default().aperture_radius_m
        {
            return bad("camera.f_number", "conflicts with aperture_radius_m: remove one of them");
        }
        check_glass(&self.glass)?;
        self.check_front_illuminant_share()?;
        self.check_cover()?;
        if let Some(sensor) = &self.sensor {
            if !self.film.layers.asked()[Layer::Input] {
                return bad("sensor", "photographs the input, but film.layers lacks it: add input");
            }
            sensor.check()?;
        }
        self.check_reject()
    }

    fn check_front_illuminant_share(&self) -> Result<(), RecipeError> {
        let key = "back.front_illuminant_share";
        let Some(share) = self.back.front_illuminant_share else {
            return Ok(());
        };
        if !(share > 0.0 && share <= 1.0) {
            return bad(
                key,
                format!("is {share}, but must be above 0 and at most 1; leave it out for none"),
            );
        }
        if self.front.illuminant_k.is_none() && self.back.illuminant_k.is_none() {
            return bad(key, "does nothing, because neither side has an illuminant_k: remove it");
        }
        Ok(())
    }

    fn check_cover(&self) -> Result<(), RecipeError> {
        let Some(cover) = &self.cover else {
            return Ok(());
        };
        if cover.frame.is_some() && self.glass.outline.is_some() {
            return bad(
                "cover.frame",
                "draws the edges of the glass, and glass.outline gives them, too: remove one",
            );
        }
        if self.sources.contains_key(COVER_ROOT) {
            return bad(
                &format!("sources.{COVER_ROOT}"),
                "has the name of the root of [cover]: rename the source",
            );
        }
        cover.check()
    }

    fn check_reject(&self) -> Result<(), RecipeError> {
        let Some(reject) = &self.reject else {
            return Ok(());
        };
        for (key, range) in reject.bounds() {
            if let Some([least, most]) = range
                && !(least.is_finite() && most.is_finite() && least <= most)
            {
                return bad(
                    &format!("reject.{key}"),
                    format!("is {least} to {most}: write two finite numbers, the smaller first"),
                );
            }
        }
        Ok(())
    }

    fn check_sources(&self) -> Result<(), RecipeError> {
        let mut source_of_photographs: BTreeMap<String, &str> = BTreeMap::new();
        for (name, source) in &self.sources {
            let key = format!("sources.{name}");
            if !is_root_name(name) {
                return bad(&key, "must have a name of two or more characters of [A-Za-z0-9_-]");
            }
            source.check(&key)?;
            if source.layout == Layout::Places && self.sources.contains_key(&depth_root(name)) {
                let taken = depth_root(name);
                let problem = format!(
                    "has its depth maps under the root {taken}, which is also a source: rename one of them"
                );
                return bad(&key, problem);
            }
            let photographs = match source.layout {
                Layout::Sample => format!("seed {}", source.seed.unwrap_or(self.seed)),
                Layout::Diode | Layout::Places | Layout::List | Layout::Folder => {
                    format!("root {:?}", source.root.as_deref().unwrap_or(name))
                }
            };
            if let Some(other) = source_of_photographs.get(&photographs) {
                return bad(
                    &key,
                    format!(
                        "has {photographs} like source {other}, so two splits could share photographs: use one source"
                    ),
                );
            }
            source_of_photographs.insert(photographs, name);
        }
        Ok(())
    }

    fn check_splits(&self) -> Result<(), RecipeError> {
        let mut seen = Vec::new();
        for split in &self.splits {
            let key = format!("split {}", split.name);
            if seen.contains(&split.name) {
                return bad(&key, "is given twice: merge the two into one [[split]]");
            }
            seen.push(split.name);
            let mut labels = BTreeMap::new();
            for pair in split.pairs.keys() {
                for name in sides(pair) {
                    if !self.sources.contains_key(name) {
                        let known: Vec<_> = self.sources.keys().map(String::as_str).collect();
                        return bad(
                            &format!("{key}, pairs.{pair}"),
                            format!(
                                "is not a source: the recipe has {}; add [sources.{name}], or write FRONT/BACK for two sources",
                                known.join(", ")
                            ),
                        );
                    }
                }
                // Scene ids contain the label.
                if let Some(other) = labels.insert(pair.replace('/', "-"), pair) {
                    return bad(
                        &format!("{key}, pairs.{pair}"),
                        format!("would give its scenes the ids of {other:?}: rename a source"),
                    );
                }
            }
            if !(split.photographs() > 0.0 && split.photographs() <= 1.0) {
                return bad(
                    &format!("{key}, photographs"),
                    format!("is {}, but must be above 0 and at most 1", split.photographs()),
                );
            }
            let pairs: u64 = split.pairs.values().copied().map(u64::from).sum();
            if !(1..=MAX_PAIRS).contains(&pairs) {
                return bad(
                    &format!("{key}, pairs"),
                    format!("add up to {pairs}, but must be 1 to {MAX_PAIRS}"),
                );
            }
        }
        if self.splits.is_empty() {
            return bad("split", "has no entry: add [[split]] with a name and pairs");
        }
        Ok(())
    }
}

/// Returns an error of the recipe under `key`.
pub(super) fn bad(key: &str, problem: impl Into<String>) -> Result<(), RecipeError> {
    Err(RecipeError::Key { key: key.to_owned(), problem: problem.into() })
}

/// Checks all values that `param` may take, except those of `from_source`, against the table of limits.
pub(super) fn within(key: &str, param: &Param) -> Result<(), RecipeError> {
    number_within(key, param, limit_of(key))
}

fn number_within(key: &str, param: &Param, limit: Limit) -> Result<(), RecipeError> {
    // Draws of all other distributions are not whole numbers.
    if limit.is_whole() && !matches!(param, Param::Constant(_) | Param::Choice(_)) {
        return bad(key, "must be a whole number or { choice = [..] } of whole numbers");
    }
    let Some(value) = param.outside(limit) else {
        return Ok(());
    };
    let whole = if limit.is_whole() { "whole and " } else { "" };
    let found = if param.is_constant() {
        format!("is {value}")
    } else {
        format!("({param}) can be {value}")
    };
    bad(key, format!("{found}, but must be {whole}{}", limit.allowed))
}

#[cfg(test)]
mod tests {
    use super::super::recipe::tests::PAPER;
    use super::*;

    #[test]
    fn errors_name_the_key_or_the_line() {
        for (from, to, message) in [
            ("ior = 1.6", "iro = 1.6", "unknown field `iro`"),
            ("ior = 1.6", "iro = 1.6", "line 16"),
            ("[glass]", "[glas]", "unknown field `glas`"),
            ("ior = 1.6", "ior = 0.9", "key glass.ior is 0.9, but must be 1 to 10"),
            (
                "ior = 1.6",
                "ior = { uniform = [0.5, 2] }",
                "glass.ior (uniform 0.5 to 2) can be 0.5",
            ),
            ("ior = 1.6", "tilt_deg = [1]", "invalid length 1"),
            ("spp = 256", "spp = 100", "film.spp is 100, but must be whole and a power of two"),
            ("spp = 256", "spp = { uniform = [1, 9] }", "film.spp must be a whole number or"),
            ("width = 256", "width = 25.5", "film.width is 25.5"),
            ("\"front_center\"", "\"front\"", "expected \"front_center\", \"back_center\""),
            ("\"front_center\"", "-1", "camera.focus is -1"),
            ("recipe/1", "recipe/2", "key schema is \"glasshouse.recipe/2\""),
            (
                "layout = \"diode\"",
                "layout = \"kitti\"",
                "unknown variant `kitti`, expected one of `diode`, `sample`",
            ),
            (
                "root = \"diode\"",
                "count = 3",
                "sources.diode.count does not belong to layout \"diode\"",
            ),
            (
                "root = \"places\"",
                "root = \"diode\"",
                "sources.places has root \"diode\" like source diode",
            ),
            (
                "root = \"diode\"",
                "intrinsics = { fx = 0, fy = 1, cx = 1, cy = 1 }",
                "sources.diode.intrinsics.fx is 0",
            ),
            ("[sources.diode]", "[sources.d]", "sources.d must have a name of two or more"),
            ("name = \"test\"", "name = \"train\"", "split train is given twice"),
            (
                "name = \"test\"",
                "name = \"val\"",
                "unknown variant `val`, expected one of `train`, `validation`, `test`",
            ),
            (
                "diode = 120",
                "dioed = 120",
                "pairs.dioed is not a source: the recipe has diode, places",
            ),
            ("diode = 120, places = 80", "diode = 0", "add up to 0"),
            ("seed = 2020", "seed = -1", "line 4"),
        ] {
            let text = PAPER.replacen(from, to, 1);
            assert_ne!(text, PAPER, "{from}");
            let error = Recipe::parse(&text).unwrap_err().to_string();
            assert!(error.contains(message), "{to}: {error}");
        }
    }
}
