//! Radiance of clipped highlights.

use super::error::{LineError, within};
use super::image::Transfer;
use super::limits;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// An inverse tone curve for sRGB images, which maps linear values near 1 to values above 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Highlights {
    /// Linear value of a pixel's largest channel above which the curve raises the pixel.
    pub above: f64,
    /// Linear value that 1 becomes.
    pub to: f64,
}

impl Highlights {
    /// Checks the numbers and the transfer; errors name `field`.
    pub fn validate(&self, field: &str, transfer: Transfer) -> Result<(), LineError> {
        within(&format!("{field}.above"), self.above, limits::BELOW_WHITE)?;
        within(&format!("{field}.to"), self.to, limits::WHITE_BECOMES)?;
        if transfer == Transfer::Srgb {
            Ok(())
        } else {
            Err(LineError::HighlightsOfLight { field: field.to_owned() })
        }
    }
}
