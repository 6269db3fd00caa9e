//! An equirectangular panorama as one side of the pane.

use super::depth_range::DepthRange;
use super::highlights::Highlights;
use super::image::{Apex, DepthKind, Fill, Transfer, is_white};
use serde::Serialize;

/// All directions around one point, seen from there: columns are longitude, rows latitude, the centre is +z.
///
/// Replaces a photograph: loading turns the part that the film sees into a pinhole view.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PanoramaFile {
    /// Path of the image: relative to the manifest, or `NAME:path` under a named root.
    pub panorama: String,
    /// Coding of the image.
    pub transfer: Transfer,
    /// Multiplies linear radiance.
    pub exposure: f64,
    /// Multiplies red, green and blue of linear radiance: the colour of the light that falls on this side.
    #[serde(skip_serializing_if = "is_white")]
    pub illuminant: [f64; 3],
    /// Light for clipped sRGB values.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub highlights: Option<Highlights>,
    /// Distances along the rays.
    #[serde(flatten)]
    pub depth: PanoramaDepth,
    /// Degrees by which the view turns to the right of the panorama's centre.
    pub yaw_deg: f64,
    /// Degrees by which the view then rises.
    pub pitch_deg: f64,
    /// Only for the back: position of the panorama's point of view (`mirror` if missing).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub apex: Option<Apex>,
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
    /// Along the ray, or relative; never along an axis, as there is none.
    pub depth_kind: DepthKind,
    /// Metres for relative distances.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_range: Option<DepthRange>,
    /// How holes are filled.
    pub fill: Fill,
}

impl PanoramaDepth {
    /// Default radius of the sphere.
    pub const DEFAULT_M: f64 = 10.0;
}
