//! Named glazings, `glazings.toml`: layers and coatings of common windows, with a source for each number.

use super::choice::{Choice, is_key};
use glasshouse_line::{FaceCoating, GlassLayer, Roughness};
use serde::Deserialize;
use serde::de::{self, Deserializer, MapAccess, Visitor};
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

/// Returns the glazing with a name, if there is one.
pub(super) fn named(name: &str) -> Option<&'static Glazing> {
    glazings().by_name.get(name)
}

/// `glass.glazing` of a recipe: one name, or a choice of names. All names are known.
#[derive(Clone, Debug, PartialEq)]
pub struct GlazingRecipe(pub Choice<String>);

impl<'de> Deserialize<'de> for GlazingRecipe {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(NameVisitor)
    }
}

struct NameVisitor;

impl<'de> Visitor<'de> for NameVisitor {
    type Value = GlazingRecipe;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the name of a glazing, or { choice = [names], weights = [..] }")
    }

    fn visit_str<E: de::Error>(self, name: &str) -> Result<GlazingRecipe, E> {
        known(vec![name.to_owned()].into()).map_err(E::custom)
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<GlazingRecipe, A::Error> {
        match map.next_key::<String>()? {
            Some(key) if is_key(&key) => known(Choice::read(&key, map)?).map_err(de::Error::custom),
            Some(key) => Err(de::Error::unknown_field(&key, &["choice", "weights"])),
            None => Err(de::Error::invalid_length(0, &self)),
        }
    }
}

/// Checks that all names are known.
fn known(names: Choice<String>) -> Result<GlazingRecipe, String> {
    if names.values.is_empty() {
        return Err("choice must list one or more names of glazings".to_owned());
    }
    match names.values.iter().find(|name| named(name).is_none()) {
        None => Ok(GlazingRecipe(names)),
        Some(unknown) => {
            let all: Vec<_> = glazings().by_name.keys().map(String::as_str).collect();
            Err(format!("unknown glazing {unknown:?}, expected one of {}", all.join(", ")))
        }
    }
}
