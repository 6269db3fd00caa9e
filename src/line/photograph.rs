//! An RGBD photograph as one side of the pane.

use super::card::Card;
use super::depth_range::DepthRange;
use super::highlights::Highlights;
use super::image::{Apex, DepthKind, Fill, Intrinsics, Orientation, Transfer};
use super::sketch::Sketch;
use glasshouse_keys::keys;

/// An RGBD photograph: the radiance and the shape of one side.
#[keys]
pub struct Photograph {
    /// Path of the colour image: relative to the manifest, or `NAME:path` under a named root.
    pub color: String,
    /// Path of the depth image; missing with a `sketch`.
    #[key(default = String::new(), shown = "none")]
    pub depth: String,
    /// Assumed shape in place of a depth image.
    pub sketch: Option<Sketch>,
    /// Path of the mask; 0 marks invalid pixels. Without a mask, every finite depth above 0 is valid.
    pub mask: Option<String>,
    /// Pixels to which `depth`, `mask` and `intrinsics` refer: `upright` (EXIF orientations are applied) or `stored` (they are ignored,
    /// in all files of the photograph).
    #[key(default = Orientation::Upright)]
    pub orientation: Orientation,
    /// Transfer function of the colour image: `srgb` (IEC 61966-2-1, or what the file states) or `linear`.
    #[key(default = Transfer::Srgb, written)]
    pub transfer: Transfer,
    /// Metres per unit of the depth file.
    #[key("(0, inf) m", default = 1.0, written)]
    pub depth_unit_m: f64,
    /// Value in the depth file that means "no depth", such as 65535; these pixels are holes.
    #[key("(-inf, inf)")]
    pub depth_none_code: Option<f64>,
    /// Quantity that the depth file holds: `z` along the axis, `distance` along the ray; or an estimate up to scale and shift, `relative`
    /// (of z, larger is farther: Marigold) or `relative_inverse` (of 1/z, larger is nearer: MiDaS, Depth Anything).
    #[key(default = DepthKind::Z, written)]
    pub depth_kind: DepthKind,
    /// Range of a relative depth in metres.
    pub depth_range: Option<DepthRange>,
    /// The capture camera.
    pub intrinsics: Intrinsics,
    /// Factor on linear radiance.
    #[key("[0, inf)", default = 1.0, written)]
    pub exposure: f64,
    /// Factors on red, green and blue of linear radiance: the colour of the light on this side.
    #[key("[0, inf)", default = [1.0; 3])]
    pub illuminant: [f64; 3],
    /// Curve that raises the radiance of clipped sRGB values.
    pub highlights: Option<Highlights>,
    /// Method that fills holes of the depth image: `smooth` (pull-push in inverse depth) or `far` (the farthest valid depth).
    #[key(default = Fill::Smooth)]
    pub fill: Fill,
    /// Only for the back: position of the capture camera, `mirror` (as if missing) or `camera`.
    pub apex: Option<Apex>,
    /// Flat pictures between the pane and the surface, at most 16.
    pub cards: Vec<Card>,
}
