//! Which of the four layers a scene makes: what is not asked for is not traced.

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{self, Deserializer};
use serde::{Deserialize, Serialize, Serializer};
use std::borrow::Cow;

/// The layers' names, in the order in which everything stores them: I, T, R~, R.
pub const LAYER_NAMES: [&str; 4] = [
    "input",
    "transmission",
    "glass_reflection",
    "clean_reflection",
];

/// A set of layers, in JSON and TOML a list of names; never empty.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LayerSet([bool; 4]);

impl Default for LayerSet {
    fn default() -> Self {
        Self([true; 4])
    }
}

impl LayerSet {
    /// For each layer, in the order of [`LAYER_NAMES`], whether it is made.
    pub fn asked(self) -> [bool; 4] {
        self.0
    }

    /// Names of the layers that are made.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        let pairs = LAYER_NAMES.into_iter().zip(self.0);
        pairs.filter_map(|(name, asked)| asked.then_some(name))
    }
}

impl Serialize for LayerSet {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.names())
    }
}

impl<'de> Deserialize<'de> for LayerSet {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let mut set = [false; 4];
        for name in Vec::<String>::deserialize(deserializer)? {
            let place = LAYER_NAMES.iter().position(|known| *known == name);
            let place = place.ok_or_else(|| {
                de::Error::custom(format!(
                    "there is no layer {name:?}; the layers are {}",
                    LAYER_NAMES.join(", ")
                ))
            })?;
            if std::mem::replace(&mut set[place], true) {
                return Err(de::Error::custom(format!("layer {name} is listed twice")));
            }
        }
        if set == [false; 4] {
            return Err(de::Error::custom("layers is empty: name at least one"));
        }
        Ok(Self(set))
    }
}

impl JsonSchema for LayerSet {
    fn schema_name() -> Cow<'static, str> {
        "Layers".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "description": "Layers that are made.",
            "type": "array", "items": { "enum": LAYER_NAMES }, "minItems": 1, "uniqueItems": true,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_are_lists_of_names() {
        let set: LayerSet = serde_json::from_str(r#"["glass_reflection","input"]"#).unwrap();
        assert_eq!(set.asked(), [true, false, true, false]);
        let text = serde_json::to_string(&set).unwrap();
        assert_eq!(text, r#"["input","glass_reflection"]"#);
        assert_eq!(crate::trace::LAYERS, LAYER_NAMES);
    }

    #[test]
    fn other_lists_are_refused() {
        for (text, reason) in [
            ("[]", "layers is empty"),
            (r#"["input","input"]"#, "layer input is listed twice"),
            (r#"["I"]"#, "there is no layer \"I\"; the layers are input"),
        ] {
            let error = serde_json::from_str::<LayerSet>(text).unwrap_err();
            assert!(error.to_string().contains(reason), "{error}");
        }
    }
}
