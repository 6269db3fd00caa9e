//! Waves in the faces of a pane.

use super::error::{LineError, all_within};
use super::image::is_default;
use serde::{Deserialize, Serialize};

/// Largest slope of waves. With steeper faces, the tracer's step to a face would lose its precision.
pub const MAX_WAVE_SLOPE: f64 = 0.05;

/// Waves that all faces share, such as the roller waves of tempered glass: heights A sin(2 pi s / length) over the flat pane.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wave {
    /// Height A of the crests, m; 0 is flat.
    pub amplitude_m: f64,
    /// Distance from crest to crest, m.
    pub length_m: f64,
    /// Direction across the crests in the pane, from right to down; s is 0 at the pivot.
    #[serde(default, skip_serializing_if = "is_default")]
    pub direction_deg: f64,
}

impl Wave {
    /// Returns the largest slope of the faces.
    pub fn largest_slope(&self) -> f64 {
        std::f64::consts::TAU * self.amplitude_m / self.length_m
    }

    pub(super) fn check(&self) -> Result<(), LineError> {
        all_within(
            "glass.wave",
            &[
                ("amplitude_m", &[self.amplitude_m]),
                ("length_m", &[self.length_m]),
                ("direction_deg", &[self.direction_deg]),
            ],
        )?;
        let slope = self.largest_slope();
        if slope > MAX_WAVE_SLOPE {
            return Err(LineError::SteepWave { slope, most: MAX_WAVE_SLOPE });
        }
        Ok(())
    }
}
