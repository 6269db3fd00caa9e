//! JSON Schemas of a recipe's values, for editors.

use super::{Normal, OneOf, Param};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use std::borrow::Cow;

/// Returns the schema of a choice of `items`.
pub fn choice_of(items: &Schema) -> Schema {
    json_schema!({
        "type": "object",
        "properties": {
            "choice": { "type": "array", "minItems": 1, "items": items },
            "weights": {
                "description": "Relative probabilities, one for each entry of choice. Default: all are equal.",
                "type": "array", "minItems": 1, "items": { "type": "number", "minimum": 0 },
            },
        },
        "required": ["choice"],
        "additionalProperties": false,
    })
}

impl JsonSchema for Param {
    fn schema_name() -> Cow<'static, str> {
        "Param".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let ends = json_schema!({ "type": "array", "items": { "type": "number" }, "minItems": 2, "maxItems": 2 });
        let normal = generator.subschema_for::<Normal>();
        let one = |key: &str, of: &Schema| {
            json_schema!({
                "type": "object", "properties": { key: of }, "required": [key], "additionalProperties": false,
            })
        };
        json_schema!({
            "description": "A constant, a distribution that each scene draws from, or the value in the photograph's record.",
            "anyOf": [
                { "type": "number" },
                { "const": "from_source" },
                one("uniform", &ends),
                one("log_uniform", &ends),
                one("normal", &normal),
                choice_of(&json_schema!({ "type": "number" })),
            ],
        })
    }
}

impl<T: JsonSchema> JsonSchema for OneOf<T> {
    fn schema_name() -> Cow<'static, str> {
        format!("OneOf{}", T::schema_name()).into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let one = generator.subschema_for::<T>();
        json_schema!({ "description": "A name, or a choice of names.", "anyOf": [one, choice_of(&one)] })
    }
}
