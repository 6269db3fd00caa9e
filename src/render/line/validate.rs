//! Whether a scene line makes sense by itself: every number within its range, every path given.

use super::depth_range;
use super::error::{LineError, out_of_range, within};
use super::limits;
use super::panorama::{PanoramaDepth, PanoramaFile};
use super::photograph::Photograph;
use super::scene_line::{Focus, SCENE_SCHEMA, SceneLine};
use super::side::{MeshFile, Side};

impl SceneLine {
    /// Checks every field by itself; [`crate::scene::check_geometry`] checks pane, lens and film together.
    pub fn validate(&self) -> Result<(), LineError> {
        if self.schema != SCENE_SCHEMA {
            return Err(LineError::Schema {
                found: self.schema.clone(),
            });
        }
        let film = &self.film;
        within("film.width", film.width.into(), limits::FILM_SIDE)?;
        within("film.height", film.height.into(), limits::FILM_SIDE)?;
        if !limits::is_sample_count(film.spp.into()) {
            return Err(out_of_range("film.spp", film.spp.into(), limits::SPP));
        }
        within(
            "film.order_tolerance",
            film.order_tolerance,
            limits::ORDER_TOLERANCE,
        )?;
        if let Some(target) = film.target_error {
            within("film.target_error", target, limits::TARGET_ERROR)?;
        }

        let camera = &self.camera;
        within(
            "camera.focal_length_mm",
            camera.focal_length_mm,
            limits::FOCAL_LENGTH_MM,
        )?;
        within(
            "camera.aperture_radius_m",
            camera.aperture_radius_m,
            limits::APERTURE_RADIUS_M,
        )?;
        within("camera.exposure", camera.exposure, limits::EXPOSURE)?;
        white("camera.white_balance", camera.white_balance)?;
        if let Focus::Distance { distance_m } = camera.focus {
            within(
                "camera.focus.distance_m",
                distance_m,
                limits::FOCUS_DISTANCE_M,
            )?;
        }

        let glass = &self.glass;
        within(
            "glass.distance_m",
            glass.distance_m,
            limits::GLASS_DISTANCE_M,
        )?;
        within("glass.thickness_m", glass.thickness_m, limits::THICKNESS_M)?;
        within("glass.ior", glass.ior, limits::IOR)?;
        for (index, &value) in glass.absorption_per_m.iter().enumerate() {
            let field = format!("glass.absorption_per_m[{index}]");
            within(&field, value, limits::ABSORPTION_PER_M)?;
        }
        for (index, &value) in glass.tilt_deg.iter().enumerate() {
            within(&format!("glass.tilt_deg[{index}]"), value, limits::TILT_DEG)?;
        }

        side("front", &self.front)?;
        side("back", &self.back)?;
        if self.front.apex().is_some() {
            return Err(LineError::ApexOfFront);
        }
        Ok(())
    }
}

/// Checks the paths and numbers of one side, which errors call `name`.
pub fn side(name: &str, side: &Side) -> Result<(), LineError> {
    for (key, path) in side.paths() {
        if path.is_empty() {
            return Err(LineError::EmptyPath {
                field: format!("{name}.{key}"),
            });
        }
    }
    match side {
        Side::Photograph(side) => photograph(name, side),
        Side::Panorama(side) => panorama(name, side),
        Side::Mesh(side) => mesh(name, side),
    }
}

fn panorama(side: &str, panorama: &PanoramaFile) -> Result<(), LineError> {
    for (key, value, limit) in [
        ("exposure", panorama.exposure, limits::EXPOSURE),
        ("yaw_deg", panorama.yaw_deg, limits::YAW_DEG),
        ("pitch_deg", panorama.pitch_deg, limits::PITCH_DEG),
    ] {
        within(&format!("{side}.{key}"), value, limit)?;
    }
    white(&format!("{side}.illuminant"), panorama.illuminant)?;
    if let Some(highlights) = &panorama.highlights {
        highlights.validate(&format!("{side}.highlights"), panorama.transfer)?;
    }
    match &panorama.depth {
        PanoramaDepth::Constant { depth_m } => within(
            &format!("{side}.depth_m"),
            *depth_m,
            limits::PANORAMA_DEPTH_M,
        ),
        PanoramaDepth::Map(map) => {
            within(
                &format!("{side}.depth_unit_m"),
                map.depth_unit_m,
                limits::DEPTH_UNIT_M,
            )?;
            depth_range::check(side, map.depth_kind, map.depth_range.as_ref())
        }
    }
}

/// Largest deviation of `rotation` times its transpose from the unit matrix: five digits are enough to write one.
const MAX_DISTORTION: f64 = 1e-4;

/// Factors of red, green and blue.
fn white(field: &str, factors: [f64; 3]) -> Result<(), LineError> {
    for (index, factor) in factors.into_iter().enumerate() {
        within(&format!("{field}[{index}]"), factor, limits::EXPOSURE)?;
    }
    Ok(())
}

fn mesh(side: &str, mesh: &MeshFile) -> Result<(), LineError> {
    within(&format!("{side}.unit_m"), mesh.unit_m, limits::MESH_UNIT_M)?;
    within(&format!("{side}.exposure"), mesh.exposure, limits::EXPOSURE)?;
    white(&format!("{side}.illuminant"), mesh.illuminant)?;
    let Some(pose) = &mesh.pose else {
        return Ok(());
    };
    if pose.distortion() > MAX_DISTORTION {
        return Err(LineError::NoRotation {
            field: format!("{side}.pose.rotation"),
        });
    }
    for (index, &value) in pose.translation_m.iter().enumerate() {
        let field = format!("{side}.pose.translation_m[{index}]");
        within(&field, value, limits::TRANSLATION_M)?;
    }
    Ok(())
}

fn photograph(side: &str, photograph: &Photograph) -> Result<(), LineError> {
    let intrinsics = &photograph.intrinsics;
    let numbers = [
        (
            "depth_unit_m",
            photograph.depth_unit_m,
            limits::DEPTH_UNIT_M,
        ),
        ("exposure", photograph.exposure, limits::EXPOSURE),
        ("intrinsics.fx", intrinsics.fx, limits::FOCAL_LENGTH_PX),
        ("intrinsics.fy", intrinsics.fy, limits::FOCAL_LENGTH_PX),
        ("intrinsics.cx", intrinsics.cx, limits::PRINCIPAL_POINT_PX),
        ("intrinsics.cy", intrinsics.cy, limits::PRINCIPAL_POINT_PX),
    ];
    for (key, value, limit) in numbers {
        within(&format!("{side}.{key}"), value, limit)?;
    }
    white(&format!("{side}.illuminant"), photograph.illuminant)?;
    for (index, &pixels) in intrinsics.size.iter().flatten().enumerate() {
        let field = format!("{side}.intrinsics.size[{index}]");
        within(&field, pixels.into(), limits::IMAGE_SIDE)?;
    }
    if let Some(highlights) = &photograph.highlights {
        highlights.validate(&format!("{side}.highlights"), photograph.transfer)?;
    }
    depth_range::check(side, photograph.depth_kind, photograph.depth_range.as_ref())
}

#[cfg(test)]
mod tests {
    use super::super::image::Apex;
    use super::super::published::{photograph, published};
    use super::*;

    #[test]
    fn the_published_scene_is_sound() {
        published().validate().unwrap();
    }

    #[test]
    fn meshes_have_ranges_too() {
        let with = |mesh: &str| {
            let mut line = published();
            line.back = serde_json::from_str(mesh).unwrap();
            line.validate().map_err(|error| error.to_string())
        };
        with(r#"{"mesh":"m","apex":"camera","pose":{"rotation":[[0,0,1],[0,1,0],[-1,0,0]]}}"#)
            .unwrap();
        // Five digits of cos and sin 45 degrees.
        with(r#"{"mesh":"m","pose":{"rotation":[[0.70711,0,0.70711],[0,1,0],[-0.70711,0,0.70711]]}}"#)
            .unwrap();
        for (mesh, message) in [
            (r#"{"mesh":""}"#, "back.mesh is empty"),
            (
                r#"{"mesh":"m","unit_m":0}"#,
                "back.unit_m is 0, but must be",
            ),
            (r#"{"mesh":"m","exposure":-1}"#, "back.exposure is -1"),
            (
                r#"{"mesh":"m","pose":{"translation_m":[0,1e9,0]}}"#,
                "back.pose.translation_m[1] is 1000000000",
            ),
            (
                r#"{"mesh":"m","pose":{"rotation":[[1,0,0],[0,1,0],[0,0,-1]]}}"#,
                "back.pose.rotation is no rotation",
            ),
            (
                r#"{"mesh":"m","pose":{"rotation":[[0.01,0,0],[0,0.01,0],[0,0,0.01]]}}"#,
                "back.pose.rotation is no rotation",
            ),
        ] {
            let error = with(mesh).unwrap_err();
            assert!(error.starts_with(message), "{error} for {message}");
        }
        let mut line = published();
        line.front = serde_json::from_str(r#"{"mesh":"m","apex":"mirror"}"#).unwrap();
        assert_eq!(line.validate().unwrap_err(), LineError::ApexOfFront);
    }

    #[test]
    fn panoramas_and_highlights_have_ranges_too() {
        let with = |side: &str| {
            let mut line = published();
            line.back = serde_json::from_str(side).unwrap();
            line.validate().map_err(|error| error.to_string())
        };
        with(r#"{"panorama":"p","highlights":{"above":0.9,"to":8},"yaw_deg":-360,"pitch_deg":90}"#)
            .unwrap();
        with(r#"{"panorama":"p","depth":"d","depth_kind":"relative","depth_range":{"mean_m":3}}"#)
            .unwrap();
        for (side, message) in [
            (r#"{"panorama":""}"#, "back.panorama is empty"),
            (r#"{"panorama":"p","depth_m":0}"#, "back.depth_m is 0, but"),
            (r#"{"panorama":"p","yaw_deg":361}"#, "back.yaw_deg is 361"),
            (
                r#"{"panorama":"p","pitch_deg":-91}"#,
                "back.pitch_deg is -91",
            ),
            (
                r#"{"panorama":"p","depth":"d","depth_unit_m":0}"#,
                "back.depth_unit_m is 0",
            ),
            (
                r#"{"panorama":"p","depth":"d","depth_kind":"relative"}"#,
                "back.depth_kind is relative",
            ),
            (
                r#"{"panorama":"p","highlights":{"above":1,"to":8}}"#,
                "back.highlights.above is 1, but must be 0 or more and below 1",
            ),
            (
                r#"{"panorama":"p","highlights":{"above":0.9,"to":0.95}}"#,
                "back.highlights.to is 0.95, but must be 1 to 1e6",
            ),
            (
                r#"{"panorama":"p","transfer":"linear","highlights":{"above":0.9,"to":8}}"#,
                "back.highlights is given, but only images of transfer \"srgb\"",
            ),
        ] {
            let error = with(side).unwrap_err();
            assert!(error.starts_with(message), "{error} for {message}");
        }
        let mut line = published();
        photograph(&mut line.front).highlights = Some(super::super::highlights::Highlights {
            above: f64::NAN,
            to: 2.0,
        });
        let error = line.validate().unwrap_err().to_string();
        assert!(
            error.starts_with("front.highlights.above is NaN"),
            "{error}"
        );
    }

    type Spoil = fn(&mut SceneLine);

    /// A change that spoils a line, and how its error begins.
    const SPOILED: [(Spoil, &str); 28] = [
        (
            |l| l.film.width = 0,
            "film.width is 0, but must be 1 to 16384",
        ),
        (|l| l.film.height = 16_385, "film.height is 16385"),
        (
            |l| l.film.spp = 0,
            "film.spp is 0, but must be a power of two",
        ),
        (|l| l.film.spp = 96, "film.spp is 96"),
        (|l| l.film.spp = 131_072, "film.spp is 131072"),
        (
            |l| l.film.order_tolerance = -1.0,
            "film.order_tolerance is -1",
        ),
        (
            |l| l.film.target_error = Some(0.0),
            "film.target_error is 0, but must be finite and above 0",
        ),
        (
            |l| l.camera.focal_length_mm = 0.0,
            "camera.focal_length_mm is 0",
        ),
        (
            |l| l.camera.aperture_radius_m = -0.1,
            "camera.aperture_radius_m is -0.1",
        ),
        (
            |l| l.camera.focus = Focus::Distance { distance_m: 0.0 },
            "camera.focus.distance_m is 0",
        ),
        (
            |l| l.glass.distance_m = f64::INFINITY,
            "glass.distance_m is inf",
        ),
        (
            |l| l.glass.thickness_m = -0.01,
            "glass.thickness_m is -0.01",
        ),
        (
            |l| l.glass.ior = 0.99,
            "glass.ior is 0.99, but must be 1 to 10",
        ),
        (|l| l.glass.ior = 11.0, "glass.ior is 11"),
        (|l| l.glass.ior = f64::NAN, "glass.ior is NaN"),
        (
            |l| l.glass.absorption_per_m[2] = -1.0,
            "glass.absorption_per_m[2] is -1",
        ),
        (|l| l.glass.tilt_deg[0] = 90.0, "glass.tilt_deg[0] is 90"),
        (|l| l.glass.tilt_deg[1] = -90.0, "glass.tilt_deg[1] is -90"),
        (
            |l| photograph(&mut l.front).depth_unit_m = 0.0,
            "front.depth_unit_m is 0",
        ),
        (
            |l| photograph(&mut l.back).exposure = f64::NAN,
            "back.exposure is NaN",
        ),
        (
            |l| photograph(&mut l.front).intrinsics.fx = 0.0,
            "front.intrinsics.fx is 0",
        ),
        (
            |l| photograph(&mut l.back).intrinsics.fy = -1.0,
            "back.intrinsics.fy is -1",
        ),
        (
            |l| photograph(&mut l.back).intrinsics.cx = f64::NAN,
            "back.intrinsics.cx is NaN",
        ),
        (
            |l| photograph(&mut l.front).intrinsics.size = Some([0, 3]),
            "front.intrinsics.size[0] is 0",
        ),
        (
            |l| photograph(&mut l.front).apex = Some(Apex::Mirror),
            "front.apex",
        ),
        (
            |l| photograph(&mut l.front).color.clear(),
            "front.color is empty",
        ),
        (
            |l| photograph(&mut l.back).mask = Some(String::new()),
            "back.mask is empty",
        ),
        (
            |l| l.schema = "glasshouse.scene/2".into(),
            "schema is \"glasshouse.scene/2\"",
        ),
    ];

    #[test]
    fn every_bad_field_is_named_with_its_value_and_range() {
        for (spoil, message) in SPOILED {
            let mut line = published();
            spoil(&mut line);
            let error = line.validate().unwrap_err().to_string();
            assert!(error.starts_with(message), "{error} for {message}");
        }
    }
}
