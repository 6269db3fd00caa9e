//! `camera.focus` of a recipe.

use super::choice::{Choice, is_key};
use super::param::{Param, ParamVisitor};
use serde::Deserialize;
use serde::de::{self, Deserializer, MapAccess, Visitor};
use std::fmt;

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
    /// Returns the alternatives of a choice, or `self` for any other variant.
    pub(super) fn each(&self) -> &[Self] {
        match self {
            Self::Choice(choice) => &choice.values,
            one => std::slice::from_ref(one),
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
