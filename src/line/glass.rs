//! The pane of a scene line: one layer of glass, or several layers of glass and gaps, with coatings.

use super::coating::FaceCoating;
use super::glazing::GlazingName;
use super::outline::Outline;
use super::roughness::Roughness;
use super::smudges::Smudges;
use super::wave::Wave;
use glasshouse_keys::keys;
use serde::{Deserialize, Deserializer};

/// The pane: position, make and edges.
#[keys(recipe = GlassRecipe)]
pub struct Glass {
    /// Distance of the front face from the lens along the optical axis.
    // Single precision holds the squares of these distances, and products of the squares with sizes.
    #[key("(0, 1e15] m", recipe = 0.30, decides)]
    pub distance_m: f64,
    /// Thickness of a pane without `layers` or `glazing`. In recipes 0.010 if missing.
    // Lengths of paths of 64 layers fit into whole femtometres of 64 bits.
    #[key("[0, 100] m")]
    pub thickness_m: Option<f64>,
    /// Index of refraction against air of a pane without `layers` or `glazing`. In recipes 1.6 if missing.
    #[key("[1, 10]")]
    pub ior: Option<f64>,
    /// Absorption coefficients of red, green and blue, per metre of path in a pane without `layers` or `glazing`; 0 if missing.
    // Light falls to 1/e in 1 nm at most; more would show the rounding of lengths.
    #[key("[0, 1e9] per m")]
    pub absorption_per_m: Option<[f64; 3]>,
    /// Pitch and yaw: rotation about +x, then about +y, right-handed, around the point of the front face on the axis; 0 is
    /// perpendicular to the axis.
    #[key("(-90, 90) degrees", default = [0.0; 2], written, decides)]
    pub tilt_deg: [f64; 2],
    /// Name of a glazing (docs/glass.md), or a choice of names, in place of thickness, index and absorption. In lines 1 to 64 characters
    /// of `[a-z0-9.-]` for readers alone: it changes no pixel.
    pub glazing: Option<GlazingName>,
    /// Layers from the camera outwards, in place of thickness, index and absorption.
    #[key(line_only)]
    pub layers: Vec<GlassLayer>,
    /// Coatings, at most one for each face.
    #[key(line_only)]
    pub coatings: Vec<FaceCoating>,
    /// Radius of the sphere to which a single uncoated pane is bent: positive if its centre is on the camera's side; not 0. Flat if
    /// missing.
    #[key("(-inf, inf) m", decides)]
    pub bow_radius_m: Option<f64>,
    /// Waves of all faces, such as those of tempered glass. Not with `bow_radius_m`.
    pub wave: Option<Wave>,
    /// Roughness of all faces, Beckmann's alpha; in lines, also a list with one value for each face. Smooth, or that of the glazing, if
    /// missing.
    #[key("[0, 0.1]", decides)]
    pub roughness: Option<Roughness>,
    /// Smudges on the front face.
    pub smudges: Option<Smudges>,
    /// Edges of the pane and its frame; without them, the pane fills the picture.
    pub outline: Option<Outline>,
    /// Pitch and yaw of all faces behind the first gap, or behind the glass of a pane without gaps, against those before it. Not with
    /// `bow_radius_m`.
    #[key("[-5, 5] degrees", recipe_only, decides)]
    pub wedge_deg: Option<[f64; 2]>,
}

/// A layer of a pane.
#[keys]
#[derive(Copy)]
#[serde(
    untagged,
    expecting = r#"a layer must be {"glass_m": h, "ior": n, "absorption_per_m": [r, g, b]} (the last is optional) or {"gap_m": h}, each with or without "wedge_deg": [pitch, yaw]"#
)]
pub enum GlassLayer {
    Glass {
        /// Thickness of a layer of glass.
        #[key("[0, 100] m")]
        glass_m: f64,
        /// Index of refraction against air.
        #[key("[1, 10]")]
        ior: f64,
        /// Absorption coefficients of red, green and blue, per metre of path.
        #[key("[0, 1e9] per m", default = [0.0; 3], written)]
        absorption_per_m: [f64; 3],
        /// Pitch and yaw by which the layer turns all faces behind it against those before it.
        #[key("[-5, 5] degrees", default = [0.0; 2])]
        wedge_deg: [f64; 2],
    },
    /// Air, or another gas.
    Gap {
        /// Thickness of a gap.
        #[key("[0, 100] m")]
        gap_m: f64,
        /// Pitch and yaw by which the gap turns all faces behind it against those before it.
        #[key("[-5, 5] degrees", default = [0.0; 2])]
        wedge_deg: [f64; 2],
    },
}

impl Glass {
    /// Reads a pane, and writes out the absorption that a plain one leaves out, so that a line shows it.
    pub(super) fn resolved<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let mut glass = Self::deserialize(deserializer)?;
        if glass.layers.is_empty() {
            glass.absorption_per_m.get_or_insert([0.0; 3]);
        }
        Ok(glass)
    }

    /// Returns the layers from the camera outwards; that of a pane without `layers` is its glass. Missing numbers of an invalid line are
    /// NaN.
    pub fn stack(&self) -> Vec<GlassLayer> {
        if !self.layers.is_empty() {
            return self.layers.clone();
        }
        vec![GlassLayer::Glass {
            glass_m: self.thickness_m.unwrap_or(f64::NAN),
            ior: self.ior.unwrap_or(f64::NAN),
            absorption_per_m: self.absorption_per_m.unwrap_or_default(),
            wedge_deg: [0.0; 2],
        }]
    }

    /// Replaces the layers. One layer of glass without a wedge becomes a plain pane, without `layers`.
    pub fn set_stack(&mut self, layers: &[GlassLayer]) {
        let plain = match layers {
            &[GlassLayer::Glass { glass_m, ior, absorption_per_m, wedge_deg: [0.0, 0.0] }] => {
                Some((glass_m, ior, absorption_per_m))
            }
            _ => None,
        };
        self.thickness_m = plain.map(|(glass_m, ..)| glass_m);
        self.ior = plain.map(|(_, ior, _)| ior);
        self.absorption_per_m = plain.map(|(.., absorption_per_m)| absorption_per_m);
        self.layers = if plain.is_some() { vec![] } else { layers.to_vec() };
    }

    /// Returns the thickness of all layers together, m.
    pub fn total_thickness_m(&self) -> f64 {
        self.stack().iter().map(GlassLayer::thickness_m).sum()
    }

    /// Returns index and absorption of the first glass; NaN and 0 for an invalid line.
    pub fn first_glass(&self) -> (f64, [f64; 3]) {
        let glass = |layer| match layer {
            GlassLayer::Glass { ior, absorption_per_m, .. } => Some((ior, absorption_per_m)),
            GlassLayer::Gap { .. } => None,
        };
        self.stack().into_iter().find_map(glass).unwrap_or((f64::NAN, [0.0; 3]))
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
    use super::super::{GlazingName, SceneLine, published};

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
        assert!((glass.total_thickness_m() - 0.026).abs() < 1e-15);
        assert_eq!(glass.first_glass(), (1.52, [6.0, 2.0, 4.0]));
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
        glass.set_stack(&layers[2..]);
        glass.glazing = Some(GlazingName("single-6".to_owned()));
        let text = serde_json::to_string(&glass).unwrap();
        let wanted = r#"{"distance_m":0.4,"thickness_m":0.006,"ior":1.5,"absorption_per_m":[0.0,0.0,0.0],"tilt_deg":[5.0,20.0],"glazing":"single-6"}"#;
        assert_eq!(text, wanted);
        assert_eq!(with_glass(&text).unwrap().glass, glass);
        // The thickness of several layers is that of a line which is read.
        glass.set_stack(&layers);
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
