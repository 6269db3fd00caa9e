//! Checks the fields of a scene line, for example that numbers are within their limits and that no path is empty.

use super::card::Card;
use super::coating;
use super::depth_range;
use super::error::{LineError, check_section};
use super::glass::{Glass, GlassLayer};
use super::glazing::GlazingName;
use super::image::DepthKind;
use super::panorama::{PanoramaDepth, PanoramaFile};
use super::photograph::Photograph;
use super::scene_line::{SCENE_SCHEMA, SceneLine};
use super::sensor::Sensor;
use super::side::{MeshFile, Side};
use super::smudges::Smudges;
use crate::layer::Layer;

impl SceneLine {
    /// Checks each field. `render::scene::check_geometry` checks pane, lens and film together.
    pub fn validate(&self) -> Result<(), LineError> {
        if self.schema != SCENE_SCHEMA {
            return Err(LineError::Schema { found: self.schema.clone() });
        }
        let (film, camera, glass) = (&self.film, &self.camera, &self.glass);
        check_section(self, "")?;
        glazing(glass)?;
        layers(glass)?;
        coating::check(&glass.coatings, glass.layers.len().max(1))?;
        bow(glass)?;
        wave(glass)?;
        roughness(glass)?;
        glass.smudges.as_ref().map_or(Ok(()), Smudges::check)?;
        glass
            .outline
            .as_ref()
            .map_or(Ok(()), |outline| outline.check(camera.exposure, camera.white_balance))?;
        side("front", &self.front)?;
        side("back", &self.back)?;
        if self.front.apex().is_some() {
            return Err(LineError::ApexOfFront);
        }
        if self.sensor.is_some() && !film.layers.asked()[Layer::Input] {
            return Err(LineError::SensorWithoutInput);
        }
        self.sensor.as_ref().map_or(Ok(()), Sensor::check)
    }
}

/// Largest number of characters in the name of a glazing.
const MAX_NAME: usize = 64;

fn glazing(glass: &Glass) -> Result<(), LineError> {
    let is_allowed = |c: u8| c.is_ascii_lowercase() || c.is_ascii_digit() || b".-".contains(&c);
    match &glass.glazing {
        Some(GlazingName(name))
            if !(1..=MAX_NAME).contains(&name.len()) || !name.bytes().all(is_allowed) =>
        {
            Err(LineError::GlazingName { found: name.clone(), most: MAX_NAME })
        }
        _ => Ok(()),
    }
}

/// Largest number of layers of a pane.
const MAX_LAYERS: usize = 16;

/// Checks that either layers, or thickness and index are given.
fn layers(glass: &Glass) -> Result<(), LineError> {
    let found = glass.layers.len();
    if found > MAX_LAYERS {
        return Err(LineError::Layers { found, most: MAX_LAYERS });
    }
    let plain = [
        ("thickness_m", glass.thickness_m.is_some()),
        ("ior", glass.ior.is_some()),
        ("absorption_per_m", glass.absorption_per_m.is_some()),
    ];
    if glass.layers.is_empty() {
        let missing = plain[..2].iter().find(|(_, is_given)| !is_given);
        return missing.map_or(Ok(()), |(key, _)| Err(LineError::NoMake { key }));
    }
    if let Some((key, _)) = plain.iter().find(|(_, is_given)| *is_given) {
        return Err(LineError::TwoMakes { key });
    }
    let has_glass = glass.layers.iter().any(|layer| matches!(layer, GlassLayer::Glass { .. }));
    if has_glass { Ok(()) } else { Err(LineError::NoGlass) }
}

fn bow(glass: &Glass) -> Result<(), LineError> {
    match glass.bow_radius_m {
        None => Ok(()),
        Some(radius_m) if radius_m == 0.0 || !radius_m.is_finite() => {
            Err(LineError::BowRadius { radius_m })
        }
        Some(_) if glass.layers.is_empty() && glass.coatings.is_empty() => Ok(()),
        Some(_) => Err(LineError::BowOfStack),
    }
}

fn wave(glass: &Glass) -> Result<(), LineError> {
    match glass.wave {
        None => Ok(()),
        Some(_) if glass.bow_radius_m.is_some() => Err(LineError::WaveAndBow),
        Some(wave) => wave.check(),
    }
}

fn roughness(glass: &Glass) -> Result<(), LineError> {
    let Some(roughness) = &glass.roughness else {
        return Ok(());
    };
    let (faces, found) = (glass.layers.len().max(1) + 1, roughness.values().len());
    match roughness.of_faces(faces) {
        Some(_) => Ok(()),
        None => Err(LineError::FacesOfRoughness { found, faces }),
    }
}

/// Largest number of cards of a side.
const MAX_CARDS: usize = 16;

fn cards(side: &str, cards: &[Card]) -> Result<(), LineError> {
    if cards.len() > MAX_CARDS {
        let (side, found) = (side.to_owned(), cards.len());
        return Err(LineError::Cards { side, found, most: MAX_CARDS });
    }
    Ok(())
}

/// Checks the paths and numbers of one side. Errors call the side `name`.
pub fn side(name: &str, side: &Side) -> Result<(), LineError> {
    check_section(side, name)?;
    for (key, path) in side.paths() {
        if path.is_empty() && key == "depth" {
            return Err(LineError::NoShape { side: name.to_owned() });
        }
        if path.is_empty() {
            return Err(LineError::EmptyPath { field: format!("{name}.{key}") });
        }
    }
    cards(name, side.cards())?;
    match side {
        Side::Photograph(side) => photograph(name, side),
        Side::Panorama(side) => panorama(name, side),
        Side::Mesh(side) => mesh(name, side),
    }
}

fn photograph(side: &str, photograph: &Photograph) -> Result<(), LineError> {
    shape(side, photograph)?;
    if let Some(highlights) = &photograph.highlights {
        highlights.validate(&format!("{side}.highlights"), photograph.transfer)?;
    }
    depth_range::check(side, photograph.depth_kind, photograph.depth_range.as_ref())
}

/// Checks that a photograph has a depth image or a sketch, and that nothing describes a depth image beside a sketch.
fn shape(side: &str, photograph: &Photograph) -> Result<(), LineError> {
    if photograph.sketch.is_none() {
        return Ok(());
    }
    let of_depth = [
        ("depth", !photograph.depth.is_empty()),
        ("mask", photograph.mask.is_some()),
        ("depth_unit_m", photograph.depth_unit_m != 1.0),
        ("depth_none_code", photograph.depth_none_code.is_some()),
        ("depth_kind", photograph.depth_kind != DepthKind::default()),
        ("depth_range", photograph.depth_range.is_some()),
    ];
    match of_depth.into_iter().find(|(_, is_given)| *is_given) {
        Some((key, _)) => Err(LineError::SketchAndDepth { side: side.to_owned(), key }),
        None => Ok(()),
    }
}

fn panorama(side: &str, panorama: &PanoramaFile) -> Result<(), LineError> {
    if let Some(highlights) = &panorama.highlights {
        highlights.validate(&format!("{side}.highlights"), panorama.transfer)?;
    }
    match panorama.distances() {
        PanoramaDepth::Constant { .. } => Ok(()),
        PanoramaDepth::Map(map) => {
            depth_range::check(side, map.depth_kind, map.depth_range.as_ref())
        }
    }
}

/// Largest allowed deviation of `rotation` times its transpose from the unit matrix. Elements with five digits suffice.
const MAX_DISTORTION: f64 = 1e-4;

fn mesh(side: &str, mesh: &MeshFile) -> Result<(), LineError> {
    let Some(pose) = &mesh.pose else {
        return Ok(());
    };
    if pose.distortion() > MAX_DISTORTION {
        return Err(LineError::NoRotation { field: format!("{side}.pose.rotation") });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::published::{photograph, published};
    use super::*;

    #[test]
    fn the_published_scene_is_valid() {
        published().validate().unwrap();
    }

    fn with_back(side: &str) -> Result<(), String> {
        let mut line = published();
        line.back = serde_json::from_str(side).unwrap();
        line.validate().map_err(|error| error.to_string())
    }

    #[test]
    fn fields_of_meshes_are_checked() {
        with_back(r#"{"mesh":"m","apex":"camera","pose":{"rotation":[[0,0,1],[0,1,0],[-1,0,0]]}}"#)
            .unwrap();
        // The elements are cos and sin of 45 degrees to five digits.
        with_back(r#"{"mesh":"m","pose":{"rotation":[[0.70711,0,0.70711],[0,1,0],[-0.70711,0,0.70711]]}}"#)
            .unwrap();
        for (mesh, message) in [
            (r#"{"mesh":""}"#, "back.mesh is empty"),
            (r#"{"mesh":"m","unit_m":0}"#, "back.unit_m is 0, but must be"),
            (r#"{"mesh":"m","exposure":-1}"#, "back.exposure is -1"),
            (
                r#"{"mesh":"m","pose":{"translation_m":[0,1e9,0]}}"#,
                "back.pose.translation_m[1] is 1000000000",
            ),
            (
                r#"{"mesh":"m","pose":{"rotation":[[1,0,0],[0,1,0],[0,0,-1]]}}"#,
                "back.pose.rotation is not a rotation",
            ),
            (
                r#"{"mesh":"m","pose":{"rotation":[[0.01,0,0],[0,0.01,0],[0,0,0.01]]}}"#,
                "back.pose.rotation is not a rotation",
            ),
        ] {
            let error = with_back(mesh).unwrap_err();
            assert!(error.starts_with(message), "{error} for {message}");
        }
        let mut line = published();
        line.front = serde_json::from_str(r#"{"mesh":"m","apex":"mirror"}"#).unwrap();
        assert_eq!(line.validate().unwrap_err(), LineError::ApexOfFront);
    }

    #[test]
    fn fields_of_panoramas_and_highlights_are_checked() {
        with_back(
            r#"{"panorama":"p","highlights":{"above":0.9,"to":8},"yaw_deg":-360,"pitch_deg":90}"#,
        )
        .unwrap();
        with_back(
            r#"{"panorama":"p","depth":"d","depth_kind":"relative","depth_range":{"mean_m":3}}"#,
        )
        .unwrap();
        for (side, message) in [
            (r#"{"panorama":""}"#, "back.panorama is empty"),
            (r#"{"panorama":"p","depth_m":0}"#, "back.depth_m is 0, but"),
            (r#"{"panorama":"p","yaw_deg":361}"#, "back.yaw_deg is 361"),
            (r#"{"panorama":"p","pitch_deg":-91}"#, "back.pitch_deg is -91"),
            (r#"{"panorama":"p","depth":"d","depth_unit_m":0}"#, "back.depth_unit_m is 0"),
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
                "back.highlights is given, but only transfer \"srgb\"",
            ),
        ] {
            let error = with_back(side).unwrap_err();
            assert!(error.starts_with(message), "{error} for {message}");
        }
        let mut line = published();
        photograph(&mut line.front).highlights =
            Some(super::super::highlights::Highlights { above: f64::NAN, to: 2.0 });
        let error = line.validate().unwrap_err().to_string();
        assert!(error.starts_with("front.highlights.above is NaN"), "{error}");
    }

    #[test]
    fn every_bad_field_is_named_with_its_value_and_range() {
        for (key, value) in [
            ("film.width", "0"),
            ("film.height", "16385"),
            ("film.spp", "0"),
            ("film.spp", "96"),
            ("film.spp", "131072"),
            ("film.order_tolerance", "-1"),
            ("film.target_error", "0"),
            ("camera.focal_length_mm", "0"),
            ("camera.aperture_radius_m", "-0.1"),
            ("camera.exposure", "-1"),
            ("camera.white_balance[1]", "-2"),
            ("camera.focus.distance_m", "0"),
            ("glass.thickness_m", "-0.01"),
            ("glass.ior", "0.99"),
            ("glass.ior", "11"),
            ("glass.absorption_per_m[2]", "-1"),
            ("glass.distance_m", "10000000000000000"),
            ("glass.thickness_m", "101"),
            ("glass.absorption_per_m[1]", "10000000000"),
            ("glass.tilt_deg[0]", "90"),
            ("glass.tilt_deg[1]", "-90"),
            ("front.depth_unit_m", "0"),
            ("front.intrinsics.fx", "0"),
            ("back.intrinsics.fy", "-1"),
            ("front.intrinsics.size[0]", "0"),
        ] {
            let error = with(key, value).unwrap_err();
            assert!(error.starts_with(&format!("{key} is {value}, but must be ")), "{error}");
        }
        for (key, value, message) in [
            ("front.apex", "\"mirror\"", "front.apex is given"),
            ("front.color", "\"\"", "front.color is empty"),
            ("back.mask", "\"\"", "back.mask is empty"),
        ] {
            let error = with(key, value).unwrap_err();
            assert!(error.starts_with(message), "{error} for {message}");
        }
    }

    /// Validates the published line with another value under `key`.
    fn with(key: &str, value: &str) -> Result<(), String> {
        let mut line = published();
        line.camera.white_balance = [1.0, 1.0, 0.5];
        line.film.target_error = Some(1.0);
        photograph(&mut line.front).intrinsics.size = Some([2, 3]);
        let mut json = serde_json::to_value(line).unwrap();
        let path = key.replace('[', ".").replace(']', "");
        let (parent, last) = path.rsplit_once('.').unwrap();
        let value: serde_json::Value = serde_json::from_str(value).unwrap();
        match json.pointer_mut(&format!("/{}", parent.replace('.', "/"))) {
            Some(serde_json::Value::Array(array)) => array[last.parse::<usize>().unwrap()] = value,
            Some(parent) => parent[last] = value,
            None => panic!("no {parent}"),
        }
        let line: SceneLine = serde_json::from_value(json).unwrap();
        line.validate().map_err(|error| error.to_string())
    }

    /// Lengths with which the tracer would leave the range of its numbers are refused by name; generous ones are not.
    #[test]
    fn absurd_lengths_are_refused_by_name() {
        let with_glass = |keys: &str| {
            let mut line = published();
            let glass = format!(r#"{{"distance_m":1.0,{keys}}}"#);
            line.glass = serde_json::from_str(&glass).unwrap();
            line.camera.exposure = 2.0;
            line.validate().map_err(|error| error.to_string())
        };
        let outline = r#""thickness_m":0.01,"ior":1.5,"outline":{"x_m":[-1,1e300],"y_m":[-1,1],"frame_m":1e300,"frame_radiance""#;
        let wave = r#""thickness_m":0.01,"ior":1.5,"wave""#;
        for (keys, message) in [
            (r#""layers":[{"glass_m":1e300,"ior":1.5}]"#, "glass.layers[0].glass_m is 1e300"),
            (
                r#""layers":[{"glass_m":0.1,"ior":1.5},{"gap_m":1000}]"#,
                "glass.layers[1].gap_m is 1000, but must be 0 to 100",
            ),
            (
                r#""layers":[{"glass_m":0.1,"ior":1.5,"absorption_per_m":[0,0,1e12]}]"#,
                "glass.layers[0].absorption_per_m[2] is 1000000000000, but must be 0 to 1e9",
            ),
            (
                &format!(r#"{wave}:{{"amplitude_m":1e300,"length_m":1e308}}"#),
                "glass.wave.amplitude_m is 1e300",
            ),
            (
                &format!(r#"{wave}:{{"amplitude_m":1,"length_m":1e308}}"#),
                "glass.wave.length_m is 1e308",
            ),
            (
                &format!(r#"{wave}:{{"amplitude_m":1e-20,"length_m":1e-15}}"#),
                "glass.wave.length_m is 0.000000000000001, but must be 1e-5 to 1e6 m",
            ),
            (
                &format!("{outline}:[0,1e10,0]}}"),
                "glass.outline.frame_radiance[1] is 10000000000, but must be 0 to 1e9",
            ),
        ] {
            let error = with_glass(keys).unwrap_err();
            assert!(error.starts_with(message), "{error} for {keys}");
        }
        let layers = vec![r#"{"glass_m":100,"ior":1.5}"#; 16].join(",");
        for keys in [
            &format!(r#""layers":[{layers}]"#),
            &format!(r#"{wave}:{{"amplitude_m":7e3,"length_m":1e6}}"#),
            &format!("{outline}:[0,1e9,0]}}"),
        ] {
            with_glass(keys).unwrap();
        }
        let mut line = published();
        line.glass =
            serde_json::from_str(&format!(r#"{{"distance_m":1.0,{outline}:[0,0,1e9]}}}}"#))
                .unwrap();
        line.camera.exposure = 1e30;
        let error = line.validate().unwrap_err().to_string();
        assert!(error.contains("frame_radiance[2] is 1000"), "{error}");
    }

    #[test]
    fn errors_name_values_that_are_not_finite_and_other_schemas() {
        type Spoil = fn(&mut SceneLine);
        let cases: [(Spoil, &str); 5] = [
            (|l| l.glass.distance_m = f64::INFINITY, "glass.distance_m is inf"),
            (|l| l.glass.ior = Some(f64::NAN), "glass.ior is NaN"),
            (|l| photograph(&mut l.back).exposure = f64::NAN, "back.exposure is NaN"),
            (|l| photograph(&mut l.back).intrinsics.cx = f64::NAN, "back.intrinsics.cx is NaN"),
            (|l| l.schema = "glasshouse.scene/2".into(), "schema is \"glasshouse.scene/2\""),
        ];
        for (spoil, message) in cases {
            let mut line = published();
            spoil(&mut line);
            let error = line.validate().unwrap_err().to_string();
            assert!(error.starts_with(message), "{error} for {message}");
        }
    }
}
