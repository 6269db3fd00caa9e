//! `glasshouse.scene/1`: one scene of a manifest with all parameters resolved.

use super::glass::Glass;
use super::image::{is_default, is_one, is_white, one, white};
use super::layers::LayerSet;
use super::sensor::Sensor;
use super::side::Side;
use super::smudges::Smudges;
use crate::ids::SceneId;
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
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneLine {
    /// Always [`SCENE_SCHEMA`].
    pub schema: String,
    /// Id, unique in the manifest.
    pub id: SceneId,
    /// Part of the data set; `train` if missing.
    #[serde(default)]
    pub split: Split,
    /// Seed of this scene's sample points.
    pub seed: u64,
    /// Size, samples and filter.
    pub film: Film,
    /// Lens, focus and exposure.
    pub camera: Camera,
    pub glass: Glass,
    /// The side seen through the pane.
    pub front: Side,
    /// The side reflected in the pane.
    pub back: Side,
    /// The camera of the photographs of the layers; no photographs if missing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensor: Option<Sensor>,
}

/// Key of the picture of a pane's smudges.
pub const SMUDGES_MAP: &str = "glass.smudges.map";

impl SceneLine {
    /// Returns the paths of all files of the scene, with their JSON keys.
    pub fn paths(&self) -> Vec<(String, &str)> {
        let sides = [("front", &self.front), ("back", &self.back)].into_iter();
        let of_sides = sides.flat_map(|(name, side)| {
            side.paths().into_iter().map(move |(key, path)| (format!("{name}.{key}"), path))
        });
        let map = self.glass.smudges.as_ref().and_then(Smudges::map);
        of_sides.chain(map.map(|map| (SMUDGES_MAP.to_owned(), map.as_str()))).collect()
    }

    /// Returns mutable references to the paths of [`Self::paths`].
    pub fn paths_mut(&mut self) -> Vec<&mut String> {
        let sides = [&mut self.front, &mut self.back].into_iter().flat_map(Side::paths_mut);
        sides.chain(self.glass.smudges.as_mut().and_then(Smudges::map_mut)).collect()
    }
}

/// The film and its sampling.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Film {
    /// Width, px.
    pub width: u32,
    /// Height, px.
    pub height: u32,
    /// Camera samples per pixel: a power of two, 1 to 65,536.
    pub spp: u32,
    /// Reconstruction filter.
    #[serde(default)]
    pub filter: Filter,
    /// Target of adaptive sampling, linear radiance: each cell of 8 x 8 px takes samples, at most `spp`, until its RMS
    /// error in every layer is at most the target. Without a target, every pixel takes `spp` samples.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target_error: Option<f64>,
    /// Orders of the glass's reflection in R~; all if missing. The input always contains all orders.
    #[serde(default, skip_serializing_if = "is_default")]
    pub glass_reflection_orders: ReflectionOrders,
    /// Layers to render; all four if missing.
    #[serde(default, skip_serializing_if = "is_default")]
    pub layers: LayerSet,
    /// Threshold for orders of the glass, linear radiance: an order other than t0 is dropped if its weight times
    /// its side's largest radiance is below the threshold. Default: 7.6e-5, a quarter of an 8-bit sRGB step near black.
    #[serde(
        default = "Film::default_order_tolerance",
        skip_serializing_if = "is_default_tolerance"
    )]
    pub order_tolerance: f64,
    /// Precision of `tuple.exr`: half if all values allow it, or always float.
    #[serde(default, skip_serializing_if = "is_default")]
    pub exr: ExrPrecision,
}

impl Film {
    /// Returns a quarter of an 8-bit sRGB step near black: 1 / 255 / 12.92 / 4, rounded.
    pub const fn default_order_tolerance() -> f64 {
        7.6e-5
    }
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde's signature")]
fn is_default_tolerance(value: &f64) -> bool {
    *value == Film::default_order_tolerance()
}

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
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// Focal length for a frame of 36 x 24 mm, with the frame's diagonal scaled to the film's diagonal.
    pub focal_length_mm: f64,
    /// Radius of the lens opening; 0 for a pinhole.
    pub aperture_radius_m: f64,
    /// Plane in focus.
    pub focus: Focus,
    /// Factor on all four layers, like the exposure of a camera.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub exposure: f64,
    /// Factors on red, green and blue of all four layers, like the white balance of a camera.
    #[serde(default = "white", skip_serializing_if = "is_white")]
    pub white_balance: [f64; 3],
}

/// The plane in focus without the glass. The focus shift of the glass is not compensated.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(
    untagged,
    deny_unknown_fields,
    expecting = r#"focus must be {"distance_m": z}, {"at": "front_center"}, {"at": "back_center"} or {"at": "infinity"}"#
)]
pub enum Focus {
    /// A distance: `{"distance_m": z}`.
    Distance {
        /// Distance of the plane from the lens.
        distance_m: f64,
    },
    /// A place in the scene: `{"at": "front_center"}`.
    At {
        /// Name of the place.
        at: FocusAt,
    },
}

/// A place in the scene that determines the focus.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FocusAt {
    /// Mean z of the four centre pixels of the front depth image, as published; for a mesh, z of the first hit of the
    /// ray through the film's centre.
    FrontCenter,
    /// Mean z of the four centre pixels of the back depth image, mirrored in the pane; for a mesh, as for the front.
    BackCenter,
    Infinity,
}
