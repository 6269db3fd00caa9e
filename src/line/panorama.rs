//! An equirectangular panorama as one side of the pane.

use super::card::Card;
use super::depth_range::DepthRange;
use super::highlights::Highlights;
use super::image::{Apex, DepthKind, Fill, Transfer, is_white};
use serde::Serialize;

/// An image of all directions around one point: columns are longitudes, rows are latitudes, and the centre is +z.
///
/// Replaces a photograph: the loader converts the visible part to a pinhole view.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PanoramaFile {
    /// Path of the image: relative to the manifest, or `NAME:path` under a named root.
    pub panorama: String,
    /// Transfer function of the image.
    pub transfer: Transfer,
    /// Factor on linear radiance.
    pub exposure: f64,
    /// Factors on red, green and blue of linear radiance: the colour of the light on this side.
    #[serde(skip_serializing_if = "is_white")]
    pub illuminant: [f64; 3],
    /// Curve that raises the radiance of clipped sRGB values.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub highlights: Option<Highlights>,
    /// Distances of the surfaces along the rays.
    #[serde(flatten)]
    pub depth: PanoramaDepth,
    /// Rotation of the view to the right of the panorama's centre.
    pub yaw_deg: f64,
    /// Upward rotation of the view, before the rotation to the right.
    pub pitch_deg: f64,
    /// Only for the back: position of the panorama's point of view (`mirror` if missing).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub apex: Option<Apex>,
    /// Flat pictures between the pane and the surface.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub cards: Vec<Card>,
}

/// Distances along the rays of a panorama.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum PanoramaDepth {
    Constant { depth_m: f64 },
    Map(DepthMap),
}

/// An equirectangular map of distances, of any size.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DepthMap {
    /// Path of the file.
    pub depth: String,
    /// Metres per unit of the file.
    pub depth_unit_m: f64,
    /// Value in the file that means "no distance".
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_none_code: Option<f64>,
    /// Kind of the distances: along the ray, or relative. Never z, because a panorama has no optical axis.
    pub depth_kind: DepthKind,
    /// Range of relative distances in metres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_range: Option<DepthRange>,
    /// Method that fills holes.
    pub fill: Fill,
}

impl PanoramaDepth {
    /// Default of `depth_m`.
    pub const DEFAULT_M: f64 = 10.0;
}
