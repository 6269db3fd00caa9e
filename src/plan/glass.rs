//! `[glass]` of a recipe: position, make and edges of the pane.

use super::choice::Choice;
use super::draw::Draw;
use super::glazing::{GlazingRecipe, named};
use super::param::Param;
use glasshouse_line::{Glass, GlassLayer, Outline, Roughness, SmudgePattern, Smudges, Wave};
use schemars::JsonSchema;
use serde::Deserialize;

/// `[glass]`: position, make and edges of the pane.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct GlassRecipe {
    /// Distance of the front face from the lens along the axis, m. Default 0.30.
    pub distance_m: Param,
    /// Thickness, m. Default 0.010.
    pub thickness_m: Param,
    /// Index of refraction. Default 1.6.
    pub ior: Param,
    /// Absorption coefficients of red, green and blue, per metre of path. Default 0.
    pub absorption_per_m: [Param; 3],
    /// Pitch and yaw, degrees. Default 0: perpendicular to the axis.
    pub tilt_deg: [Param; 2],
    /// Name of a glazing (docs/glass.md) or a choice of names, in place of thickness, index and absorption. Default none.
    pub glazing: Option<GlazingRecipe>,
    /// Roughness of all faces, Beckmann's alpha. Default that of the glazing, or smooth.
    pub roughness: Option<Param>,
    /// Radius of the sphere to which a single uncoated pane is bent, m: positive if its centre is on the camera's side.
    /// Default none: flat.
    pub bow_radius_m: Option<Param>,
    /// Waves of all faces, such as those of tempered glass. Default none: flat. Not with `bow_radius_m`.
    pub wave: Option<WaveRecipe>,
    /// Pitch and yaw of all faces behind the first gap, or behind the glass of a pane without gaps, against those before it,
    /// degrees. Default 0: parallel. Not with `bow_radius_m`.
    pub wedge_deg: Option<[Param; 2]>,
    /// Smudges on the front face. Default none: clean.
    pub smudges: Option<SmudgeRecipe>,
    /// Edges of the pane and its frame. Default none: the pane fills the picture.
    pub outline: Option<OutlineRecipe>,
}

impl Default for GlassRecipe {
    fn default() -> Self {
        Self {
            distance_m: Param::Constant(0.30),
            thickness_m: Param::Constant(0.010),
            ior: Param::Constant(1.6),
            absorption_per_m: [const { Param::Constant(0.0) }; 3],
            tilt_deg: [const { Param::Constant(0.0) }; 2],
            glazing: None,
            roughness: None,
            bow_radius_m: None,
            wave: None,
            wedge_deg: None,
            smudges: None,
            outline: None,
        }
    }
}

/// `[glass.wave]`: heights A sin(2 pi s / length) of all faces over the flat pane.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WaveRecipe {
    /// Height A of the crests, m; 0 is flat.
    pub amplitude_m: Param,
    /// Distance from crest to crest, m.
    pub length_m: Param,
    /// Direction across the crests, from right to down. Default 0.
    #[serde(default = "zero")]
    pub direction_deg: Param,
}

/// `[glass.smudges]`: marks of random places and forms on the front face.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SmudgeRecipe {
    /// Share of the pane with marks; 0 is clean.
    pub coverage: Param,
    /// Width of the largest marks, m. Default 0.05.
    #[serde(default = "width_of_marks")]
    pub mark_m: Param,
    /// Roughness of the front face under the marks, Beckmann's alpha. Default 0.05.
    #[serde(default = "roughness_of_marks")]
    pub roughness: Param,
    /// Share of the light that meets the smear inside the marks. Default 0.5.
    #[serde(default = "haze_of_marks")]
    pub haze: Param,
    /// Share of this light that passes the smear. Default 0.95.
    #[serde(default = "transmittance_of_marks")]
    pub transmittance: Param,
}

/// `[glass.outline]`: edges of a pane that ends inside the picture, and its frame.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct OutlineRecipe {
    /// Left and right edge of the glass, m, in the plane of its front face; 0 lies on the axis.
    pub x_m: [Param; 2],
    /// Upper and lower edge of the glass, m.
    pub y_m: [Param; 2],
    /// Width of the frame around the glass, m. Default 0: no frame.
    #[serde(default = "zero")]
    pub frame_m: Param,
    /// Linear radiance of the frame: red, green, blue. Default 0.
    #[serde(default = "black")]
    pub frame_radiance: [Param; 3],
}

fn zero() -> Param {
    Param::Constant(0.0)
}

fn width_of_marks() -> Param {
    Param::Constant(0.05)
}

fn roughness_of_marks() -> Param {
    Param::Constant(0.05)
}

fn haze_of_marks() -> Param {
    Param::Constant(0.5)
}

fn transmittance_of_marks() -> Param {
    Param::Constant(0.95)
}

fn black() -> [Param; 3] {
    [const { Param::Constant(0.0) }; 3]
}

impl GlassRecipe {
    /// Returns all numbers that scenes draw, with their keys. A glazing takes the place of the first three kinds.
    pub(super) fn params(&self) -> Vec<(String, &Param)> {
        let mut params = vec![
            ("glass.distance_m".to_owned(), &self.distance_m),
            ("glass.thickness_m".to_owned(), &self.thickness_m),
            ("glass.ior".to_owned(), &self.ior),
        ];
        params.extend(indexed("glass.absorption_per_m", &self.absorption_per_m));
        params.extend(indexed("glass.tilt_deg", &self.tilt_deg));
        let optional =
            [("glass.roughness", &self.roughness), ("glass.bow_radius_m", &self.bow_radius_m)];
        for (key, param) in optional {
            params.extend(param.iter().map(|param| (key.to_owned(), param)));
        }
        if let Some(wave) = &self.wave {
            params.push(("glass.wave.amplitude_m".to_owned(), &wave.amplitude_m));
            params.push(("glass.wave.length_m".to_owned(), &wave.length_m));
            params.push(("glass.wave.direction_deg".to_owned(), &wave.direction_deg));
        }
        if let Some(wedge) = &self.wedge_deg {
            params.extend(indexed("glass.wedge_deg", wedge));
        }
        if let Some(smudges) = &self.smudges {
            let numbers = smudges.params();
            params.extend(numbers.map(|(key, param)| (format!("glass.smudges.{key}"), param)));
        }
        if let Some(outline) = &self.outline {
            params.extend(indexed("glass.outline.x_m", &outline.x_m));
            params.extend(indexed("glass.outline.y_m", &outline.y_m));
            params.push(("glass.outline.frame_m".to_owned(), &outline.frame_m));
            params.extend(indexed("glass.outline.frame_radiance", &outline.frame_radiance));
        }
        params
    }

    /// Draws the pane of a line.
    pub(super) fn draw(&self, draw: Draw<'_>) -> Glass {
        let mut glass = Glass {
            distance_m: draw.value("glass.distance_m", &self.distance_m),
            thickness_m: draw.value("glass.thickness_m", &self.thickness_m),
            ior: draw.value("glass.ior", &self.ior),
            absorption_per_m: each(draw, "glass.absorption_per_m", &self.absorption_per_m),
            tilt_deg: each(draw, "glass.tilt_deg", &self.tilt_deg),
            glazing: None,
            layers: vec![],
            coatings: vec![],
            bow_radius_m: None,
            wave: self.wave.as_ref().and_then(|wave| wave.draw(draw)),
            roughness: None,
            smudges: self.smudges.as_ref().and_then(|smudges| smudges.draw(draw)),
            outline: self.outline.as_ref().map(|outline| outline.draw(draw)),
        };
        if let Some(GlazingRecipe(names)) = &self.glazing {
            let name = draw.pick("glass.glazing", names);
            let glazing = named(name).expect("the recipe's names were checked");
            glass.glazing = Some(name.clone());
            glass.set_layers(&glazing.layers);
            glass.coatings.clone_from(&glazing.coatings);
            glass.roughness.clone_from(&glazing.roughness);
        }
        if let Some(wedge) = &self.wedge_deg {
            set_wedge(&mut glass, each(draw, "glass.wedge_deg", wedge));
        }
        if let Some(param) = &self.roughness {
            let alpha = draw.value("glass.roughness", param);
            glass.roughness = (alpha > 0.0).then_some(Roughness::All(alpha));
        }
        if let Some(param) = &self.bow_radius_m {
            glass.bow_radius_m = Some(draw.value("glass.bow_radius_m", param));
        }
        glass
    }

    /// Returns the names of the glazings that scenes may have.
    pub(super) fn glazings(&self) -> Option<&Choice<String>> {
        self.glazing.as_ref().map(|GlazingRecipe(names)| names)
    }
}

/// Turns the faces behind the first gap of a pane, or behind its glass.
fn set_wedge(glass: &mut Glass, wedge_deg: [f64; 2]) {
    let mut layers = glass.layers.clone();
    if layers.is_empty() {
        layers.push(GlassLayer::Glass {
            glass_m: glass.thickness_m,
            ior: glass.ior,
            absorption_per_m: glass.absorption_per_m,
            wedge_deg,
        });
    }
    let gap = layers.iter().position(|layer| matches!(layer, GlassLayer::Gap { .. }));
    let last = layers.len() - 1;
    layers[gap.unwrap_or(last)].set_wedge_deg(wedge_deg);
    glass.set_layers(&layers);
}

impl WaveRecipe {
    /// Draws the waves of a line; `None` for a height of 0.
    fn draw(&self, draw: Draw<'_>) -> Option<Wave> {
        let amplitude_m = draw.value("glass.wave.amplitude_m", &self.amplitude_m);
        (amplitude_m > 0.0).then(|| Wave {
            amplitude_m,
            length_m: draw.value("glass.wave.length_m", &self.length_m),
            direction_deg: draw.value("glass.wave.direction_deg", &self.direction_deg),
        })
    }
}

impl SmudgeRecipe {
    fn params(&self) -> [(&'static str, &Param); 5] {
        [
            ("coverage", &self.coverage),
            ("mark_m", &self.mark_m),
            ("roughness", &self.roughness),
            ("haze", &self.haze),
            ("transmittance", &self.transmittance),
        ]
    }

    /// Draws the smudges of a line; `None` for a coverage of 0.
    fn draw(&self, draw: Draw<'_>) -> Option<Smudges> {
        let [coverage, mark_m, roughness, haze, transmittance] =
            self.params().map(|(key, param)| draw.value(&format!("glass.smudges.{key}"), param));
        // 32 bits stay exact in readers that hold numbers as f64.
        let seed = (draw.unit("glass.smudges.seed") * f64::from(u32::MAX)) as u64;
        (coverage > 0.0).then_some(Smudges {
            pattern: SmudgePattern::Marks { seed, coverage, mark_m },
            roughness,
            haze,
            transmittance,
        })
    }
}

impl OutlineRecipe {
    fn draw(&self, draw: Draw<'_>) -> Outline {
        Outline {
            x_m: each(draw, "glass.outline.x_m", &self.x_m),
            y_m: each(draw, "glass.outline.y_m", &self.y_m),
            frame_m: draw.value("glass.outline.frame_m", &self.frame_m),
            frame_radiance: each(draw, "glass.outline.frame_radiance", &self.frame_radiance),
        }
    }
}

/// Returns the numbers of an array with their keys.
fn indexed<'a>(key: &str, params: &'a [Param]) -> impl Iterator<Item = (String, &'a Param)> {
    params.iter().enumerate().map(move |(index, param)| (format!("{key}[{index}]"), param))
}

/// Draws the numbers of an array.
fn each<const N: usize>(draw: Draw<'_>, key: &str, params: &[Param; N]) -> [f64; N] {
    std::array::from_fn(|index| draw.value(&format!("{key}[{index}]"), &params[index]))
}
