//! Transfer function, depth kind, hole filling and camera of a side's images.

use super::keys::words;
use glasshouse_keys::keys;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Transfer function of a colour image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Transfer {
    /// IEC 61966-2-1.
    #[default]
    Srgb,
    /// Values are linear radiance.
    Linear,
}

/// Order of the pixels of a photograph's files.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Orientation {
    /// The EXIF orientation of each file is applied.
    #[default]
    Upright,
    /// The rows as they are stored: EXIF orientations are ignored.
    Stored,
}

/// Quantity that a depth value measures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum DepthKind {
    /// Distance along the optical axis.
    #[default]
    Z,
    /// Distance along the ray.
    Distance,
    /// A depth up to scale and shift (Marigold): larger is farther. `depth_range` gives metres.
    Relative,
    /// An inverse depth up to scale and shift (MiDaS, Depth Anything): larger is nearer. `depth_range` gives metres.
    RelativeInverse,
}

/// Method that fills holes of a depth image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Fill {
    /// Pull-push interpolation of inverse depth.
    #[default]
    Smooth,
    /// The farthest valid depth of the image, for sky.
    Far,
}

/// Position of the capture camera of the back side.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Apex {
    /// At the mirror image of the lens in the front face: R is the mirrored image itself.
    #[default]
    Mirror,
    /// At the lens, turned by 180 degrees about the vertical.
    Camera,
}

/// A pinhole camera. The image's top left corner is at (0, 0), and the centre of pixel (i, j) is at (i + 0.5, j + 0.5).
#[keys]
#[derive(Copy)]
pub struct Intrinsics {
    /// Horizontal focal length.
    #[key("(0, inf) px")]
    pub fx: f64,
    /// Vertical focal length.
    #[key("(0, inf) px")]
    pub fy: f64,
    /// Horizontal position of the principal point.
    #[key("(-inf, inf) px")]
    pub cx: f64,
    /// Vertical position of the principal point.
    #[key("(-inf, inf) px")]
    pub cy: f64,
    /// Size `[width, height]` of the image that the other keys describe; the size of the depth image if missing.
    #[key("[1, 4294967295] px whole")]
    pub size: Option<[u32; 2]>,
}

words!(Transfer, Orientation, DepthKind, Fill, Apex);

impl Intrinsics {
    /// Returns DIODE's capture camera, the same for every image (intrinsics.txt of its devkit).
    pub fn diode() -> Self {
        Self { fx: 886.81, fy: 927.06, cx: 512.0, cy: 384.0, size: Some([1024, 768]) }
    }
}

/// Returns 1, the default of factors, as the function that serde needs.
pub fn one() -> f64 {
    1.0
}
