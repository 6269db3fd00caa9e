//! Radiance of clipped highlights.

use super::error::{LineError, check_section};
use super::image::Transfer;
use glasshouse_keys::keys;

/// An inverse tone curve for sRGB images, which maps linear values near 1 to values above 1.
#[keys]
#[derive(Copy)]
pub struct Highlights {
    /// Linear value of a pixel's largest channel above which the curve raises the pixel.
    #[key("[0, 1)")]
    pub above: f64,
    /// Linear value that 1 becomes.
    #[key("[1, 1e6]")]
    pub to: f64,
}

impl Highlights {
    /// Checks the numbers and the transfer; errors name `field`.
    pub fn validate(&self, field: &str, transfer: Transfer) -> Result<(), LineError> {
        check_section(self, field)?;
        if transfer == Transfer::Srgb {
            Ok(())
        } else {
            Err(LineError::HighlightsOfLight { field: field.to_owned() })
        }
    }
}
