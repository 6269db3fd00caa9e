//! The edges of a pane that ends inside the picture, and its frame.

use super::error::{LineError, all_within};
use super::image::is_default;
use serde::{Deserialize, Serialize};

/// Largest radiance of a frame for the camera: single precision holds the sums of its samples.
const MOST_RADIANCE: f64 = 1.0e30;

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

impl Outline {
    /// Checks the edges, and the frame for a camera with this exposure and white balance.
    pub(super) fn check(&self, exposure: f64, white_balance: [f64; 3]) -> Result<(), LineError> {
        all_within(
            "glass.outline",
            &[
                ("x_m", &self.x_m),
                ("y_m", &self.y_m),
                ("frame_m", &[self.frame_m]),
                ("frame_radiance", &self.frame_radiance),
            ],
        )?;
        for (field, [low, high]) in
            [("glass.outline.x_m", self.x_m), ("glass.outline.y_m", self.y_m)]
        {
            if low >= high {
                return Err(LineError::EmptyOutline { field, low, high });
            }
        }
        for (channel, radiance) in self.frame_radiance.iter().enumerate() {
            let radiance = radiance * exposure * white_balance[channel];
            // The comparison is false for NaN, too.
            let is_allowed = radiance <= MOST_RADIANCE;
            if !is_allowed {
                return Err(LineError::FrameRadiance { channel, radiance, most: MOST_RADIANCE });
            }
        }
        Ok(())
    }
}
