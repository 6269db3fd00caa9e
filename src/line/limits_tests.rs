//! Every declared number of a line is checked against its limits: below, at and above each end.

use super::keys::{Row, declared_rows};
use super::{SceneLine, published};
use serde_json::{Value, json};

/// Returns a line with every table below its sections. Rules between keys may refuse it; ranges are checked before them.
fn full() -> Value {
    let mut line = serde_json::to_value(published()).unwrap();
    line["glass"]["layers"] = json!([{"glass_m": 0.004, "ior": 1.5}, {"gap_m": 0.01}]);
    line["glass"]["coatings"] =
        json!([{"face": 0, "reflectance": [0, 0, 0], "transmittance": [0, 0, 0]}]);
    line["glass"]["wave"] = json!({"amplitude_m": 0, "length_m": 1});
    line["glass"]["smudges"] = json!({});
    line["glass"]["outline"] = json!({"x_m": [0, 1], "y_m": [0, 1]});
    line
}

/// Puts `value` at the path of `row`, into its element. A list of tables takes it in the first table that allows the key.
fn put(line: &mut Value, row: &Row, element: usize, value: f64) {
    let (parent, name) = row.path.rsplit_once('.').unwrap();
    let mut at = line;
    for part in parent.split('.') {
        at = &mut at[part];
        if let Value::Array(tables) = at {
            let is_gap = name == "gap_m";
            at = tables.iter_mut().find(|table| !is_gap || table.get("gap_m").is_some()).unwrap();
        }
    }
    // A focus at a place has no distance.
    if row.path == "camera.focus" {
        at["focus"] = json!({"distance_m": value});
        return;
    }
    let is_whole = row.key.limits[0].is_whole() && value.fract() == 0.0;
    let value = if is_whole { json!(value as i64) } else { json!(value) };
    let lists = ["angles_deg"];
    at[name] = if lists.contains(&name) {
        json!([value])
    } else if row.numbers == 1 {
        value
    } else {
        // The other elements are valid.
        let mut list: Vec<Value> = (0..row.numbers)
            .map(|k| {
                json!(
                    row.key
                        .limits
                        .get(k)
                        .or(row.key.limits.last())
                        .unwrap()
                        .edges()
                        .0
                        .first()
                        .copied()
                        .unwrap_or(0.0)
                )
            })
            .collect();
        list[element] = value;
        json!(list)
    };
}

/// Returns the error of a line, if it is refused.
fn refusal(line: &Value) -> Option<String> {
    match serde_json::from_value::<SceneLine>(line.clone()) {
        Err(error) => Some(format!("not read: {error}")),
        Ok(line) => line.validate().err().map(|error| error.to_string()),
    }
}

#[test]
fn every_declared_number_has_limits_that_lines_obey() {
    let mut tried = 0;
    for row in declared_rows().iter().filter(|row| row.in_lines) {
        for element in 0..row.numbers {
            let limits = row.key.limits;
            let limit = limits.get(element).or(limits.last());
            let (inside, outside) =
                limit.unwrap_or_else(|| panic!("{} has no range", row.path)).edges();
            let name = row.path.rsplit('.').next().unwrap();
            let is_named = |error: &String| {
                error.contains(name) && error.contains("but must be")
                    || error.starts_with("not read")
            };
            for (values, is_refused) in [(inside, false), (outside, true)] {
                for value in values {
                    let mut line = full();
                    put(&mut line, row, element, value);
                    let error = refusal(&line).filter(is_named);
                    assert_eq!(error.is_some(), is_refused, "{} = {value}: {error:?}", row.path);
                    tried += 1;
                }
            }
        }
    }
    assert!(tried > 150, "{tried}");
}
