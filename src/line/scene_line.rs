//! `glasshouse.scene/1`: one scene of a manifest with all parameters resolved.

use super::focus::{Focus, FocusRecipe};
use super::glass::Glass;
use super::keys::{words, words_of_all_scenes};
use super::layers::LayerSet;
use super::sensor::Sensor;
use super::side::Side;
use crate::ids::SceneId;
use glasshouse_keys::keys;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Schema name of a scene line.
pub const SCENE_SCHEMA: &str = "glasshouse.scene/1";

/// Part of a data set.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum Split {
    /// Training scenes.
    #[default]
    Train,
    /// Scenes that choose among the checkpoints of a training. No photograph is in two splits.
    Validation,
    /// Scenes for the final scores; nothing is chosen on them.
    Test,
}

impl Split {
    /// All splits.
    pub const ALL: [Self; 3] = [Self::Train, Self::Validation, Self::Test];
}

impl fmt::Display for Split {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Train => "train",
            Self::Validation => "validation",
            Self::Test => "test",
        })
    }
}

/// One scene: two sides, a pane, a camera and a film.
#[keys]
pub struct SceneLine {
    /// Always `glasshouse.scene/1`.
    #[key(line_only)]
    pub schema: String,
    /// Id, unique in the manifest: 1 to 128 characters of `[A-Za-z0-9_-]`. File names contain it.
    #[key(line_only)]
    pub id: SceneId,
    /// Part of the data set: `train`, `validation` or `test`.
    #[key(default = Split::Train, written, line_only)]
    pub split: Split,
    /// Seed of this scene's sample points, from 0 to 2^64 - 1.
    #[key(line_only)]
    pub seed: u64,
    /// Size, samples and filter.
    pub film: Film,
    /// Lens, focus and exposure.
    pub camera: Camera,
    /// The pane.
    #[serde(deserialize_with = "Glass::resolved")]
    pub glass: Glass,
    /// The side seen through the pane.
    #[key(line_only)]
    pub front: Side,
    /// The side reflected in the pane.
    #[key(line_only)]
    pub back: Side,
    /// The camera of the photographs of the layers; no photographs if missing.
    #[key(line_only)]
    pub sensor: Option<Sensor>,
}

words!(SceneId, Split);

/// Key of the picture of a pane's smudges.
pub const SMUDGES_MAP: &str = "glass.smudges.map";

impl SceneLine {
    /// Returns the paths of all files of the scene, with their JSON keys.
    pub fn paths(&self) -> Vec<(String, &str)> {
        let sides = [("front", &self.front), ("back", &self.back)].into_iter();
        let of_sides = sides.flat_map(|(name, side)| {
            side.paths().into_iter().map(move |(key, path)| (format!("{name}.{key}"), path))
        });
        let map = self.glass.smudges.as_ref().and_then(|smudges| smudges.map.as_ref());
        of_sides.chain(map.map(|map| (SMUDGES_MAP.to_owned(), map.as_str()))).collect()
    }

    /// Returns mutable references to the paths of [`Self::paths`].
    pub fn paths_mut(&mut self) -> Vec<&mut String> {
        let sides = [&mut self.front, &mut self.back].into_iter().flat_map(Side::paths_mut);
        sides.chain(self.glass.smudges.as_mut().and_then(|smudges| smudges.map.as_mut())).collect()
    }
}

/// The film and its sampling.
#[keys(recipe = FilmRecipe)]
pub struct Film {
    /// Width of the film.
    #[key("[1, 16384] px whole", recipe = 256.0)]
    pub width: u32,
    /// Height of the film.
    #[key("[1, 16384] px whole", recipe = 256.0)]
    pub height: u32,
    /// Camera samples per pixel.
    #[key("[1, 65536] power of two", recipe = 256.0)]
    pub spp: u32,
    /// Reconstruction filter: `box`, the square of the pixel, or `gaussian`, with a sigma of 0.5 px, cut at 2 px.
    #[key(default = Filter::Box, written)]
    pub filter: Filter,
    /// Target of adaptive sampling, linear radiance: each cell of 8 x 8 px takes samples, at most `spp`, until its RMS
    /// error in every layer is at most the target. Without a target, every pixel takes `spp` samples.
    #[key("(0, inf)")]
    pub target_error: Option<f64>,
    /// Orders of the glass's reflection in R~: `all`, or `first`, that of the front face. The input always contains all orders, so that
    /// with `first` the ghosts stay in I - R~.
    #[key(default = ReflectionOrders::All)]
    pub glass_reflection_orders: ReflectionOrders,
    /// List of one or more of the layers `input`, `transmission`, `glass_reflection`, `clean_reflection`, and of the labels `coverage`,
    /// `front_depth`, `ghosts`, `reflected_share`. Others are neither traced nor written.
    #[key(default = LayerSet::default(), shown = "all four layers")]
    pub layers: LayerSet,
    /// Threshold for orders of the glass, linear radiance: an order other than t0 is dropped if its weight times
    /// its side's largest radiance is below the threshold. 0 traces all, with all samples.
    // A quarter of an 8-bit sRGB step near black: 1 / 255 / 12.92 / 4, rounded.
    #[key("[0, inf)", default = 7.6e-5)]
    pub order_tolerance: f64,
    /// Precision of `tuple.exr`: `half`, with float where a value exceeds 65,504, or `float`.
    #[key(default = ExrPrecision::Half)]
    pub exr: ExrPrecision,
}

words_of_all_scenes!(Filter, ReflectionOrders, ExrPrecision, LayerSet);

/// The orders of the glass's reflection that belong to R~.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ReflectionOrders {
    /// All followed orders: R~ is the double image, and I - R~ is the front through the glass.
    #[default]
    All,
    /// The reflection at the front face alone: I - R~ still contains the ghosts.
    First,
}

/// Precision of `tuple.exr`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ExrPrecision {
    /// 16-bit floats, or 32-bit floats if any value exceeds 65,504.
    #[default]
    Half,
    /// 32-bit floats.
    Float,
}

/// Reconstruction filter of a pixel, applied by filter importance sampling.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Filter {
    /// The square of the pixel.
    #[default]
    Box,
    /// Gaussian, sigma 0.5 px, cut at 2 px.
    Gaussian,
}

/// The thin lens, its focus, and the factors on all layers.
#[keys(recipe = CameraRecipe)]
pub struct Camera {
    /// Focal length for a frame of 36 x 24 mm, with the frame's diagonal of 43.267 mm scaled to the film's diagonal.
    #[key("(0, inf) mm", recipe = 55.0, decides)]
    pub focal_length_mm: f64,
    /// Radius of the lens opening; 0 for a pinhole.
    #[key("[0, inf) m", recipe = 0.00893, decides)]
    pub aperture_radius_m: f64,
    /// Focal length divided by the diameter of the opening, for a 36 x 24 mm frame, in place of `aperture_radius_m`.
    #[key("(0, inf)", recipe_only, decides)]
    pub f_number: Option<f64>,
    /// Plane in focus. In recipes metres, `"front_center"`, `"back_center"` (the reflected photograph's centre), `"glass"` (the pane's
    /// front face), `"infinity"`, or a choice of these; in lines `{"distance_m": z}` or `{"at": "front_center"}` and so on. The centre
    /// of a mesh is the first hit of the ray through the film's centre.
    #[key("(0, inf) m", recipe = FocusRecipe::FrontCenter, decides)]
    pub focus: Focus,
    /// Factor on all four layers, like the exposure of a camera.
    #[key("[0, inf)", default = 1.0, line_only)]
    pub exposure: f64,
    /// Factors on red, green and blue of all four layers, like the white balance of a camera.
    #[key("[0, inf)", default = [1.0; 3], line_only)]
    pub white_balance: [f64; 3],
}
