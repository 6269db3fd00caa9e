//! `glasshouse.recipe/1`: the distributions of a data set. Defaults are the paper's constants.

use super::cover::CoverRecipe;
use super::light::{LightRecipe, LuminanceScale, RejectRecipe, SideLight, WhiteBalance};
use super::limits::limit_of;
use super::places::depth_root;
use super::recipe_error::RecipeError;
use super::sensor::SensorRecipe;
use super::source::{Layout, Source};
use super::train_recipe::Trainings;
use glasshouse_line::keys::{Number, numbers_of};
use glasshouse_line::param::Param;
use glasshouse_line::{
    Apex, Camera, CameraRecipe, Film, FilmRecipe, Glass, GlassRecipe, Roots, Split,
};
use schemars::JsonSchema;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Schema name of a recipe.
pub const RECIPE_SCHEMA: &str = "glasshouse.recipe/1";

/// Recipe of a data set.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Always [`RECIPE_SCHEMA`].
    pub schema: String,
    /// Name of the data set: 1 to 128 characters of `[A-Za-z0-9_-]`.
    pub name: String,
    /// Dataset seed of all draws, pairs and splits. Default 2020.
    #[serde(default = "default_seed")]
    pub seed: u64,
    /// Film: size, samples and layers.
    #[serde(default)]
    pub film: FilmRecipe,
    /// Lens and focus.
    #[serde(default)]
    pub camera: CameraRecipe,
    /// Pane: position, thickness and material.
    #[serde(default)]
    pub glass: GlassRecipe,
    /// What stands in the way of the window: the photographer, blinds, curtains, plants, a frame. Default nothing.
    pub cover: Option<CoverRecipe>,
    /// The side seen through the pane.
    #[serde(default)]
    pub front: FrontRecipe,
    /// The side reflected in the pane.
    #[serde(default)]
    pub back: BackRecipe,
    /// Luminance scale, white balance and exposure.
    #[serde(default)]
    pub light: LightRecipe,
    /// The camera of the photographs. Default none: no photographs.
    pub sensor: Option<SensorRecipe>,
    /// Bounds of accepted scenes. Default none.
    pub reject: Option<RejectRecipe>,
    /// Sets of photographs by name. The name is also the name of the root of their paths.
    pub sources: BTreeMap<String, Source>,
    /// The splits of the data set. No two splits share a photograph.
    #[serde(rename = "split")]
    pub splits: Vec<SplitRecipe>,
    /// Training after rendering. Default none.
    pub train: Option<Trainings>,
}

pub(super) fn default_seed() -> u64 {
    2020
}

/// `[front]`: light of the front.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct FrontRecipe {
    /// Factor of linear radiance. Default 1.
    pub exposure: Param,
    /// Exposure value EV, which multiplies the exposure by 2^EV. Default none.
    pub exposure_ev: Option<Param>,
    /// Temperature of a black body that illuminates this side, K. Default none: the light of the photograph.
    pub illuminant_k: Option<Param>,
}

impl Default for FrontRecipe {
    fn default() -> Self {
        Self { exposure: Param::Constant(1.0), exposure_ev: None, illuminant_k: None }
    }
}

/// `[back]`: light and apex of the back.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct BackRecipe {
    /// Factor of linear radiance. Default 1.
    pub exposure: Param,
    /// Exposure value EV, which multiplies the exposure by 2^EV. Default none.
    pub exposure_ev: Option<Param>,
    /// Temperature of a black body that illuminates this side, K. Default none: the light of the photograph.
    pub illuminant_k: Option<Param>,
    /// Share of the scenes whose back has the front's illuminant instead, above 0 to 1. Default none.
    pub front_illuminant_share: Option<f64>,
    /// Position of the capture camera. Default mirror.
    pub apex: Apex,
}

impl Default for BackRecipe {
    fn default() -> Self {
        Self {
            exposure: Param::Constant(1.0),
            exposure_ev: None,
            illuminant_k: None,
            front_illuminant_share: None,
            apex: Apex::Mirror,
        }
    }
}

/// `[[split]]`: a split with its numbers of scenes.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SplitRecipe {
    /// `train`, `validation` or `test`.
    pub name: Split,
    /// Number of scenes by source, or by two sources as `FRONT/BACK`.
    pub pairs: BTreeMap<String, u32>,
    /// Relative share of each source's photographs in this split. Default 0.9 for `train`, 0.1 for the others. The
    /// only split that uses a source gets all photographs of the source.
    pub photographs: Option<f64>,
}

impl SplitRecipe {
    /// Returns the share of photographs, or its default.
    pub(crate) fn photographs(&self) -> f64 {
        self.photographs.unwrap_or(match self.name {
            Split::Train => 0.9,
            Split::Validation | Split::Test => 0.1,
        })
    }
}

impl FrontRecipe {
    pub(super) fn light(&self) -> SideLight<'_> {
        SideLight { exposure: &self.exposure, exposure_ev: self.exposure_ev.as_ref() }
    }
}

impl BackRecipe {
    pub(super) fn light(&self) -> SideLight<'_> {
        SideLight { exposure: &self.exposure, exposure_ev: self.exposure_ev.as_ref() }
    }
}

impl Recipe {
    /// Returns all distributions with the declarations of their keys.
    pub fn numbers(&self) -> Vec<Number<'_>> {
        let mut numbers = numbers_of::<Film>(&self.film, "film");
        numbers.extend(numbers_of::<Camera>(&self.camera, "camera"));
        numbers.extend(numbers_of::<Glass>(&self.glass, "glass"));
        let mut others: Vec<(String, &Param)> = Vec::new();
        others.extend(self.cover.iter().flat_map(CoverRecipe::params));
        others.extend(self.sensor.iter().flat_map(SensorRecipe::params));
        for (name, light) in [("front", self.front.light()), ("back", self.back.light())] {
            others.push((format!("{name}.exposure"), light.exposure));
            others.extend(light.exposure_ev.map(|param| (format!("{name}.exposure_ev"), param)));
        }
        let illuminants = [("front", &self.front.illuminant_k), ("back", &self.back.illuminant_k)];
        for (name, param) in illuminants {
            others.extend(param.iter().map(|param| (format!("{name}.illuminant_k"), param)));
        }
        numbers.extend(others.into_iter().map(|(path, param)| Number {
            limit: limit_of(&path),
            decides: path.starts_with("cover."),
            path,
            param,
        }));
        numbers
    }

    /// True if scenes need previews, for which planning reads photographs.
    pub fn needs_preview(&self) -> bool {
        let light = &self.light;
        self.reject.is_some()
            || light.auto_exposure.is_some()
            || light.scale == LuminanceScale::Metered
            || light.white_balance == WhiteBalance::GreyWorld
    }

    /// Parses and checks a recipe.
    pub fn parse(text: &str) -> Result<Self, RecipeError> {
        let recipe: Self = toml::from_str(text).map_err(Box::new)?;
        recipe.check()?;
        Ok(recipe)
    }

    /// Returns the named roots of the scene lines: those `given`, and the recipe's other `root`s and `depth_root`s,
    /// resolved against its folder `base`. Omits `sample` sources, because planning writes them into the run's folder.
    pub fn roots(&self, base: &Path, given: &Roots) -> Roots {
        let mut roots = given.clone();
        for (name, source) in &self.sources {
            if source.layout != Layout::Sample && given.get(name).is_none() {
                let folder: PathBuf = base.join(source.root.as_deref().unwrap_or(name));
                roots
                    .insert(name, folder)
                    .expect("source names were checked, and this one has no root yet");
            }
            let depth = depth_root(name);
            if source.layout == Layout::Places && given.get(&depth).is_none() {
                let folder: PathBuf = base.join(source.depth_root.as_deref().unwrap_or(&depth));
                roots
                    .insert(&depth, folder)
                    .expect("no source has the name of another one's depth root");
            }
        }
        roots
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::cover::{FrameRecipe, PhotographerRecipe, ScreenRecipe};
    use super::super::draw::Draw;
    use super::super::glass::draw_glass;
    use super::super::numbers::{OTHERS, is_number};
    use super::super::sensor::ExposureRecipe;
    use super::*;
    use glasshouse_line::{DepthKind, FocusRecipe, Intrinsics};
    use std::collections::BTreeSet;

    /// Recipe of the paper's data set.
    pub(in super::super) const PAPER: &str = r#"
schema = "glasshouse.recipe/1"
name = "paper"
seed = 2020
[film]
width = 256
height = 256
spp = 256
[camera]
focal_length_mm = 55.0
aperture_radius_m = 0.00893
focus = "front_center"
[glass]
distance_m = 0.30
thickness_m = 0.010
ior = 1.6
[sources.diode]
layout = "diode"
root = "diode"
[sources.places]
layout = "places"
root = "places"
depth_ranges = "depth-ranges.toml"
[[split]]
name = "train"
pairs = { diode = 3000, places = 2000 }
[[split]]
name = "test"
pairs = { diode = 120, places = 80 }
"#;

    #[test]
    fn the_table_of_other_numbers_is_complete() {
        let optional = "[front]\nexposure_ev = 1\nilluminant_k = 5000\n\
                        [back]\nexposure_ev = 1\nilluminant_k = 5000\n[sources.diode]";
        let text = PAPER.replacen("[sources.diode]", optional, 1);
        let mut recipe = Recipe::parse(&text).unwrap();
        let screen = || {
            let one = || Some(Param::Constant(1.0));
            let [gap_m, view_width, view_x, view_y, exposure] = [0; 5].map(|_| one());
            Some(ScreenRecipe { share: 1.0, gap_m, view_width, view_x, view_y, exposure })
        };
        recipe.cover = Some(CoverRecipe {
            pictures: 1,
            photographer: Some(PhotographerRecipe::default()),
            blind: screen(),
            curtain: screen(),
            plant: screen(),
            frame: Some(FrameRecipe::default()),
        });
        let one = || Param::Constant(1.0);
        let metered = SensorRecipe {
            gain_dn_per_e: Some(one()),
            full_well_e: Some(one()),
            ..SensorRecipe::default()
        };
        let exposure = ExposureRecipe::Factor { factor: one() };
        let fixed = SensorRecipe { exposure, ..metered.clone() };
        let mut names = BTreeSet::new();
        for sensor in [metered, fixed] {
            recipe.sensor = Some(sensor);
            names.extend(recipe.numbers().into_iter().map(|number| number.path));
        }
        let is_declared =
            |key: &String| ["film.", "camera.", "glass."].iter().any(|at| key.starts_with(at));
        assert!(names.iter().all(|key| is_number(key)));
        names.retain(|key| !is_declared(key));
        assert_eq!(names, OTHERS.map(str::to_owned).into());
    }

    fn pane(recipe: &GlassRecipe) -> Glass {
        let values = BTreeMap::new();
        draw_glass(recipe, Draw { dataset_seed: 1, scene: "s", attempt: 0, values: &values })
    }

    #[test]
    fn the_paper_s_constants_are_the_defaults() {
        let paper = Recipe::parse(PAPER).unwrap();
        assert_eq!(paper.film, FilmRecipe::default());
        assert_eq!(paper.camera, CameraRecipe::default());
        assert_eq!(pane(&paper.glass), pane(&GlassRecipe::default()));
        assert_eq!(paper.seed, default_seed());
        assert_eq!(paper.splits[0].pairs["places"], 2000);
    }

    #[test]
    fn the_shipped_paper_recipe_has_the_paper_s_values() {
        let paper = Recipe::parse(include_str!("../../manifests/paper.toml")).unwrap();
        let constants = Recipe::parse(PAPER).unwrap();
        assert_eq!(paper.film, constants.film);
        assert_eq!(paper.camera, constants.camera);
        assert_eq!(pane(&paper.glass), pane(&constants.glass));
        for (split, constant) in paper.splits.iter().zip(&constants.splits) {
            assert_eq!((split.name, &split.pairs), (constant.name, &constant.pairs));
        }
        assert_eq!(paper.splits.len(), constants.splits.len());
        assert_eq!((paper.needs_preview(), &paper.reject), (false, &None));
        assert_eq!(
            (paper.seed, &paper.front, &paper.back),
            (2020, &constants.front, &constants.back)
        );
        assert_eq!(paper.sources["places"].depth_kind, DepthKind::RelativeInverse);
        assert_eq!(paper.sources["diode"].intrinsics, Intrinsics::diode());
    }

    #[test]
    fn the_shipped_smoke_recipe_differs_from_the_paper_in_its_panes() {
        let smoke = Recipe::parse(include_str!("../../manifests/smoke.toml")).unwrap();
        assert_eq!(smoke.film, FilmRecipe::default());
        assert_eq!(smoke.camera, CameraRecipe::default());
        let (smoke_pane, paper) = (pane(&smoke.glass), pane(&GlassRecipe::default()));
        assert_eq!((smoke_pane.ior, smoke_pane.distance_m), (paper.ior, paper.distance_m));
        assert_eq!(smoke.glass.thickness_m, Some(Param::Choice(vec![0.01, 0.04].into())));
        assert_eq!(smoke.glass.tilt_deg[1], Param::Choice(vec![0.0, 30.0].into()));
        let pairs: u32 = smoke.splits.iter().flat_map(|s| s.pairs.values()).sum();
        assert_eq!(pairs, 8);
    }

    #[test]
    fn distributions_may_replace_numbers() {
        let text = PAPER
            .replace("ior = 1.6", "ior = { uniform = [1.3, 1.7] }\nabsorption_per_m = [{ uniform = [0, 20] }, 0, 1]\ntilt_deg = [0, { normal = { mean = 0, std = 10, min = -30, max = 30 } }]")
            .replace("focus = \"front_center\"", "focus = { log_uniform = [1, 20] }")
            .replace("spp = 256", "spp = { choice = [64, 256] }");
        let recipe = Recipe::parse(&text).unwrap();
        assert_eq!(recipe.glass.ior, Some(Param::Uniform([1.3, 1.7])));
        assert!(matches!(recipe.camera.focus, FocusRecipe::DistanceM(Param::LogUniform(_))));
        let infinity = PAPER.replace("\"front_center\"", "\"infinity\"");
        assert_eq!(Recipe::parse(&infinity).unwrap().camera.focus, FocusRecipe::Infinity);
    }

    #[test]
    fn a_given_root_overrides_the_recipe() {
        let recipe = Recipe::parse(PAPER).unwrap();
        let given = Roots::parse(&["diode=/big/diode", "other=/o"]).unwrap();
        let roots = recipe.roots(Path::new("/recipes"), &given);
        assert_eq!(roots.get("diode"), Some(Path::new("/big/diode")));
        assert_eq!(roots.get("places"), Some(Path::new("/recipes/places")));
        let depths = roots.get("places-depth");
        assert_eq!(depths, Some(Path::new("/recipes/places-depth")));
        assert_eq!(roots.get("other"), Some(Path::new("/o")));
    }
}
