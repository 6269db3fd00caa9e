//! `glasshouse.scene/1`: one scene of a manifest, everything resolved, in metres and degrees.

use super::image::{is_default, is_one, is_white, one, white};
use super::layers::LayerSet;
use super::side::Side;
use crate::ids::SceneId;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::fmt;

/// The schema name that a scene line must carry.
pub const SCENE_SCHEMA: &str = "glasshouse.scene/1";

/// Part of the set that a scene belongs to.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum Split {
    /// For training.
    #[default]
    Train,
    /// For testing: shares no photograph with `train`.
    Test,
}

impl fmt::Display for Split {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Train => "train",
            Self::Test => "test",
        })
    }
}

/// One scene: two sides, a pane, a camera, a film.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneLine {
    /// Always [`SCENE_SCHEMA`].
    pub schema: String,
    /// Unique in the manifest.
    pub id: SceneId,
    /// `train` if missing.
    #[serde(default)]
    pub split: Split,
    /// Seed of this scene's sample points.
    pub seed: u64,
    /// Size, samples, filter.
    pub film: Film,
    /// Lens and focus.
    pub camera: Camera,
    /// The pane.
    pub glass: Glass,
    /// The side seen through the pane.
    pub front: Side,
    /// The side reflected in the pane.
    pub back: Side,
}

/// The film and how it is sampled.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Film {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Camera samples a pixel: a power of two, 1 to 65,536.
    pub spp: u32,
    /// Reconstruction filter.
    #[serde(default)]
    pub filter: Filter,
    /// Adaptive sampling: each cell of 8 x 8 px takes samples, `spp` at most, until its RMS error in every layer is
    /// below this (linear radiance). Without it every pixel takes `spp`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target_error: Option<f64>,
    /// Which orders of the glass's reflection R~ holds; all if missing. I always holds all.
    #[serde(default, skip_serializing_if = "is_default")]
    pub glass_reflection_orders: ReflectionOrders,
    /// Layers that are made; all four if missing.
    #[serde(default, skip_serializing_if = "is_default")]
    pub layers: LayerSet,
    /// Orders of the glass are dropped if their weight times the largest radiance of their side is below this. Default
    /// 7.6e-5 (linear): a quarter of an 8-bit sRGB step near black.
    #[serde(
        default = "Film::default_order_tolerance",
        skip_serializing_if = "is_default_tolerance"
    )]
    pub order_tolerance: f64,
    /// Precision of `tuple.exr`: half where the values allow it, or always float.
    #[serde(default, skip_serializing_if = "is_default")]
    pub exr: ExrPrecision,
}

impl Film {
    /// A quarter of an 8-bit sRGB step near black: 1 / 255 / 12.92 / 4, rounded.
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
    /// All that are followed: the double image, so that I - R~ is the front through the glass.
    #[default]
    All,
    /// The front face's alone: what is left of the reflection in I - R~ are its ghosts.
    First,
}

/// Precision of `tuple.exr`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ExrPrecision {
    /// 16-bit floats; 32-bit ones where a value exceeds 65,504.
    #[default]
    Half,
    /// 32-bit floats.
    Float,
}

/// Reconstruction filter of a pixel, applied by filter importance sampling.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Filter {
    /// The pixel's own square.
    #[default]
    Box,
    /// Gaussian, sigma 0.5 px, cut at 2 px.
    Gaussian,
}

/// The thin lens.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// Relative to the diagonal of a 36 x 24 mm frame spread over the film's diagonal.
    pub focal_length_mm: f64,
    /// Radius of the lens opening; 0 is a pinhole.
    pub aperture_radius_m: f64,
    /// The plane in focus.
    pub focus: Focus,
    /// Multiplies all four layers, as the exposure of a camera does.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub exposure: f64,
    /// Multiplies red, green and blue of all four layers, as the white balance of a camera does.
    #[serde(default = "white", skip_serializing_if = "is_white")]
    pub white_balance: [f64; 3],
}

/// The plane in focus, without the glass: its focus shift is not compensated.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(
    untagged,
    deny_unknown_fields,
    expecting = "focus must be {\"distance_m\": z}, {\"at\": \"front_center\"} or {\"at\": \"infinity\"}"
)]
pub enum Focus {
    /// `{"distance_m": z}`
    Distance {
        /// Distance of the plane from the lens.
        distance_m: f64,
    },
    /// `{"at": "front_center"}`
    At {
        /// A named place.
        at: FocusAt,
    },
}

/// A focus found from the scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FocusAt {
    /// Mean z of the four centre pixels of the front depth image, as published; of a mesh, z where the ray through
    /// the film's centre first meets it.
    FrontCenter,
    /// The same of the back: the mirror image of its centre is in focus.
    BackCenter,
    /// Infinitely far away.
    Infinity,
}

/// The plane-parallel pane.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Glass {
    /// Distance of the front face from the lens along the optical axis.
    pub distance_m: f64,
    /// Thickness; 0 is allowed.
    pub thickness_m: f64,
    /// Index of refraction against air, at least 1.
    pub ior: f64,
    /// Absorption coefficient of red, green and blue, per metre of path in the glass.
    #[serde(default)]
    pub absorption_per_m: [f64; 3],
    /// `[pitch, yaw]`: rotation about +x, then +y, right-handed; pivot (0, 0, distance_m).
    #[serde(default)]
    pub tilt_deg: [f64; 2],
}
