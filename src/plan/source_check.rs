//! Checks the sources of a recipe: the keys that each layout allows, and their ranges.

use super::recipe_check::{bad, within};
use super::recipe_error::RecipeError;
use super::source::{Layout, Source};
use glasshouse_line::param::Param;
use glasshouse_line::{DepthKind, Fill, Intrinsics, Orientation, Transfer};

/// Largest number of procedural photographs of a source: the largest number of pairs in a split.
const MAX_SAMPLES: u32 = 1_000_000;

impl Source {
    /// Checks the source; `key` is the place of the source in the recipe.
    pub(super) fn check(&self, key: &str) -> Result<(), RecipeError> {
        use Layout::{Diode, Folder, List, Places, Sample};
        let keys: [(&str, bool, &[Layout]); 13] = [
            ("root", self.root.is_some(), &[Diode, Places, List, Folder]),
            ("depth", self.depth.is_some(), &[Folder]),
            ("place", self.place.is_some(), &[Folder]),
            ("field_of_view_deg", self.field_of_view_deg.is_some(), &[Folder]),
            ("list", self.list.is_some(), &[List]),
            ("depth_ranges", self.depth_ranges.is_some(), &[Places]),
            ("depth_root", self.depth_root.is_some(), &[Places]),
            ("depth_range", self.depth_range.is_some(), &[Diode, Sample]),
            ("count", self.count.is_some(), &[Sample]),
            ("seed", self.seed.is_some(), &[Sample]),
            ("width", self.width.is_some(), &[Sample]),
            ("height", self.height.is_some(), &[Sample]),
            ("textured", self.textured.is_some(), &[Sample]),
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
        if self.layout == Folder {
            self.check_folder(key)?;
        }
        if self.layout == Sample {
            match self.count {
                None | Some(0..2) => {
                    return bad(&format!("{key}.count"), "must be given and at least 2");
                }
                Some(count) if count > MAX_SAMPLES => {
                    return bad(
                        &format!("{key}.count"),
                        format!("is {count}, but must be at most {MAX_SAMPLES}"),
                    );
                }
                Some(_) => {}
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
            ("depth_unit_m", self.depth_unit_m),
            ("intrinsics.fx", camera.fx),
            ("intrinsics.fy", camera.fy),
            ("intrinsics.cx", camera.cx),
            ("intrinsics.cy", camera.cy),
        ];
        for side in camera.size.into_iter().flatten() {
            numbers.push(("intrinsics.size", side.into()));
        }
        numbers.extend(self.depth_none_code.map(|code| ("depth_none_code", code)));
        for (name, value) in numbers {
            within(&format!("{key}.{name}"), &Param::Constant(value))?;
        }
        Ok(())
    }

    /// Checks the keys of a folder, and rejects those of depth images.
    fn check_folder(&self, key: &str) -> Result<(), RecipeError> {
        let keys = [
            ("intrinsics", self.intrinsics != Intrinsics::diode(), "give field_of_view_deg"),
            ("transfer", self.transfer != Transfer::default(), "the file's ending tells it"),
            ("depth_unit_m", self.depth_unit_m != 1.0, "give depth"),
            ("depth_none_code", self.depth_none_code.is_some(), "give depth"),
            ("depth_kind", self.depth_kind != DepthKind::default(), "give depth"),
        ];
        for (name, given, instead) in keys {
            if given {
                return bad(
                    &format!("{key}.{name}"),
                    format!("does not belong to layout \"folder\": {instead}"),
                );
            }
        }
        let numbers = self.depth.clone().unwrap_or_default().params(key);
        let view = self.field_of_view_deg.map(Param::Constant);
        let view = view.map(|view| (format!("{key}.field_of_view_deg"), view));
        for (key, param) in numbers.into_iter().chain(view) {
            if param == Param::FromSource {
                return bad(&key, "is from_source, but pictures have no records: give a number");
            }
            within(&key, &param)?;
        }
        Ok(())
    }

    /// Rejects keys that a list has for each photograph, not for the source.
    fn check_list(&self, key: &str) -> Result<(), RecipeError> {
        let keys = [
            ("intrinsics", self.intrinsics != Intrinsics::diode()),
            ("orientation", self.orientation != Orientation::default()),
            ("transfer", self.transfer != Transfer::default()),
            ("depth_unit_m", self.depth_unit_m != 1.0),
            ("depth_none_code", self.depth_none_code.is_some()),
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

#[cfg(test)]
mod tests {
    use crate::Recipe;
    use crate::recipe::tests::PAPER;

    #[test]
    fn sample_sources_need_a_count_and_different_seeds() {
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
            ("count = 1000000000", "sources.aa.count is 1000000000, but must be at most 1000000"),
            ("count = 4\nwidth = 8", "sources.aa.width is 8"),
            ("count = 4\nroot = \"x\"", "sources.aa.root does not belong to layout \"sample\""),
            (
                "count = 4\n[sources.bb]\nlayout = \"sample\"\ncount = 9\nseed = 2020",
                "sources.bb has seed 2020 like source aa",
            ),
        ] {
            let error = parse(&format!("[sources.aa]\nlayout = \"sample\"\n{source}\n"));
            let error = error.unwrap_err();
            assert!(error.contains(message), "{source}: {error}");
        }
    }

    #[test]
    fn keys_of_photographs_do_not_belong_to_a_list_source() {
        let with = |keys: &str| {
            let text =
                PAPER.replacen("layout = \"diode\"", &format!("layout = \"list\"\n{keys}"), 1);
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
            ("list = \"m\"\ncount = 3", "sources.diode.count does not belong"),
            ("list = \"m\"\ntextured = true", "sources.diode.textured does not belong"),
        ] {
            let error = with(keys).unwrap_err();
            assert!(error.contains(message), "{keys}: {error}");
        }
        let other = PAPER.replacen("root = \"diode\"", "list = \"m\"", 1);
        let error = Recipe::parse(&other).unwrap_err().to_string();
        assert!(error.contains("sources.diode.list does not belong"), "{error}");
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
        assert!(light.unwrap_err().contains("only transfer \"srgb\""));
    }
}
