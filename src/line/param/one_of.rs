//! `"name"` or `{ choice = ["name", ..], weights = [..] }`: a word of a recipe, or a choice of words.

use super::{Choice, is_key};
use serde::de::value::StrDeserializer;
use serde::de::{self, DeserializeOwned, Deserializer, MapAccess, Visitor};
use serde::{Deserialize, Serialize, Serializer};
use std::fmt;
use std::marker::PhantomData;

/// A word, or a choice of one or more words. `T` reads itself from a string.
#[derive(Clone, Debug, PartialEq)]
pub struct OneOf<T>(pub Choice<T>);

impl<T> From<T> for OneOf<T> {
    fn from(word: T) -> Self {
        Self(vec![word].into())
    }
}

impl<T: Serialize> Serialize for OneOf<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match &self.0 {
            Choice { values, weights: None } if values.len() == 1 => {
                values[0].serialize(serializer)
            }
            choice => choice.serialize(serializer),
        }
    }
}

impl<'de, T: DeserializeOwned> Deserialize<'de> for OneOf<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(OneOfVisitor(PhantomData))
    }
}

struct OneOfVisitor<T>(PhantomData<T>);

impl<'de, T: DeserializeOwned> Visitor<'de> for OneOfVisitor<T> {
    type Value = OneOf<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a name, or { choice = [names], weights = [..] }")
    }

    fn visit_str<E: de::Error>(self, name: &str) -> Result<OneOf<T>, E> {
        T::deserialize(StrDeserializer::new(name)).map(OneOf::from)
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<OneOf<T>, A::Error> {
        match map.next_key::<String>()? {
            Some(key) if is_key(&key) => {
                let choice = Choice::read(&key, map)?;
                if choice.values.is_empty() {
                    return Err(de::Error::custom("choice must list one or more names"));
                }
                Ok(OneOf(choice))
            }
            Some(key) => Err(de::Error::unknown_field(&key, &["choice", "weights"])),
            None => Err(de::Error::invalid_length(0, &self)),
        }
    }
}
