//! `camera.focus`: the plane in focus.

use super::keys::{At, Drawing, Drawn, Keys, Row, Visit, VisitParams};
use super::param::{Choice, Param, ParamVisitor, choice_of, is_key};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{self, Deserializer, MapAccess, Visitor};
use serde::{Deserialize, Serialize, Serializer};
use std::borrow::Cow;
use std::fmt;

/// The plane in focus without the glass. The focus shift of the glass is not compensated.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(
    untagged,
    deny_unknown_fields,
    expecting = r#"focus must be {"distance_m": z}, {"at": "front_center"}, {"at": "back_center"} or {"at": "infinity"}"#
)]
pub enum Focus {
    /// A distance: `{"distance_m": z}`.
    Distance {
        /// Distance of the plane from the lens.
        distance_m: f64,
    },
    /// A place in the scene: `{"at": "front_center"}`.
    At {
        /// Name of the place.
        at: FocusAt,
    },
}

/// A place in the scene that determines the focus.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FocusAt {
    /// Mean z of the four centre pixels of the front depth image, as published; for a mesh, z of the first hit of the
    /// ray through the film's centre.
    FrontCenter,
    /// Mean z of the four centre pixels of the back depth image, mirrored in the pane; for a mesh, as for the front.
    BackCenter,
    Infinity,
}

impl Keys for Focus {
    fn rows(at: &At<'static>, rows: &mut Vec<Row>) {
        f64::rows(at, rows);
    }

    fn numbers(&self, at: &At<'_>, visit: &mut Visit<'_>) {
        if let Self::Distance { distance_m } = self {
            distance_m.numbers(&at.below("distance_m"), visit);
        }
    }
}

impl Drawn for Focus {
    type Recipe = FocusRecipe;

    fn params<'r>(recipe: &'r FocusRecipe, at: &At<'_>, visit: &mut VisitParams<'_, 'r>) {
        for focus in recipe.each() {
            if let FocusRecipe::DistanceM(param) = focus {
                visit(at, param);
            }
        }
    }

    fn draw(recipe: &FocusRecipe, at: &At<'_>, draw: &dyn Drawing) -> Self {
        let place = |at| Self::At { at };
        match recipe.chosen(at, draw) {
            FocusRecipe::FrontCenter => place(FocusAt::FrontCenter),
            FocusRecipe::BackCenter => place(FocusAt::BackCenter),
            FocusRecipe::Infinity => place(FocusAt::Infinity),
            FocusRecipe::DistanceM(param) => {
                Self::Distance { distance_m: draw.value(&at.path, param) }
            }
            // The caller knows where the scene's pane is.
            FocusRecipe::Glass => Self::Distance { distance_m: f64::NAN },
            FocusRecipe::Choice(_) => unreachable!("a choice of choices is not parsed"),
        }
    }
}

/// The plane in focus.
#[derive(Clone, Debug, PartialEq)]
pub enum FocusRecipe {
    /// `"front_center"`: the four centre pixels of the front depth image.
    FrontCenter,
    /// `"back_center"`: the four centre pixels of the back depth image, as mirrored in the pane.
    BackCenter,
    /// `"glass"`: the pane's front face.
    Glass,
    /// `"infinity"`: objects at infinity.
    Infinity,
    /// `{ choice = [..], weights = [..] }`: a list of words and distances (m).
    Choice(Choice<FocusRecipe>),
    /// A distance from the lens, m.
    DistanceM(Param),
}

impl FocusRecipe {
    /// Returns the alternative of a scene.
    pub fn chosen(&self, at: &At<'_>, draw: &dyn Drawing) -> &Self {
        match self {
            Self::Choice(choice) => choice.at(draw.unit(&at.path)),
            one => one,
        }
    }

    /// Returns the alternatives of a choice, or `self` for any other variant.
    pub fn each(&self) -> &[Self] {
        match self {
            Self::Choice(choice) => &choice.values,
            one => std::slice::from_ref(one),
        }
    }
}

impl Serialize for FocusRecipe {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::FrontCenter => serializer.serialize_str("front_center"),
            Self::BackCenter => serializer.serialize_str("back_center"),
            Self::Glass => serializer.serialize_str("glass"),
            Self::Infinity => serializer.serialize_str("infinity"),
            Self::Choice(choice) => choice.serialize(serializer),
            Self::DistanceM(param) => param.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for FocusRecipe {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(FocusVisitor)
    }
}

struct FocusVisitor;

impl<'de> Visitor<'de> for FocusVisitor {
    type Value = FocusRecipe;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(
            "\"front_center\", \"back_center\", \"glass\", \"infinity\", a choice of them, or metres as ",
        )?;
        ParamVisitor.expecting(f)
    }

    fn visit_str<E: de::Error>(self, text: &str) -> Result<FocusRecipe, E> {
        match text {
            "front_center" => Ok(FocusRecipe::FrontCenter),
            "back_center" => Ok(FocusRecipe::BackCenter),
            "glass" => Ok(FocusRecipe::Glass),
            "infinity" => Ok(FocusRecipe::Infinity),
            _ => Err(E::invalid_value(de::Unexpected::Str(text), &self)),
        }
    }

    fn visit_i64<E: de::Error>(self, value: i64) -> Result<FocusRecipe, E> {
        ParamVisitor.visit_i64(value).map(FocusRecipe::DistanceM)
    }

    fn visit_f64<E: de::Error>(self, value: f64) -> Result<FocusRecipe, E> {
        ParamVisitor.visit_f64(value).map(FocusRecipe::DistanceM)
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<FocusRecipe, A::Error> {
        let Some(kind) = map.next_key::<String>()? else {
            return Err(de::Error::invalid_length(0, &self));
        };
        if !is_key(&kind) {
            return ParamVisitor::visit_kind(&kind, map).map(FocusRecipe::DistanceM);
        }
        let choice = Choice::<FocusRecipe>::read(&kind, map)?;
        let is_plain = |word: &FocusRecipe| match word {
            FocusRecipe::Choice(_) => false,
            FocusRecipe::DistanceM(param) => matches!(param, Param::Constant(_)),
            _ => true,
        };
        if choice.values.is_empty() || !choice.values.iter().all(is_plain) {
            return Err(de::Error::custom(
                "choice must list one or more words or numbers (metres)",
            ));
        }
        Ok(FocusRecipe::Choice(choice))
    }
}

impl JsonSchema for FocusRecipe {
    fn schema_name() -> Cow<'static, str> {
        "Focus".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let words = json_schema!({ "enum": ["front_center", "back_center", "glass", "infinity"] });
        json_schema!({
            "description": "The plane in focus: a word, metres, a distribution of metres, or a choice of words and metres.",
            "anyOf": [
                words,
                generator.subschema_for::<Param>(),
                choice_of(&json_schema!({ "anyOf": [words, { "type": "number" }] })),
            ],
        })
    }
}
