//! Whether a recipe makes sense before anything is drawn: ranges, names, keys that go together.

use super::cast::sides;
use super::focus::FocusRecipe;
use super::param::Param;
use super::places::depth_root;
use super::recipe::{CameraRecipe, RECIPE_SCHEMA, Recipe};
use super::recipe_error::RecipeError;
use super::source::{Layout, Source};
use super::training::{FeatureSource, TrainRecipe};
use render::ids::SceneId;
use render::line::is_root_name;
use render::line::limits::{self, Limit};
use render::line::{DepthKind, Fill, Intrinsics, Transfer};
use std::collections::BTreeMap;

/// Most pairs of one split: ids have six digits.
const MAX_PAIRS: u64 = 1_000_000;

impl Recipe {
    /// Everything that the TOML reader cannot tell.
    pub(super) fn check(&self) -> Result<(), RecipeError> {
        if self.schema != RECIPE_SCHEMA {
            return bad(
                "schema",
                format!("is {:?}, but must be {RECIPE_SCHEMA:?}", self.schema),
            );
        }
        if SceneId::new(self.name.as_str()).is_err() {
            return bad(
                "name",
                format!("is {:?}, but must be 1 to 128 of [A-Za-z0-9_-]", self.name),
            );
        }
        self.check_params()?;
        self.check_sources()?;
        self.check_splits()?;
        self.check_train()
    }

    /// What would end the training when all scenes have been traced is said before.
    fn check_train(&self) -> Result<(), RecipeError> {
        let Some(TrainRecipe { settings, .. }) = &self.train else {
            return Ok(());
        };
        settings.validate().map_err(|e| RecipeError::Key {
            key: format!("train.settings.{}", e.name),
            problem: format!("is {}, but must be {}", e.value, e.expected),
        })?;
        if settings.features == FeatureSource::File {
            return bad(
                "train.settings.features",
                "is \"file\", which a recipe cannot name: leave [train] away and give the file to `glasshouse train --features FILE`".to_owned(),
            );
        }
        if settings.real_share > 0.0 {
            return bad(
                "train.settings.real_share",
                "is above 0, but a recipe has no real pairs: leave [train] away and give them to `glasshouse train --real DIR`".to_owned(),
            );
        }
        for (key, side) in [("width", &self.film.width), ("height", &self.film.height)] {
            let (least, _) = side.bounds();
            if least < settings.crop_px as f64 {
                return bad(
                    "train.settings.crop_px",
                    format!(
                        "is {}, but film.{key} may be {least}: make it as small",
                        settings.crop_px
                    ),
                );
            }
        }
        Ok(())
    }

    fn check_params(&self) -> Result<(), RecipeError> {
        let (film, camera, glass) = (&self.film, &self.camera, &self.glass);
        whole("film.width", &film.width, limits::FILM_SIDE.allowed, |v| {
            limits::FILM_SIDE.contains(v)
        })?;
        whole(
            "film.height",
            &film.height,
            limits::FILM_SIDE.allowed,
            |v| limits::FILM_SIDE.contains(v),
        )?;
        whole(
            "film.spp",
            &film.spp,
            limits::SPP.allowed,
            limits::is_sample_count,
        )?;
        if let Some(target) = film.target_error {
            within(
                "film.target_error",
                &Param::Constant(target),
                limits::TARGET_ERROR,
            )?;
        }
        let [red, green, blue] = &glass.absorption_per_m;
        let [pitch, yaw] = &glass.tilt_deg;
        let params = [
            (
                "film.order_tolerance",
                &film.order_tolerance,
                limits::ORDER_TOLERANCE,
            ),
            (
                "camera.focal_length_mm",
                &camera.focal_length_mm,
                limits::FOCAL_LENGTH_MM,
            ),
            (
                "camera.aperture_radius_m",
                &camera.aperture_radius_m,
                limits::APERTURE_RADIUS_M,
            ),
            (
                "glass.distance_m",
                &glass.distance_m,
                limits::GLASS_DISTANCE_M,
            ),
            ("glass.thickness_m", &glass.thickness_m, limits::THICKNESS_M),
            ("glass.ior", &glass.ior, limits::IOR),
            ("glass.absorption_per_m[0]", red, limits::ABSORPTION_PER_M),
            ("glass.absorption_per_m[1]", green, limits::ABSORPTION_PER_M),
            ("glass.absorption_per_m[2]", blue, limits::ABSORPTION_PER_M),
            ("glass.tilt_deg[0]", pitch, limits::TILT_DEG),
            ("glass.tilt_deg[1]", yaw, limits::TILT_DEG),
            ("front.exposure", &self.front.exposure, limits::EXPOSURE),
            ("back.exposure", &self.back.exposure, limits::EXPOSURE),
        ];
        for (key, param, limit) in params {
            within(key, param, limit)?;
        }
        for focus in camera.focus.each() {
            if let FocusRecipe::DistanceM(param) = focus {
                within("camera.focus", param, limits::FOCUS_DISTANCE_M)?;
            }
        }
        if let Some(f_number) = &camera.f_number {
            within("camera.f_number", f_number, limits::F_NUMBER)?;
            if camera.aperture_radius_m != CameraRecipe::default().aperture_radius_m {
                return bad(
                    "camera.f_number",
                    "says what aperture_radius_m says: remove one of them",
                );
            }
        }
        self.check_light()
    }

    fn check_light(&self) -> Result<(), RecipeError> {
        for (name, side) in [("front", self.front.light()), ("back", self.back.light())] {
            for (key, param, limit) in [
                ("exposure_ev", side.exposure_ev, limits::EXPOSURE_EV),
                ("illuminant_k", side.illuminant_k, limits::ILLUMINANT_K),
            ] {
                if let Some(param) = param {
                    within(&format!("{name}.{key}"), param, limit)?;
                }
            }
        }
        if let Some(auto) = &self.light.auto_exposure {
            for (key, value, limit) in [
                ("percentile", auto.percentile, limits::PERCENTILE),
                ("level", auto.level, limits::ABOVE_0),
            ] {
                let key = format!("light.auto_exposure.{key}");
                within(&key, &Param::Constant(value), limit)?;
            }
        }
        let Some(reject) = &self.reject else {
            return Ok(());
        };
        let clipped = reject.clipped_share.map(|most| [0.0, most]);
        for (key, range) in [
            ("reflected_share", reject.reflected_share),
            ("contrast", reject.contrast),
            ("clipped_share", clipped),
            ("ssim", reject.ssim),
        ] {
            if let Some([least, most]) = range
                && !(least.is_finite() && most.is_finite() && least <= most)
            {
                return bad(
                    &format!("reject.{key}"),
                    format!("is {least} to {most}: write the least and the most, finite"),
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
                return bad(&key, "must be named by two or more of [A-Za-z0-9_-]");
            }
            source.check(&key)?;
            if source.layout == Layout::Places && self.sources.contains_key(&depth_root(name)) {
                let taken = depth_root(name);
                let problem = format!(
                    "has its depth maps under the root {taken}, which is a source, too: rename one"
                );
                return bad(&key, problem);
            }
            let photographs = match source.layout {
                Layout::Sample => format!("seed {}", source.seed.unwrap_or(self.seed)),
                Layout::Diode | Layout::Places | Layout::List => {
                    format!("root {:?}", source.root.as_deref().unwrap_or(name))
                }
            };
            if let Some(other) = source_of_photographs.get(&photographs) {
                return bad(
                    &key,
                    format!(
                        "has {photographs} as source {other} has, so two splits could share their \
                         photographs: use one source"
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
                return bad(&key, "stands there twice: merge the two into one [[split]]");
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
                                "names no source: the recipe has {}, add [sources.{name}]; of two sources write FRONT/BACK",
                                known.join(", ")
                            ),
                        );
                    }
                }
                // Scenes are named by them.
                if let Some(other) = labels.insert(pair.replace('/', "-"), pair) {
                    return bad(
                        &format!("{key}, pairs.{pair}"),
                        format!("would name its scenes like those of {other:?}: rename a source"),
                    );
                }
            }
            if !(split.photographs() > 0.0 && split.photographs() <= 1.0) {
                return bad(
                    &format!("{key}, photographs"),
                    format!(
                        "is {}, but must be above 0 and at most 1",
                        split.photographs()
                    ),
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

impl Source {
    /// `key` is where it stands in the recipe.
    fn check(&self, key: &str) -> Result<(), RecipeError> {
        use Layout::{Diode, List, Places, Sample};
        let keys: [(&str, bool, &[Layout]); 9] = [
            ("root", self.root.is_some(), &[Diode, Places, List]),
            ("list", self.list.is_some(), &[List]),
            ("depth_ranges", self.depth_ranges.is_some(), &[Places]),
            ("depth_root", self.depth_root.is_some(), &[Places]),
            ("depth_range", self.depth_range.is_some(), &[Diode, Sample]),
            ("count", self.count.is_some(), &[Sample]),
            ("seed", self.seed.is_some(), &[Sample]),
            ("width", self.width.is_some(), &[Sample]),
            ("height", self.height.is_some(), &[Sample]),
        ];
        for (name, given, layouts) in keys {
            if given && !layouts.contains(&self.layout) {
                return bad(
                    &format!("{key}.{name}"),
                    format!("does not belong to layout \"{}\": remove it", self.layout),
                );
            }
        }
        if self.layout == Places && self.depth_ranges.is_none() {
            return bad(
                &format!("{key}.depth_ranges"),
                "is missing: name the table of categories, such as \"depth-ranges.toml\"",
            );
        }
        if self.layout == List {
            self.check_list(key)?;
        }
        if self.layout == Sample {
            if self.count.is_none_or(|count| count < 2) {
                return bad(&format!("{key}.count"), "must be given and at least 2");
            }
            for (side, pixels) in ["width", "height"].iter().zip(self.sample_size()) {
                if !(16..=16_384).contains(&pixels) {
                    return bad(
                        &format!("{key}.{side}"),
                        format!("is {pixels}, but must be 16 to 16384 px"),
                    );
                }
            }
        }
        if let Some(highlights) = &self.highlights {
            let is_sound = highlights.validate("highlights", self.transfer);
            if let Err(error) = is_sound {
                return bad(&format!("{key}.highlights"), format!("is wrong: {error}"));
            }
        }
        let camera = &self.intrinsics;
        let mut numbers = vec![
            ("depth_unit_m", self.depth_unit_m, limits::DEPTH_UNIT_M),
            ("intrinsics.fx", camera.fx, limits::FOCAL_LENGTH_PX),
            ("intrinsics.fy", camera.fy, limits::FOCAL_LENGTH_PX),
            ("intrinsics.cx", camera.cx, limits::PRINCIPAL_POINT_PX),
            ("intrinsics.cy", camera.cy, limits::PRINCIPAL_POINT_PX),
        ];
        for side in camera.size.into_iter().flatten() {
            numbers.push(("intrinsics.size", side.into(), limits::IMAGE_SIDE));
        }
        for (name, value, limit) in numbers {
            within(&format!("{key}.{name}"), &Param::Constant(value), limit)?;
        }
        Ok(())
    }
}

impl Source {
    /// A list says of each photograph what other sources say of all of theirs.
    fn check_list(&self, key: &str) -> Result<(), RecipeError> {
        let keys = [
            ("intrinsics", self.intrinsics != Intrinsics::diode()),
            ("transfer", self.transfer != Transfer::default()),
            ("depth_unit_m", self.depth_unit_m != 1.0),
            ("depth_kind", self.depth_kind != DepthKind::default()),
            ("highlights", self.highlights.is_some()),
            ("fill", self.fill != Fill::default()),
        ];
        for (name, given) in keys {
            if given {
                return bad(
                    &format!("{key}.{name}"),
                    "does not belong to layout \"list\": write it in the lines of the list",
                );
            }
        }
        Ok(())
    }
}

fn bad(key: &str, problem: impl Into<String>) -> Result<(), RecipeError> {
    Err(RecipeError::Key {
        key: key.to_owned(),
        problem: problem.into(),
    })
}

fn within(key: &str, param: &Param, limit: Limit) -> Result<(), RecipeError> {
    match param.outside(limit) {
        None => Ok(()),
        Some(value) if param.is_constant() => {
            bad(key, format!("is {value}, but must be {}", limit.allowed))
        }
        Some(value) => bad(
            key,
            format!("({param}) can be {value}, but must be {}", limit.allowed),
        ),
    }
}

/// Sizes and counts: constants and choices, as a range of powers of two has no uniform distribution.
fn whole(
    key: &str,
    param: &Param,
    allowed: &str,
    is_allowed: impl Fn(f64) -> bool,
) -> Result<(), RecipeError> {
    let values = match param {
        Param::Constant(value) => std::slice::from_ref(value),
        Param::Choice(values) => values,
        _ => {
            return bad(
                key,
                "must be a whole number or { choice = [..] } of whole numbers",
            );
        }
    };
    match values.iter().find(|v| v.fract() != 0.0 || !is_allowed(**v)) {
        None => Ok(()),
        Some(value) => bad(key, format!("is {value}, but must be whole and {allowed}")),
    }
}

#[cfg(test)]
mod tests {
    use super::super::recipe::tests::PAPER;
    use super::*;

    #[test]
    fn sample_sources_need_a_count_and_make_different_photographs() {
        let parse = |sources: &str| {
            let head = "schema = \"glasshouse.recipe/1\"\nname = \"x\"\n";
            let split = "[[split]]\nname = \"train\"\npairs = { aa = 2 }\n";
            Recipe::parse(&format!("{head}{sources}{split}")).map_err(|error| error.to_string())
        };
        let recipe = parse("[sources.aa]\nlayout = \"sample\"\ncount = 4\nwidth = 64\n").unwrap();
        assert_eq!(recipe.sources["aa"].sample_size(), [64, 768]);
        for (source, message) in [
            ("", "sources.aa.count must be given"),
            ("count = 1", "sources.aa.count must be given and at least 2"),
            ("count = 4\nwidth = 8", "sources.aa.width is 8"),
            (
                "count = 4\nroot = \"x\"",
                "sources.aa.root does not belong to layout \"sample\"",
            ),
            (
                "count = 4\n[sources.bb]\nlayout = \"sample\"\ncount = 9\nseed = 2020",
                "sources.bb has seed 2020 as source aa has",
            ),
        ] {
            let error = parse(&format!("[sources.aa]\nlayout = \"sample\"\n{source}\n"));
            let error = error.unwrap_err();
            assert!(error.contains(message), "{source}: {error}");
        }
    }

    #[test]
    fn a_list_says_itself_what_other_sources_say_of_all_photographs() {
        let with = |keys: &str| {
            let text = PAPER.replacen(
                "layout = \"diode\"",
                &format!("layout = \"list\"\n{keys}"),
                1,
            );
            Recipe::parse(&text).map_err(|error| error.to_string())
        };
        let recipe = with("list = \"mine.jsonl\"").unwrap();
        assert_eq!(recipe.sources["diode"].list.as_deref(), Some("mine.jsonl"));
        assert_eq!(with("").unwrap().sources["diode"].list, None);
        for (keys, message) in [
            (
                "list = \"m\"\ntransfer = \"linear\"",
                "sources.diode.transfer does not belong to layout \"list\"",
            ),
            (
                "list = \"m\"\ndepth_range = { mean_m = 3 }",
                "sources.diode.depth_range does not belong",
            ),
            (
                "list = \"m\"\ncount = 3",
                "sources.diode.count does not belong",
            ),
        ] {
            let error = with(keys).unwrap_err();
            assert!(error.contains(message), "{keys}: {error}");
        }
        let other = PAPER.replacen("root = \"diode\"", "list = \"m\"", 1);
        let error = Recipe::parse(&other).unwrap_err().to_string();
        assert!(
            error.contains("sources.diode.list does not belong"),
            "{error}"
        );
    }

    #[test]
    fn highlights_belong_to_srgb() {
        let with = |keys: &str| {
            let text = PAPER.replacen("root = \"diode\"", keys, 1);
            Recipe::parse(&text).map_err(|error| error.to_string())
        };
        let recipe = with("highlights = { above = 0.9, to = 8 }").unwrap();
        assert_eq!(recipe.sources["diode"].highlights.map(|h| h.to), Some(8.0));
        assert_eq!(recipe.sources["places"].highlights, None);
        let error = with("highlights = { above = 1.5, to = 8 }").unwrap_err();
        assert!(error.contains("highlights.above is 1.5"), "{error}");
        let light = with("highlights = { above = 0.9, to = 8 }\ntransfer = \"linear\"");
        assert!(light.unwrap_err().contains("only images of transfer"));
    }

    #[test]
    fn mistakes_are_named_with_their_place() {
        for (from, to, message) in [
            ("ior = 1.6", "iro = 1.6", "unknown field `iro`"),
            ("ior = 1.6", "iro = 1.6", "line 16"),
            ("[glass]", "[glas]", "unknown field `glas`"),
            (
                "ior = 1.6",
                "ior = 0.9",
                "key glass.ior is 0.9, but must be 1 to 10",
            ),
            (
                "ior = 1.6",
                "ior = { uniform = [0.5, 2] }",
                "glass.ior (uniform 0.5 to 2) can be 0.5",
            ),
            ("ior = 1.6", "tilt_deg = [1]", "invalid length 1"),
            (
                "spp = 256",
                "spp = 100",
                "film.spp is 100, but must be whole and a power of two",
            ),
            (
                "spp = 256",
                "spp = { uniform = [1, 9] }",
                "film.spp must be a whole number or",
            ),
            ("width = 256", "width = 25.5", "film.width is 25.5"),
            (
                "\"front_center\"",
                "\"front\"",
                "expected \"front_center\", \"back_center\"",
            ),
            ("\"front_center\"", "-1", "camera.focus is -1"),
            (
                "recipe/1",
                "recipe/2",
                "key schema is \"glasshouse.recipe/2\"",
            ),
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
                "sources.places has root \"diode\" as source diode has",
            ),
            (
                "root = \"diode\"",
                "intrinsics = { fx = 0, fy = 1, cx = 1, cy = 1 }",
                "sources.diode.intrinsics.fx is 0",
            ),
            (
                "[sources.diode]",
                "[sources.d]",
                "sources.d must be named by two or more",
            ),
            (
                "name = \"test\"",
                "name = \"train\"",
                "split train stands there twice",
            ),
            (
                "name = \"test\"",
                "name = \"val\"",
                "unknown variant `val`, expected `train` or `test`",
            ),
            (
                "diode = 120",
                "dioed = 120",
                "pairs.dioed names no source: the recipe has diode, places",
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
