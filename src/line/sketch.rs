//! A shape in place of a photograph's depth image.

use glasshouse_keys::keys;

/// The assumed shape of a photograph without depth.
#[keys]
#[derive(Copy)]
#[serde(
    untagged,
    expecting = r#"sketch must be {"plane_m": z} or {"wall_m": z, "camera_height_m": h, "horizon": y}"#
)]
pub enum Sketch {
    /// A plane at right angles to the optical axis.
    Plane {
        /// Depth of a plane at right angles to the optical axis.
        #[key("[0.001, 1e6] m")]
        plane_m: f64,
    },
    /// A horizontal ground before an upright wall.
    Ground {
        /// Depth of the wall behind a horizontal ground, which also carries everything above the horizon.
        #[key("[0.001, 1e6] m")]
        wall_m: f64,
        /// Height of the camera above the ground.
        #[key("[0.01, 1000] m", default = CAMERA_HEIGHT_M, shown = "1.5", written)]
        camera_height_m: f64,
        /// Row of the horizon, as a share of the picture's height from above.
        #[key("[0, 1]", default = HORIZON, shown = "0.5", written)]
        horizon: f64,
    },
}

/// Height of a camera in a standing person's hands, m.
pub const CAMERA_HEIGHT_M: f64 = 1.5;
/// Horizon of a camera that is held level.
pub const HORIZON: f64 = 0.5;

#[cfg(test)]
mod tests {
    use super::super::error::check_section;
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
        let error = check_section(&low, "front.sketch").unwrap_err().to_string();
        assert_eq!(error, "front.sketch.camera_height_m is 0, but must be 0.01 to 1000 m");
        let far = Sketch::Plane { plane_m: 1e9 };
        assert!(
            check_section(&far, "back.sketch")
                .unwrap_err()
                .to_string()
                .starts_with("back.sketch.plane_m is")
        );
    }
}
