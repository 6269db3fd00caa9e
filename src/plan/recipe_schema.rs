//! JSON Schema of a recipe, for editors: `manifests/recipe.schema.json`, generated from the types that parse recipes.

use super::focus::FocusRecipe;
use super::glazing::{GlazingRecipe, glazings};
use super::one_of::OneOf;
use super::param::{Normal, Param};
use super::recipe::{RECIPE_SCHEMA, Recipe};
use super::sensor::SensorName;
use super::sensor_model::sensor_models;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde_json::Value;
use std::borrow::Cow;

/// Returns the schema of `glasshouse.recipe/1` in JSON Schema 2020-12.
pub fn recipe_schema() -> Value {
    let mut schema = SchemaGenerator::default().into_root_schema_for::<Recipe>();
    schema.insert("title".to_owned(), "Glasshouse recipe".into());
    let mut value = schema.to_value();
    value["properties"]["schema"]["const"] = RECIPE_SCHEMA.into();
    value
}

/// Returns the schema of a choice of `items`.
fn choice_of(items: &Schema) -> Schema {
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

impl JsonSchema for GlazingRecipe {
    fn schema_name() -> Cow<'static, str> {
        "Glazing".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        let names: Vec<&String> = glazings().by_name.keys().collect();
        let names = json_schema!({ "enum": names });
        json_schema!({
            "description": "The name of a glazing of docs/glass.md, or a choice of names.",
            "anyOf": [names, choice_of(&names)],
        })
    }
}

impl JsonSchema for SensorName {
    fn schema_name() -> Cow<'static, str> {
        "SensorName".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        let names: Vec<&String> = sensor_models().by_name.keys().collect();
        json_schema!({ "description": "The name of a sensor of docs/camera.md.", "enum": names })
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

#[cfg(test)]
mod tests {
    use super::*;

    fn shipped() -> Value {
        serde_json::from_str(include_str!("../../manifests/recipe.schema.json")).unwrap()
    }

    #[test]
    fn the_shipped_schema_matches_the_types() {
        assert!(
            shipped() == recipe_schema(),
            "manifests/recipe.schema.json is stale: glasshouse schema > manifests/recipe.schema.json"
        );
    }

    #[test]
    fn shipped_recipes_are_valid_and_mistakes_are_not() {
        let validator = jsonschema::validator_for(&shipped()).unwrap();
        let json = |text: &str| -> Value { toml::from_str(text).unwrap() };
        let recipes = [
            include_str!("../../manifests/smoke.toml"),
            include_str!("../../manifests/paper.toml"),
            include_str!("../../manifests/wild.toml"),
            include_str!("../../manifests/learn.toml"),
            include_str!("../../manifests/windows.toml"),
        ];
        for recipe in recipes {
            Recipe::parse(recipe).unwrap();
            let wrong: Vec<String> =
                validator.iter_errors(&json(recipe)).map(|e| e.to_string()).collect();
            assert!(wrong.is_empty(), "{wrong:?}");
        }
        // Both the schema and the program reject unknown keys and wrong values.
        for (from, to) in [
            ("ior = 1.6", "ior = \"glassy\""),
            ("ior = 1.6", "ior = { unifrom = [1, 2] }"),
            ("ior = 1.6", "iro = 1.6"),
            ("ior = 1.6", "ior = { choice = [1.5, 1.6], weights = [1, -1] }"),
            ("thickness_m = 0.010\nior = 1.6", "glazing = \"window\""),
            ("ior = 1.6", "outline = { x_m = [0, 1] }"),
            ("focus = \"front_center\"", "focus = \"nowhere\""),
            ("[camera]", "[light]\nscale = \"bright\"\n[camera]"),
            ("layout = \"diode\"", "layout = \"dioed\""),
            ("schema = \"glasshouse.recipe/1\"", "schema = \"glasshouse.recipe/2\""),
        ] {
            let text = recipes[1].replacen(from, to, 1);
            assert_ne!(text, recipes[1], "{from}");
            assert!(Recipe::parse(&text).is_err(), "{to}");
            assert!(!validator.is_valid(&json(&text)), "{to}");
        }
    }
}
