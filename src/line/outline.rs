//! The edges of a pane that ends inside the picture, and its frame.

use super::error::LineError;
use glasshouse_keys::keys;

/// Largest radiance of a frame for the camera: single precision holds the sums of its samples.
const MOST_RADIANCE: f64 = 1.0e30;

/// A rectangle of glass, with an opaque frame around it. Beyond the frame, the camera looks past the pane.
///
/// Coordinates lie in the plane of the front face: x = (p - P) . e_x and y = (p - P) . e_y, with P = (0, 0, distance_m) and the
/// axes of the camera turned by `tilt_deg`. The point at which a camera ray enters decides for all its orders.
#[keys(recipe = OutlineRecipe)]
pub struct Outline {
    /// Left and right edge of the glass, in the plane of its front face; 0 lies on the optical axis.
    #[key("(-inf, inf) m")]
    pub x_m: [f64; 2],
    /// Upper and lower edge of the glass.
    #[key("(-inf, inf) m")]
    pub y_m: [f64; 2],
    /// Width of the opaque frame, outside of the glass on all four sides.
    #[key("[0, inf) m", default = 0.0)]
    pub frame_m: f64,
    /// Linear radiance of the frame: red, green, blue; the exposure and the white balance of the camera apply to it.
    #[key("[0, 1e9]", default = [0.0; 3])]
    pub frame_radiance: [f64; 3],
}

impl Outline {
    /// Checks the edges, and the frame for a camera with this exposure and white balance.
    pub(super) fn check(&self, exposure: f64, white_balance: [f64; 3]) -> Result<(), LineError> {
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
