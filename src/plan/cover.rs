//! `[cover]` of a recipe: what stands in the way of the window, and how often.

use glasshouse_line::param::Param;
use procedural::CoverKind;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::Deserialize;
use serde::de::{self, Deserializer, MapAccess, Visitor};
use std::fmt;
use std::marker::PhantomData;

/// `[cover]`: what stands in the way of the window. Each kind is the share of the scenes that have it, or a table with the
/// share and other sizes and places. Kinds are drawn independently of each other.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct CoverRecipe {
    /// Number of different pictures of each kind in each split, 1 to 10000. Default 16.
    pub pictures: u32,
    /// The person with the camera, mirrored in the window.
    #[serde(deserialize_with = "share_or_table")]
    #[schemars(schema_with = "share_or::<PhotographerRecipe>")]
    pub photographer: Option<PhotographerRecipe>,
    /// A blind behind the window.
    #[serde(deserialize_with = "share_or_table")]
    #[schemars(schema_with = "share_or::<ScreenRecipe>")]
    pub blind: Option<ScreenRecipe>,
    /// A curtain behind the window.
    #[serde(deserialize_with = "share_or_table")]
    #[schemars(schema_with = "share_or::<ScreenRecipe>")]
    pub curtain: Option<ScreenRecipe>,
    /// A plant in a pot behind the window.
    #[serde(deserialize_with = "share_or_table")]
    #[schemars(schema_with = "share_or::<ScreenRecipe>")]
    pub plant: Option<ScreenRecipe>,
    /// The frame of the window, which then ends inside the picture.
    #[serde(deserialize_with = "share_or_table")]
    #[schemars(schema_with = "share_or::<FrameRecipe>")]
    pub frame: Option<FrameRecipe>,
}

impl Default for CoverRecipe {
    fn default() -> Self {
        let (photographer, frame) = (None, None);
        Self { pictures: 16, photographer, blind: None, curtain: None, plant: None, frame }
    }
}

/// `[cover.photographer]`: a card parallel to the film that looks like a person with a camera.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct PhotographerRecipe {
    /// Share of the scenes.
    pub share: f64,
    /// Distance of the card behind the lens, m. Default uniform 0.05 to 0.4.
    pub distance_m: Param,
    /// Width of the card, m; the shoulders take less than half of it. Default uniform 0.9 to 1.15.
    pub width_m: Param,
    /// Position of the person's camera relative to the lens: right, down, m. Default uniform -0.08 to 0.08 and -0.05 to 0.05.
    pub offset_m: [Param; 2],
    /// Factor on the light of the card besides that of `[back]`. Default log-uniform 0.3 to 1.5.
    pub exposure: Param,
}

impl Default for PhotographerRecipe {
    fn default() -> Self {
        Self {
            share: 0.0,
            distance_m: Param::Uniform([0.05, 0.4]),
            width_m: Param::Uniform([0.9, 1.15]),
            offset_m: [Param::Uniform([-0.08, 0.08]), Param::Uniform([-0.05, 0.05])],
            exposure: Param::LogUniform([0.3, 1.5]),
        }
    }
}

/// `[cover.blind]`, `[cover.curtain]`, `[cover.plant]`: a card parallel to the film behind the pane. Its size and place are
/// relative to the view at its distance, so that they suit every lens. The defaults depend on the kind.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ScreenRecipe {
    /// Share of the scenes.
    pub share: f64,
    /// Least distance between the pane's last face and the card, m. Default uniform 0.03 to 0.3.
    pub gap_m: Option<Param>,
    /// Width of the card divided by that of the view. Default uniform: 1.1 to 1.6 (blind), 0.9 to 1.4 (curtain), 0.6 to 1.1
    /// (plant).
    pub view_width: Option<Param>,
    /// Horizontal position of the card's centre: the view reaches from -1 to 1. Default uniform: -0.2 to 0.2 (blind), -0.9 to
    /// 0.9 (curtain, plant).
    pub view_x: Option<Param>,
    /// Vertical position of the card's centre: the view reaches from -1, its upper border, to 1. Default uniform: -0.9 to 0
    /// (blind), -0.1 to 0.1 (curtain), 0.6 to 1 (plant).
    pub view_y: Option<Param>,
    /// Factor on the light of the card besides that of `[front]`. Default log-uniform 0.3 to 1.2.
    pub exposure: Option<Param>,
}

/// `[cover.frame]`: edges of the glass and an opaque frame around it, in the plane of the pane's front face.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct FrameRecipe {
    /// Share of the scenes.
    pub share: f64,
    /// Left and right edge of the glass: the view reaches from -1 to 1. Default uniform -1.8 to -0.2 and 0.2 to 1.8.
    pub view_x: [Param; 2],
    /// Upper and lower edge of the glass. Default uniform -2.4 to -0.4 and 0.4 to 2.4.
    pub view_y: [Param; 2],
    /// Width of the frame, m. Default uniform 0.03 to 0.1.
    pub frame_m: Param,
    /// Linear radiance of the frame, grey. Default log-uniform 0.02 to 0.6.
    pub frame_radiance: Param,
}

impl Default for FrameRecipe {
    fn default() -> Self {
        let edges = |least: f64, most: f64| {
            [Param::Uniform([-most, -least]), Param::Uniform([least, most])]
        };
        Self {
            share: 0.0,
            view_x: edges(0.2, 1.8),
            view_y: edges(0.4, 2.4),
            frame_m: Param::Uniform([0.03, 0.1]),
            frame_radiance: Param::LogUniform([0.02, 0.6]),
        }
    }
}

/// Returns the default of a card's number by its key, for the kinds that are placed in the view.
pub(super) fn screen_default(kind: CoverKind, key: &str) -> Param {
    use CoverKind::{Blind, Curtain, Photographer, Plant};
    match (key, kind) {
        ("gap_m", _) => Param::Uniform([0.03, 0.3]),
        ("view_width", Blind) => Param::Uniform([1.1, 1.6]),
        ("view_width", Curtain) => Param::Uniform([0.9, 1.4]),
        ("view_width", Plant) => Param::Uniform([0.6, 1.1]),
        ("view_x", Blind) => Param::Uniform([-0.2, 0.2]),
        ("view_x", Curtain | Plant) => Param::Uniform([-0.9, 0.9]),
        ("view_y", Blind) => Param::Uniform([-0.9, 0.0]),
        ("view_y", Curtain) => Param::Uniform([-0.1, 0.1]),
        ("view_y", Plant) => Param::Uniform([0.6, 1.0]),
        ("exposure", _) => Param::LogUniform([0.3, 1.2]),
        (_, Photographer | Blind | Curtain | Plant) => unreachable!("{kind:?} has no {key}"),
    }
}

impl ScreenRecipe {
    /// Returns the numbers that the recipe gives, with their keys.
    fn given(&self) -> impl Iterator<Item = (&'static str, &Param)> {
        let all = [
            ("gap_m", &self.gap_m),
            ("view_width", &self.view_width),
            ("view_x", &self.view_x),
            ("view_y", &self.view_y),
            ("exposure", &self.exposure),
        ];
        all.into_iter().filter_map(|(key, param)| Some((key, param.as_ref()?)))
    }

    /// Returns the number with this key, or its default.
    pub(super) fn param(&self, kind: CoverKind, key: &str) -> Param {
        let given = self.given().find(|(name, _)| *name == key);
        given.map_or_else(|| screen_default(kind, key), |(_, param)| param.clone())
    }
}

impl CoverRecipe {
    /// Returns the kinds that are cards in the view, with their recipes.
    pub(super) fn screens(&self) -> impl Iterator<Item = (CoverKind, &ScreenRecipe)> {
        let all = [
            (CoverKind::Blind, &self.blind),
            (CoverKind::Curtain, &self.curtain),
            (CoverKind::Plant, &self.plant),
        ];
        all.into_iter().filter_map(|(kind, recipe)| Some((kind, recipe.as_ref()?)))
    }

    /// Returns the kinds whose pictures scenes may show.
    pub(super) fn kinds(&self) -> Vec<CoverKind> {
        let person = self.photographer.iter().map(|_| CoverKind::Photographer);
        person.chain(self.screens().map(|(kind, _)| kind)).collect()
    }

    /// Returns all numbers that scenes draw, with their keys.
    pub(super) fn params(&self) -> Vec<(String, &Param)> {
        let mut params = Vec::new();
        if let Some(person) = &self.photographer {
            let [x, y] = &person.offset_m;
            params.extend([
                ("cover.photographer.distance_m".to_owned(), &person.distance_m),
                ("cover.photographer.width_m".to_owned(), &person.width_m),
                ("cover.photographer.offset_m[0]".to_owned(), x),
                ("cover.photographer.offset_m[1]".to_owned(), y),
                ("cover.photographer.exposure".to_owned(), &person.exposure),
            ]);
        }
        for (kind, screen) in self.screens() {
            let named = |(key, param)| (format!("cover.{}.{key}", kind.name()), param);
            params.extend(screen.given().map(named));
        }
        if let Some(frame) = &self.frame {
            let ([left, right], [top, bottom]) = (&frame.view_x, &frame.view_y);
            params.extend([
                ("cover.frame.view_x[0]".to_owned(), left),
                ("cover.frame.view_x[1]".to_owned(), right),
                ("cover.frame.view_y[0]".to_owned(), top),
                ("cover.frame.view_y[1]".to_owned(), bottom),
                ("cover.frame.frame_m".to_owned(), &frame.frame_m),
                ("cover.frame.frame_radiance".to_owned(), &frame.frame_radiance),
            ]);
        }
        params
    }
}

/// A table whose other keys have defaults, so that its share alone describes it.
trait Shared: Default {
    fn share_mut(&mut self) -> &mut f64;
}

impl Shared for PhotographerRecipe {
    fn share_mut(&mut self) -> &mut f64 {
        &mut self.share
    }
}

impl Shared for ScreenRecipe {
    fn share_mut(&mut self) -> &mut f64 {
        &mut self.share
    }
}

impl Shared for FrameRecipe {
    fn share_mut(&mut self) -> &mut f64 {
        &mut self.share
    }
}

/// Reads a share, or a table with a share.
fn share_or_table<'de, D, T>(deserializer: D) -> Result<Option<T>, D::Error>
where
    D: Deserializer<'de>,
    T: Shared + Deserialize<'de>,
{
    struct ShareOrTable<T>(PhantomData<T>);

    impl<'de, T: Shared + Deserialize<'de>> Visitor<'de> for ShareOrTable<T> {
        type Value = T;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str(
                "the share of scenes, 0.3 for instance, or a table with share and other keys",
            )
        }

        fn visit_f64<E: de::Error>(self, share: f64) -> Result<T, E> {
            let mut table = T::default();
            *table.share_mut() = share;
            Ok(table)
        }

        fn visit_i64<E: de::Error>(self, share: i64) -> Result<T, E> {
            self.visit_f64(share as f64)
        }

        fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<T, A::Error> {
            T::deserialize(de::value::MapAccessDeserializer::new(map))
        }
    }

    deserializer.deserialize_any(ShareOrTable(PhantomData)).map(Some)
}

/// Returns the schema of a share, or of a table with a share.
fn share_or<T: JsonSchema>(generator: &mut SchemaGenerator) -> Schema {
    let table = generator.subschema_for::<T>();
    json_schema!({
        "anyOf": [{ "type": "number", "exclusiveMinimum": 0, "maximum": 1 }, table],
    })
}
