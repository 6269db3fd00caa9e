//! An RGBD photograph as one side of the pane.

use super::depth_range::DepthRange;
use super::highlights::Highlights;
use super::image::{Apex, DepthKind, Fill, Intrinsics, Transfer, is_default, is_white, one, white};
use serde::{Deserialize, Serialize};

/// An RGBD photograph: the radiance and the shape of one side.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Photograph {
    /// Path of the colour image: relative to the manifest, or `NAME:path` under a named root.
    pub color: String,
    /// Path of the depth image.
    pub depth: String,
    /// Path of the mask (0 is invalid). Without it every finite depth above 0 is valid.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mask: Option<String>,
    /// Coding of the colour image.
    #[serde(default)]
    pub transfer: Transfer,
    /// Metres per unit of the depth file.
    #[serde(default = "one")]
    pub depth_unit_m: f64,
    /// Quantity of the depth file.
    #[serde(default)]
    pub depth_kind: DepthKind,
    /// Metres for a relative depth.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth_range: Option<DepthRange>,
    pub intrinsics: Intrinsics,
    /// Multiplies linear radiance.
    #[serde(default = "one")]
    pub exposure: f64,
    /// Multiplies red, green and blue of linear radiance: the colour of the light that falls on this side.
    #[serde(default = "white", skip_serializing_if = "is_white")]
    pub illuminant: [f64; 3],
    /// Light for clipped sRGB values; none if missing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub highlights: Option<Highlights>,
    /// How holes of the depth image are filled.
    #[serde(default, skip_serializing_if = "is_default")]
    pub fill: Fill,
    /// Only for the back: position of the capture camera (`mirror` if missing).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub apex: Option<Apex>,
}
