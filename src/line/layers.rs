//! The layers and labels that a scene renders. The tracer skips all others.

use crate::label::{Label, LabelSet};
use crate::layer::{Layer, PerLayer};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{self, Deserializer};
use serde::{Deserialize, Serialize, Serializer};
use std::borrow::Cow;

/// A set of layers, and of labels beside them; in JSON and TOML, one list of names. At least one layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LayerSet {
    layers: PerLayer<bool>,
    labels: LabelSet,
}

impl Default for LayerSet {
    fn default() -> Self {
        Self { layers: PerLayer([true; 4]), labels: LabelSet::default() }
    }
}

impl LayerSet {
    /// Returns, for each layer, true if the set contains the layer.
    pub fn asked(self) -> PerLayer<bool> {
        self.layers
    }

    /// Returns the labels of the set.
    pub fn labels(self) -> LabelSet {
        self.labels
    }

    /// Iterates over the names of the layers, in order.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        self.iter().map(Layer::name)
    }

    /// Iterates over the layers, in order.
    pub fn iter(self) -> impl Iterator<Item = Layer> {
        Layer::ALL.into_iter().filter(move |&layer| self.layers[layer])
    }
}

impl Serialize for LayerSet {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.names().chain(self.labels.iter().map(Label::name)))
    }
}

impl<'de> Deserialize<'de> for LayerSet {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let (mut layers, mut labels) = (PerLayer([false; 4]), LabelSet::default());
        for name in Vec::<String>::deserialize(deserializer)? {
            let is_new = match (Layer::from_name(&name), Label::from_name(&name)) {
                (Some(layer), _) => !std::mem::replace(&mut layers[layer], true),
                (None, Some(label)) => labels.insert(label),
                (None, None) => {
                    return Err(de::Error::custom(format!(
                        "there is no layer {name:?}; the layers are {}, and the labels beside them {}",
                        Layer::NAMES.join(", "),
                        Label::NAMES.join(", ")
                    )));
                }
            };
            if !is_new {
                return Err(de::Error::custom(format!("layer {name} is listed twice")));
            }
        }
        if layers.0 == [false; 4] {
            let what = if labels == LabelSet::default() { "is empty" } else { "has labels alone" };
            return Err(de::Error::custom(format!(
                "layers {what}: name at least one of {}",
                Layer::NAMES.join(", ")
            )));
        }
        for (label, needed) in [
            (Label::Ghosts, &[Layer::GlassReflection][..]),
            (Label::ReflectedShare, &[Layer::Input, Layer::GlassReflection]),
        ] {
            let missing = needed.iter().find(|layer| !layers[**layer]);
            if let Some(layer) = missing.filter(|_| labels.contains(label)) {
                return Err(de::Error::custom(format!(
                    "layers lists {label}, which is computed from {layer}: add {layer}"
                )));
            }
        }
        Ok(Self { layers, labels })
    }
}

impl JsonSchema for LayerSet {
    fn schema_name() -> Cow<'static, str> {
        "Layers".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        let names = [Layer::NAMES, Label::NAMES].concat();
        json_schema!({
            "description": "Layers to render, and labels beside them.",
            "type": "array", "items": { "enum": names },
            "minItems": 1, "uniqueItems": true,
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
        let labelled = r#"["input","glass_reflection","coverage","ghosts"]"#;
        let set: LayerSet = serde_json::from_str(labelled).unwrap();
        assert_eq!(set.names().count(), 2);
        assert!(set.labels().contains(Label::Ghosts) && !set.labels().contains(Label::FrontDepth));
        assert_eq!(serde_json::to_string(&set).unwrap(), labelled);
    }

    #[test]
    fn other_lists_are_refused() {
        for (text, reason) in [
            ("[]", "layers is empty: name at least one of input"),
            (r#"["coverage"]"#, "layers has labels alone: name at least one of input"),
            (r#"["input","coverage","coverage"]"#, "layer coverage is listed twice"),
            (
                r#"["input","ghosts"]"#,
                "ghosts, which is computed from glass_reflection: add glass_reflection",
            ),
            (
                r#"["glass_reflection","reflected_share"]"#,
                "reflected_share, which is computed from input: add input",
            ),
            (r#"["input","input"]"#, "layer input is listed twice"),
            (r#"["I"]"#, "there is no layer \"I\"; the layers are input"),
        ] {
            let error = serde_json::from_str::<LayerSet>(text).unwrap_err();
            assert!(error.to_string().contains(reason), "{error}");
        }
    }
}
