//! JSON Schema of a recipe, for editors: `manifests/recipe.schema.json`, generated from the types that parse recipes.

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

impl JsonSchema for SensorName {
    fn schema_name() -> Cow<'static, str> {
        "SensorName".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        let names: Vec<&String> = sensor_models().by_name.keys().collect();
        json_schema!({ "description": "The name of a sensor of docs/camera.md.", "enum": names })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use expect_test::expect_file;

    fn shipped() -> Value {
        serde_json::from_str(include_str!("../../manifests/recipe.schema.json")).unwrap()
    }

    #[test]
    fn generated_schema_of_recipes() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../manifests/recipe.schema.json");
        let text = serde_json::to_string_pretty(&recipe_schema()).unwrap() + "\n";
        expect_file![path].assert_eq(&text);
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
