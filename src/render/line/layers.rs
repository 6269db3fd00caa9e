//! The layers that a scene renders. The tracer skips all others.

use crate::layer::{Layer, PerLayer};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{self, Deserializer};
use serde::{Deserialize, Serialize, Serializer};
use std::borrow::Cow;

/// A set of layers; in JSON and TOML, a list of names. Never empty.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LayerSet(PerLayer<bool>);

impl Default for LayerSet {
    fn default() -> Self {
        Self(PerLayer([true; 4]))
    }
}

impl LayerSet {
    /// Returns, for each layer, true if the set contains the layer.
    pub fn asked(self) -> PerLayer<bool> {
        self.0
    }

    /// Iterates over the names of the layers, in order.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        self.iter().map(Layer::name)
    }

    /// Iterates over the layers, in order.
    pub fn iter(self) -> impl Iterator<Item = Layer> {
        Layer::ALL.into_iter().filter(move |&layer| self.0[layer])
    }
}

impl Serialize for LayerSet {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.names())
    }
}

impl<'de> Deserialize<'de> for LayerSet {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let mut set = PerLayer([false; 4]);
        for name in Vec::<String>::deserialize(deserializer)? {
            let layer = Layer::from_name(&name).ok_or_else(|| {
                de::Error::custom(format!(
                    "there is no layer {name:?}; the layers are {}",
                    Layer::NAMES.join(", ")
                ))
            })?;
            if std::mem::replace(&mut set[layer], true) {
                return Err(de::Error::custom(format!("layer {name} is listed twice")));
            }
        }
        if set.0 == [false; 4] {
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
            "description": "Layers to render.",
            "type": "array", "items": { "enum": Layer::NAMES }, "minItems": 1, "uniqueItems": true,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_are_lists_of_names() {
        let set: LayerSet = serde_json::from_str(r#"["glass_reflection","input"]"#).unwrap();
        assert_eq!(set.asked().0, [true, false, true, false]);
        let text = serde_json::to_string(&set).unwrap();
        assert_eq!(text, r#"["input","glass_reflection"]"#);
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
