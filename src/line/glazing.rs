//! Named glazings, `glazings.toml`: layers and coatings of common windows, with a source for each number.

use super::keys::{At, Drawing, Drawn, VisitParams, words};
use super::param::OneOf;
use super::{FaceCoating, GlassLayer, Roughness};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{self, Deserializer};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt;
use std::sync::LazyLock;

/// A named glazing.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Glazing {
    /// One line for readers.
    pub description: String,
    /// Keys of [`Glazings::sources`], from which the numbers come.
    pub sources: Vec<String>,
    /// Layers from the camera outwards.
    pub layers: Vec<GlassLayer>,
    /// Coatings, at most one for each face.
    #[serde(default)]
    pub coatings: Vec<FaceCoating>,
    /// Roughness of the faces; smooth without it.
    pub roughness: Option<Roughness>,
}

impl Glazing {
    /// True for one layer without a coating, the only pane that can be bent.
    pub fn is_plain(&self) -> bool {
        self.layers.len() == 1 && self.coatings.is_empty()
    }
}

/// The file of all glazings.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Glazings {
    /// Sources of the numbers, by key.
    pub sources: BTreeMap<String, String>,
    /// Glazings by name.
    #[serde(rename = "glazing")]
    pub by_name: BTreeMap<String, Glazing>,
}

/// Returns the glazings that the program knows.
pub fn glazings() -> &'static Glazings {
    static FILE: LazyLock<Glazings> = LazyLock::new(|| {
        toml::from_str(include_str!("glazings.toml")).expect("a test parses the file")
    });
    &FILE
}

/// The name of a glazing in a line, for readers.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct GlazingName(pub String);

words!(GlazingName);

/// A recipe names a known glazing, or a choice of them.
impl Drawn for GlazingName {
    type Recipe = OneOf<KnownGlazing>;

    fn params<'r>(_: &'r Self::Recipe, _: &At<'_>, _: &mut VisitParams<'_, 'r>) {}

    fn draw(OneOf(names): &Self::Recipe, at: &At<'_>, draw: &dyn Drawing) -> Self {
        Self(names.at(draw.unit(&at.path)).0.clone())
    }
}

/// The name of a glazing that the program knows.
#[derive(Clone, PartialEq, Eq, Serialize)]
#[serde(transparent)]
pub struct KnownGlazing(String);

impl KnownGlazing {
    /// Returns its layers and coatings.
    pub fn glazing(&self) -> &'static Glazing {
        &glazings().by_name[&self.0]
    }
}

impl fmt::Debug for KnownGlazing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(&self.0, f)
    }
}

impl<'de> Deserialize<'de> for KnownGlazing {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let name = String::deserialize(deserializer)?;
        let known = &glazings().by_name;
        if known.contains_key(&name) {
            return Ok(Self(name));
        }
        let all: Vec<_> = known.keys().map(String::as_str).collect();
        let expected = all.join(", ");
        Err(de::Error::custom(format!("unknown glazing {name:?}, expected one of {expected}")))
    }
}

impl JsonSchema for KnownGlazing {
    fn schema_name() -> Cow<'static, str> {
        "Glazing".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        let names: Vec<&String> = glazings().by_name.keys().collect();
        json_schema!({ "description": "The name of a glazing of docs/glass.md.", "enum": names })
    }
}
