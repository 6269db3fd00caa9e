//! A shape in place of a photograph's depth image.

use super::error::{LineError, all_within};
use serde::{Deserialize, Serialize};

/// The assumed shape of a photograph without depth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(
    untagged,
    deny_unknown_fields,
    expecting = r#"sketch must be {"plane_m": z} or {"wall_m": z, "camera_height_m": h, "horizon": y}"#
)]
pub enum Sketch {
    /// A plane at right angles to the optical axis.
    Plane {
        /// Its depth.
        plane_m: f64,
    },
    /// A horizontal ground before an upright wall.
    Ground {
        /// Depth of the wall, which also carries everything above the horizon.
        wall_m: f64,
        /// Height of the camera above the ground.
        #[serde(default = "camera_height_m")]
        camera_height_m: f64,
        /// Row of the horizon, as a share of the picture's height from above.
        #[serde(default = "horizon")]
        horizon: f64,
    },
}

/// Height of a camera in a standing person's hands, m.
pub const CAMERA_HEIGHT_M: f64 = 1.5;
/// Horizon of a camera that is held level.
pub const HORIZON: f64 = 0.5;

fn camera_height_m() -> f64 {
    CAMERA_HEIGHT_M
}

fn horizon() -> f64 {
    HORIZON
}

impl Sketch {
    /// Checks each number. Errors begin with `side`.
    pub(super) fn check(&self, side: &str) -> Result<(), LineError> {
        let section = format!("{side}.sketch");
        match self {
            Self::Plane { plane_m } => all_within(&section, &[("plane_m", &[*plane_m])]),
            Self::Ground { wall_m, camera_height_m, horizon } => all_within(
                &section,
                &[
                    ("wall_m", &[*wall_m]),
                    ("camera_height_m", &[*camera_height_m]),
                    ("horizon", &[*horizon]),
                ],
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sketches_have_one_form_and_defaults() {
        let parse = |text: &str| serde_json::from_str::<Sketch>(text).map_err(|e| e.to_string());
        assert_eq!(parse(r#"{"plane_m": 4}"#), Ok(Sketch::Plane { plane_m: 4.0 }));
        let ground = Sketch::Ground { wall_m: 9.0, camera_height_m: 1.5, horizon: 0.5 };
        assert_eq!(parse(r#"{"wall_m": 9}"#), Ok(ground));
        for wrong in ["{}", r#"{"plane_m": 4, "wall_m": 9}"#, r#"{"horizon": 0.4}"#, "4"] {
            assert!(parse(wrong).unwrap_err().contains("sketch must be"), "{wrong}");
        }
        let low = Sketch::Ground { wall_m: 9.0, camera_height_m: 0.0, horizon: 0.5 };
        let error = low.check("front").unwrap_err().to_string();
        assert_eq!(error, "front.sketch.camera_height_m is 0, but must be 0.01 to 1000 m");
        let far = Sketch::Plane { plane_m: 1e9 };
        assert!(far.check("back").unwrap_err().to_string().starts_with("back.sketch.plane_m is"));
    }
}
