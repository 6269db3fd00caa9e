//! The edges of a pane that ends inside the picture, and its frame.

use super::image::is_default;
use serde::{Deserialize, Serialize};

/// A rectangle of glass, with an opaque frame around it. Beyond the frame, the camera looks past the pane.
///
/// Coordinates lie in the plane of the front face: x = (p - P) . e_x and y = (p - P) . e_y, with P = (0, 0, distance_m) and the
/// axes of the camera turned by `tilt_deg`. The point at which a camera ray enters decides for all its orders.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Outline {
    /// Interval of the glass across.
    pub x_m: [f64; 2],
    /// Interval of the glass down.
    pub y_m: [f64; 2],
    /// Width of the frame, outside of the glass on all four sides.
    #[serde(default, skip_serializing_if = "is_default")]
    pub frame_m: f64,
    /// Linear radiance of the frame, before the exposure and the white balance of the camera.
    #[serde(default, skip_serializing_if = "is_default")]
    pub frame_radiance: [f64; 3],
}
