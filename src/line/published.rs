//! The scene line that examples and tests modify.

use super::scene_line::SceneLine;

/// Returns a scene line with the camera and the DIODE intrinsics of the published setup, for examples and tests.
///
/// # Panics
///
/// Never: a test reads the text.
pub fn published() -> SceneLine {
    serde_json::from_str(
        r#"{"schema":"glasshouse.scene/1","id":"000412","seed":412,
            "film":{"width":256,"height":256,"spp":256,"filter":"box"},
            "camera":{"focal_length_mm":55.0,"aperture_radius_m":0.00893,
                      "focus":{"distance_m":7.05}},
            "glass":{"distance_m":0.30,"thickness_m":0.010,"ior":1.6,
                     "absorption_per_m":[0,0,0],"tilt_deg":[0,0]},
            "front":{"color":"a.png","depth":"a_depth.npy","mask":"a_depth_mask.npy",
                     "transfer":"srgb","depth_unit_m":1.0,"exposure":1.0,
                     "intrinsics":{"fx":886.81,"fy":927.06,"cx":512,"cy":384}},
            "back":{"color":"b.png","depth":"b_depth.npy","apex":"mirror",
                    "intrinsics":{"fx":886.81,"fy":927.06,"cx":512,"cy":384}}}"#,
    )
    .expect("a test reads the text")
}

/// Returns the photograph of a side; panics for a panorama or a mesh.
#[cfg(test)]
pub(super) fn photograph(side: &mut super::Side) -> &mut super::Photograph {
    use super::Side;
    match side {
        Side::Photograph(photograph) => photograph,
        Side::Panorama(_) | Side::Mesh(_) => panic!("not a photograph"),
    }
}
