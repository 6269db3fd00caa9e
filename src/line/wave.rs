//! Waves in the faces of a pane.

use super::error::LineError;
use glasshouse_keys::keys;

/// Largest slope of waves. With steeper faces, the tracer's step to a face would lose its precision.
pub const MAX_WAVE_SLOPE: f64 = 0.05;

/// Waves that all faces share, such as the roller waves of tempered glass: heights A sin(2 pi s / L) over the flat pane, with
/// slopes of at most 0.05.
#[keys(recipe = WaveRecipe)]
#[derive(Copy)]
pub struct Wave {
    /// Height A of the crests; 0 is flat.
    #[key("[0, 1e4] m")]
    pub amplitude_m: f64,
    /// Distance L from crest to crest.
    // The phase of shorter waves exceeds single precision.
    #[key("[1e-5, 1e6] m")]
    pub length_m: f64,
    /// Direction across the crests in the pane, from right to down; s is 0 at the pivot.
    #[key("[-360, 360] degrees", default = 0.0)]
    pub direction_deg: f64,
}

impl Wave {
    /// Returns the largest slope of the faces.
    pub fn largest_slope(&self) -> f64 {
        std::f64::consts::TAU * self.amplitude_m / self.length_m
    }

    /// Checks the slopes.
    pub(super) fn check(&self) -> Result<(), LineError> {
        let slope = self.largest_slope();
        if slope > MAX_WAVE_SLOPE {
            return Err(LineError::SteepWave { slope, most: MAX_WAVE_SLOPE });
        }
        Ok(())
    }
}
