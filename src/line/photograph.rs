//! An RGBD photograph as one side of the pane.

use super::card::Card;
use super::depth_range::DepthRange;
use super::highlights::Highlights;
use super::image::{
    Apex, DepthKind, Fill, Intrinsics, Orientation, Transfer, is_default, is_white, one, white,
};
use super::sketch::Sketch;
use serde::{Deserialize, Serialize};

/// An RGBD photograph: the radiance and the shape of one side.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Photograph {
    /// Path of the colour image: relative to the manifest, or `NAME:path` under a named root.
    pub color: String,
    /// Path of the depth image; empty with a `sketch`.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub depth: String,
    /// Assumed shape in place of a depth image.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sketch: Option<Sketch>,
    /// Path of the mask; 0 marks invalid pixels. Without a mask, every finite depth above 0 is valid.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mask: Option<String>,
    /// Order of the pixels to which `depth`, `mask` and `intrinsics` refer.
    #[serde(default, skip_serializing_if = "is_default")]
    pub orientation: Orientation,
    /// Transfer function of the colour image.
    #[serde(default)]
    pub transfer: Transfer,
    /// Metres per unit of the depth file.
    #[serde(default = "one")]
    pub depth_unit_m: f64,
    /// Value in the depth file that means "no depth".
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth_none_code: Option<f64>,
    /// Quantity that the depth file holds.
    #[serde(default)]
    pub depth_kind: DepthKind,
    /// Range of a relative depth in metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth_range: Option<DepthRange>,
    pub intrinsics: Intrinsics,
    /// Factor on linear radiance.
    #[serde(default = "one")]
    pub exposure: f64,
    /// Factors on red, green and blue of linear radiance: the colour of the light on this side.
    #[serde(default = "white", skip_serializing_if = "is_white")]
    pub illuminant: [f64; 3],
    /// Curve that raises the radiance of clipped sRGB values; none if missing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub highlights: Option<Highlights>,
    /// Method that fills holes of the depth image.
    #[serde(default, skip_serializing_if = "is_default")]
    pub fill: Fill,
    /// Only for the back: position of the capture camera (`mirror` if missing).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub apex: Option<Apex>,
    /// Flat pictures between the pane and the surface.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub cards: Vec<Card>,
}
