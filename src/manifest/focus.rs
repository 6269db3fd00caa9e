//! Where a recipe's scenes are sharp.

use super::param::{Param, ParamVisitor};
use serde::Deserialize;
use serde::de::{self, Deserializer, MapAccess, Visitor};
use std::fmt;

/// What is sharp.
#[derive(Clone, Debug, PartialEq)]
pub enum FocusRecipe {
    /// `"front_center"`: the four centre pixels of the front depth image.
    FrontCenter,
    /// `"infinity"`
    Infinity,
    /// A distance from the lens, m.
    DistanceM(Param),
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
        f.write_str("\"front_center\", \"infinity\", or metres as ")?;
        ParamVisitor.expecting(f)
    }

    fn visit_str<E: de::Error>(self, text: &str) -> Result<FocusRecipe, E> {
        match text {
            "front_center" => Ok(FocusRecipe::FrontCenter),
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

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<FocusRecipe, A::Error> {
        ParamVisitor.visit_map(map).map(FocusRecipe::DistanceM)
    }
}
