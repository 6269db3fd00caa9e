//! The pane of a scene line: one layer of glass, or several layers of glass and gaps, with coatings.

use super::coating::FaceCoating;
use super::image::is_default;
use super::outline::Outline;
use super::roughness::Roughness;
use super::smudges::Smudges;
use super::wave::Wave;
use serde::{Deserialize, Serialize};

/// The plane-parallel pane.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "GlassKeys", into = "GlassKeys")]
pub struct Glass {
    /// Distance of the front face from the lens along the optical axis.
    pub distance_m: f64,
    /// Thickness; 0 is allowed. With `layers`, their sum.
    pub thickness_m: f64,
    /// Index of refraction against air, at least 1. With `layers`, that of the first glass.
    pub ior: f64,
    /// Absorption coefficient of red, green and blue, per metre of path in the glass. With `layers`, that of the first glass.
    pub absorption_per_m: [f64; 3],
    /// `[pitch, yaw]`: rotation about +x, then +y, right-handed; pivot (0, 0, distance_m).
    pub tilt_deg: [f64; 2],
    /// Name of the glazing from which a recipe took the pane: for readers, not for the tracer.
    pub glazing: Option<String>,
    /// Layers from the camera outwards, in place of thickness, index and absorption; empty for a plain pane.
    pub layers: Vec<GlassLayer>,
    /// Coatings, at most one for each face.
    pub coatings: Vec<FaceCoating>,
    /// Radius of the sphere to which the pane is bent: positive if its centre is on the camera's side; flat without it.
    pub bow_radius_m: Option<f64>,
    /// Waves that all faces share; flat without them. Not with `bow_radius_m`.
    pub wave: Option<Wave>,
    /// Roughness of the faces, smooth without it.
    pub roughness: Option<Roughness>,
    /// Smudges on the front face, clean without them.
    pub smudges: Option<Smudges>,
    /// Edges of the pane; without them, the pane fills the picture.
    pub outline: Option<Outline>,
}

/// A layer of a pane.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(
    untagged,
    deny_unknown_fields,
    expecting = r#"a layer must be {"glass_m": h, "ior": n, "absorption_per_m": [r, g, b]} (the last is optional) or {"gap_m": h}, each with or without "wedge_deg": [pitch, yaw]"#
)]
pub enum GlassLayer {
    Glass {
        /// Thickness.
        glass_m: f64,
        /// Index of refraction against air, at least 1.
        ior: f64,
        /// Absorption coefficient of red, green and blue, per metre of path.
        #[serde(default)]
        absorption_per_m: [f64; 3],
        /// Pitch and yaw by which the layer turns all faces behind it against those before it.
        #[serde(default, skip_serializing_if = "is_default")]
        wedge_deg: [f64; 2],
    },
    /// Air, or another gas.
    Gap {
        /// Thickness.
        gap_m: f64,
        /// Pitch and yaw by which the layer turns all faces behind it against those before it.
        #[serde(default, skip_serializing_if = "is_default")]
        wedge_deg: [f64; 2],
    },
}

/// The keys of [`Glass`].
#[derive(Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct GlassKeys {
    distance_m: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    thickness_m: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    ior: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    absorption_per_m: Option<[f64; 3]>,
    #[serde(default)]
    tilt_deg: [f64; 2],
    #[serde(default, skip_serializing_if = "Option::is_none")]
    glazing: Option<String>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    layers: Vec<GlassLayer>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    coatings: Vec<FaceCoating>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    bow_radius_m: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    wave: Option<Wave>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    roughness: Option<Roughness>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    smudges: Option<Smudges>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    outline: Option<Outline>,
}

impl TryFrom<GlassKeys> for Glass {
    type Error = String;

    fn try_from(keys: GlassKeys) -> Result<Self, String> {
        let GlassKeys { distance_m, tilt_deg, layers, coatings, .. } = keys;
        let missing = |key: &str| format!("missing field `{key}` of glass, which has no `layers`");
        let (thickness_m, ior, absorption_per_m) = if layers.is_empty() {
            (
                keys.thickness_m.ok_or_else(|| missing("thickness_m"))?,
                keys.ior.ok_or_else(|| missing("ior"))?,
                keys.absorption_per_m.unwrap_or_default(),
            )
        } else {
            let plain = [
                ("thickness_m", keys.thickness_m.is_some()),
                ("ior", keys.ior.is_some()),
                ("absorption_per_m", keys.absorption_per_m.is_some()),
            ];
            if let Some((key, _)) = plain.into_iter().find(|(_, given)| *given) {
                return Err(format!("glass has `layers` and `{key}`: keep only one of them"));
            }
            of_stack(&layers).ok_or("glass.layers have no layer of glass")?
        };
        Ok(Self {
            distance_m,
            thickness_m,
            ior,
            absorption_per_m,
            tilt_deg,
            glazing: keys.glazing,
            layers,
            coatings,
            bow_radius_m: keys.bow_radius_m,
            wave: keys.wave,
            roughness: keys.roughness,
            smudges: keys.smudges,
            outline: keys.outline,
        })
    }
}

impl From<Glass> for GlassKeys {
    fn from(glass: Glass) -> Self {
        let is_plain = glass.layers.is_empty();
        Self {
            distance_m: glass.distance_m,
            thickness_m: is_plain.then_some(glass.thickness_m),
            ior: is_plain.then_some(glass.ior),
            absorption_per_m: is_plain.then_some(glass.absorption_per_m),
            tilt_deg: glass.tilt_deg,
            glazing: glass.glazing,
            layers: glass.layers,
            coatings: glass.coatings,
            bow_radius_m: glass.bow_radius_m,
            wave: glass.wave,
            roughness: glass.roughness,
            smudges: glass.smudges,
            outline: glass.outline,
        }
    }
}

/// Returns the thickness of layers together, and index and absorption of the first glass, if there is one.
fn of_stack(layers: &[GlassLayer]) -> Option<(f64, f64, [f64; 3])> {
    let thickness_m = layers.iter().map(GlassLayer::thickness_m).sum();
    layers.iter().find_map(|layer| match *layer {
        GlassLayer::Glass { ior, absorption_per_m, .. } => {
            Some((thickness_m, ior, absorption_per_m))
        }
        GlassLayer::Gap { .. } => None,
    })
}

impl Glass {
    /// Replaces the layers. One layer of glass without a wedge becomes a plain pane, without `layers`.
    ///
    /// # Panics
    ///
    /// If no layer is glass.
    pub fn set_layers(&mut self, layers: &[GlassLayer]) {
        let (thickness_m, ior, absorption_per_m) = of_stack(layers).expect("a pane has glass");
        (self.thickness_m, self.ior) = (thickness_m, ior);
        self.absorption_per_m = absorption_per_m;
        let is_plain = layers.len() == 1 && layers[0].wedge_deg() == [0.0; 2];
        self.layers = if is_plain { vec![] } else { layers.to_vec() };
    }
}

impl GlassLayer {
    /// Returns the thickness of the layer, m.
    pub fn thickness_m(&self) -> f64 {
        match *self {
            Self::Glass { glass_m, .. } => glass_m,
            Self::Gap { gap_m, .. } => gap_m,
        }
    }

    /// Returns pitch and yaw by which the layer turns all faces behind it.
    pub fn wedge_deg(&self) -> [f64; 2] {
        match *self {
            Self::Glass { wedge_deg, .. } | Self::Gap { wedge_deg, .. } => wedge_deg,
        }
    }

    /// Sets the wedge.
    pub fn set_wedge_deg(&mut self, wedge: [f64; 2]) {
        match self {
            Self::Glass { wedge_deg, .. } | Self::Gap { wedge_deg, .. } => *wedge_deg = wedge,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{SceneLine, published};

    fn with_glass(glass: &str) -> Result<SceneLine, String> {
        let mut line = published();
        line.glass = serde_json::from_str(glass).map_err(|error| error.to_string())?;
        line.validate().map_err(|error| error.to_string())?;
        Ok(line)
    }

    const DOUBLE: &str = r#"{"distance_m":0.4,"tilt_deg":[5.0,20.0],"layers":[{"glass_m":0.004,"ior":1.52,"absorption_per_m":[6.0,2.0,4.0]},{"gap_m":0.016},{"glass_m":0.006,"ior":1.5,"absorption_per_m":[0.0,0.0,0.0]}],"coatings":[{"face":1,"reflectance":[0.12,0.06,0.16],"transmittance":[0.8,0.86,0.78]}]}"#;

    #[test]
    fn layers_replace_thickness_index_and_absorption() {
        let line = with_glass(DOUBLE).unwrap();
        let glass = &line.glass;
        assert!((glass.thickness_m - 0.026).abs() < 1e-15);
        assert_eq!((glass.ior, glass.absorption_per_m), (1.52, [6.0, 2.0, 4.0]));
        assert_eq!(serde_json::to_string(glass).unwrap(), DOUBLE);
        // A plain pane keeps its text.
        let plain = serde_json::to_string(&published().glass).unwrap();
        assert!(plain.contains(r#""thickness_m":0.01,"ior":1.6,"absorption_per_m""#), "{plain}");
        assert!(!plain.contains("layers") && !plain.contains("coatings"), "{plain}");
    }

    #[test]
    fn a_single_layer_is_a_plain_pane() {
        let mut glass = with_glass(DOUBLE).unwrap().glass;
        let layers = glass.layers.clone();
        glass.coatings.clear();
        glass.set_layers(&layers[2..]);
        glass.glazing = Some("single-6".to_owned());
        let text = serde_json::to_string(&glass).unwrap();
        let wanted = r#"{"distance_m":0.4,"thickness_m":0.006,"ior":1.5,"absorption_per_m":[0.0,0.0,0.0],"tilt_deg":[5.0,20.0],"glazing":"single-6"}"#;
        assert_eq!(text, wanted);
        assert_eq!(with_glass(&text).unwrap().glass, glass);
        // The thickness of several layers is that of a line which is read.
        glass.set_layers(&layers);
        let text = serde_json::to_string(&glass).unwrap();
        assert_eq!(with_glass(&text).unwrap().glass, glass);
    }

    #[test]
    fn errors_say_what_to_change() {
        let coated = |coating: &str| {
            format!(r#"{{"distance_m":1,"thickness_m":0.01,"ior":1.5,"coatings":[{coating}]}}"#)
        };
        let framed = |outline: &str| {
            format!(r#"{{"distance_m":1,"thickness_m":0.01,"ior":1.5,"outline":{{{outline}}}}}"#)
        };
        let rough = |roughness: &str| {
            format!(r#"{{"distance_m":1,"thickness_m":0.01,"ior":1.5,"roughness":{roughness}}}"#)
        };
        let waved = |wave: &str| {
            format!(r#"{{"distance_m":1,"thickness_m":0.01,"ior":1.5,"wave":{wave}}}"#)
        };
        let named = |name: &str| {
            format!(r#"{{"distance_m":1,"thickness_m":0.01,"ior":1.5,"glazing":"{name}"}}"#)
        };
        let layers = |layers: &str| format!(r#"{{"distance_m":1,"layers":[{layers}]}}"#);
        let even = r#""reflectance":[0.5,0.5,0.5],"transmittance":[0.5,0.5,0.5]"#;
        for (glass, message) in [
            (r#"{"distance_m":1,"ior":1.5}"#.to_owned(), "missing field `thickness_m`"),
            (r#"{"distance_m":1,"thickness_m":0.01}"#.to_owned(), "missing field `ior`"),
            (
                r#"{"distance_m":1,"ior":1.5,"layers":[{"gap_m":0.01}]}"#.to_owned(),
                "glass has `layers` and `ior`: keep only one",
            ),
            (layers(r#"{"gap_m":0.01}"#), "glass.layers have no layer of glass"),
            (layers(r#"{"glas_m":0.01}"#), r#"a layer must be {"glass_m": h"#),
            (layers(r#"{"glass_m":-0.01,"ior":1.5}"#), "glass.layers[0].glass_m is -0.01"),
            (layers(r#"{"glass_m":0.01,"ior":0.9}"#), "glass.layers[0].ior is 0.9"),
            (
                layers(r#"{"glass_m":0.01,"ior":1.5},{"gap_m":-1}"#),
                "glass.layers[1].gap_m is -1, but must be",
            ),
            (
                layers(r#"{"glass_m":0.01,"ior":1.5},{"gap_m":0.01,"wedge_deg":[0,6]}"#),
                "glass.layers[1].wedge_deg[1] is 6, but must be -5 to 5 degrees",
            ),
            (
                layers(&vec![r#"{"glass_m":0.001,"ior":1.5}"#; 17].join(",")),
                "glass.layers has 17 layers, but at most 16",
            ),
            (coated(&format!(r#"{{"face":2,{even}}}"#)), "the pane has the faces 0 to 1"),
            (
                coated(&format!(r#"{{"face":1,{even}}},{{"face":1,{even}}}"#)),
                "glass.coatings[1].face is 1, like that of an earlier coating",
            ),
            (
                coated(r#"{"face":0,"reflectance":[0,0,0.6],"transmittance":[0,0,0.5]}"#),
                "glass.coatings[0].reflectance[2] plus the transmittance is 1.1",
            ),
            (
                coated(r#"{"face":0,"reflectance":[0,2,0],"transmittance":[0,0,0]}"#),
                "glass.coatings[0].reflectance[1] is 2, but must be 0 to 1",
            ),
            (
                r#"{"distance_m":1,"thickness_m":0.01,"ior":1.5,"bow_radius_m":0}"#.to_owned(),
                "glass.bow_radius_m is 0, but must be finite and not 0: leave it out for a flat pane",
            ),
            (
                layers(r#"{"glass_m":0.01,"ior":1.5}"#).replace("}]}", r#"}],"bow_radius_m":8}"#),
                "glass.bow_radius_m bends a plain pane only: remove glass.layers and glass.coatings",
            ),
            (
                waved(r#"{"amplitude_m":0.001,"length_m":0.1}"#),
                "glass.wave has slopes of up to 0.063, but at most 0.05 are allowed: reduce amplitude_m",
            ),
            (
                waved(r#"{"amplitude_m":-1,"length_m":0.1}"#),
                "glass.wave.amplitude_m is -1, but must be",
            ),
            (waved(r#"{"amplitude_m":0,"length_m":0}"#), "glass.wave.length_m is 0, but must be"),
            (waved(r#"{"amplitude_m":0.001}"#), "missing field `length_m`"),
            (
                waved(r#"{"amplitude_m":0.0001,"length_m":0.1},"bow_radius_m":8"#),
                "glass.wave and glass.bow_radius_m are both given: keep one",
            ),
            (named(""), "glass.glazing is \"\", but must be 1 to 64 characters of [a-z0-9.-]"),
            (named("Double"), "glass.glazing is \"Double\", but must be 1 to 64 characters"),
            (named(&"a".repeat(65)), "but must be 1 to 64 characters of [a-z0-9.-]"),
            (rough("0.2"), "glass.roughness is 0.2, but must be 0 to 0.1"),
            (rough("[0.01]"), "glass.roughness lists 1 value, but the pane has 2 faces"),
            (rough("[0.01,-1]"), "glass.roughness[1] is -1, but must be 0 to 0.1"),
            (rough(r#""matt""#), "glass.roughness must be a number, or a list"),
            (framed(r#""x_m":[0.1,0.1],"y_m":[0,1]"#), "glass.outline.x_m is [0.1, 0.1], but its"),
            (framed(r#""x_m":[0,1],"y_m":[2,1]"#), "glass.outline.y_m is [2, 1], but its first"),
            (framed(r#""x_m":[0,1]"#), "missing field `y_m`"),
            (
                framed(r#""x_m":[0,1],"y_m":[0,1],"frame_m":-1"#),
                "glass.outline.frame_m is -1, but must be finite and at least 0",
            ),
            (
                framed(r#""x_m":[0,1],"y_m":[0,1],"frame_radiance":[0,-2,0]"#),
                "glass.outline.frame_radiance[1] is -2",
            ),
        ] {
            let error = with_glass(&glass).unwrap_err();
            assert!(error.contains(message), "{error} for {glass}");
        }
    }
}
