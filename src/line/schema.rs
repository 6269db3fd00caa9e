//! JSON Schema of a scene line, for editors and other programs: `manifests/scene.schema.json`.

use super::scene_line::{SCENE_SCHEMA, SceneLine};
use schemars::SchemaGenerator;
use serde_json::Value;

/// Returns the schema of `glasshouse.scene/1` in JSON Schema 2020-12.
pub fn scene_schema() -> Value {
    let mut schema = SchemaGenerator::default().into_root_schema_for::<SceneLine>();
    schema.insert("title".to_owned(), "Glasshouse scene".into());
    let mut value = schema.to_value();
    value["properties"]["schema"]["const"] = SCENE_SCHEMA.into();
    value
}

#[cfg(test)]
mod tests {
    use super::super::published;
    use super::*;
    use expect_test::expect_file;
    use serde_json::json;

    #[test]
    fn generated_schema_of_scenes() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../manifests/scene.schema.json");
        let text = serde_json::to_string_pretty(&scene_schema()).unwrap() + "\n";
        expect_file![path].assert_eq(&text);
    }

    #[test]
    fn lines_are_valid_and_mistakes_are_not() {
        let validator = jsonschema::validator_for(&scene_schema()).unwrap();
        let line = serde_json::to_value(published()).unwrap();
        let wrong: Vec<String> = validator.iter_errors(&line).map(|e| e.to_string()).collect();
        assert!(wrong.is_empty(), "{wrong:?}");
        for (pointer, key, value) in [
            ("/glass", "iro", json!(1.5)),
            ("/glass", "ior", json!("glassy")),
            ("/glass", "ior", json!(0.9)),
            ("/glass", "tilt_deg", json!([1])),
            ("/glass", "tilt_deg", json!([90, 0])),
            ("/film", "width", json!(0)),
            ("/film", "filter", json!("round")),
            ("/camera", "focus", json!({"at": "nowhere"})),
            ("", "id", json!("a b")),
            ("", "schema", json!("glasshouse.scene/2")),
            ("", "front", json!({"colour": "a.png"})),
        ] {
            let mut wrong = line.clone();
            wrong.pointer_mut(pointer).unwrap()[key] = value.clone();
            assert!(!validator.is_valid(&wrong), "{pointer}/{key} = {value}");
        }
    }
}
