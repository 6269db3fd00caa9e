//! Every declared number of a line is checked against its limits: below, at and above each end.

use super::keys::{Row, declared_rows};
use super::limits::Limit;
use super::{SceneLine, published};
use serde_json::{Value, json};

/// Returns lines that have every table of a line between them. Rules between keys may refuse them; ranges are checked before rules.
fn lines() -> Vec<Value> {
    let mut line = serde_json::to_value(published()).unwrap();
    line["glass"]["layers"] = json!([{"glass_m": 0.004, "ior": 1.5}, {"gap_m": 0.01}]);
    line["glass"]["coatings"] =
        json!([{"face": 0, "reflectance": [0, 0, 0], "transmittance": [0, 0, 0]}]);
    line["glass"]["wave"] = json!({"amplitude_m": 0, "length_m": 1});
    line["glass"]["smudges"] = json!({});
    line["glass"]["outline"] = json!({"x_m": [0, 1], "y_m": [0, 1]});
    let metered = json!({"percentile": 99, "level": 0.9});
    let parametric = json!({"parametric": {"gamma": 1, "s_curve": 0}});
    line["sensor"] = json!({
        "exposure": metered, "gain_dn_per_e": 1, "bits": 12, "jpeg_quality": 90, "tone": parametric,
    });
    let more = json!({
        "highlights": {"above": 0.9, "to": 2}, "depth_range": {"mean_m": 1}, "sketch": {"wall_m": 1},
        "cards": [{"color": "c", "distance_m": 1, "center_m": [0, 0], "width_m": 1}],
    });
    let with = |mut side: Value, keys: &[&str]| {
        for key in keys {
            side[*key] = more[*key].clone();
        }
        side
    };
    let mut lines = Vec::new();
    for side in ["front", "back"] {
        let photograph =
            with(line[side].clone(), &["highlights", "depth_range", "sketch", "cards"]);
        let mut other = photograph.clone();
        other["depth_range"] = json!({"near_m": 1, "far_m": 2});
        other["sketch"] = json!({"plane_m": 1});
        let mapped = json!({"panorama": "p", "depth": "d"});
        let mapped = with(mapped, &["highlights", "depth_range", "cards"]);
        let panorama = json!({"panorama": "p"});
        let mesh = with(json!({"mesh": "m", "pose": {}}), &["cards"]);
        for form in [photograph, other, mapped, panorama, mesh] {
            let mut line = line.clone();
            line[side] = form;
            lines.push(line);
        }
    }
    line["sensor"]["exposure"] = json!({"factor": 1});
    line["sensor"]["tone"] = json!({"filmic": {"exposure": 1}});
    lines.push(line);
    lines
}

/// Puts `value` at the path of `row`, into its element; false if the line has no such table.
fn put(line: &mut Value, row: &Row, element: usize, value: f64) -> bool {
    let (parent, name) = row.path.rsplit_once('.').unwrap_or(("", &row.path));
    let mut at = line;
    for part in parent.split('.').filter(|part| !part.is_empty()) {
        let Some(next) = at.get_mut(part) else {
            return false;
        };
        at = next;
        // Of a list of tables, the first with the key, or the first.
        if let Value::Array(tables) = at {
            let place = tables.iter().position(|table| table.get(name).is_some()).unwrap_or(0);
            at = &mut tables[place];
        }
    }
    let number = |value: f64, k: usize| {
        let limit = row.key.limits.get(k).or(row.key.limits.last());
        if limit.is_some_and(Limit::is_whole) && value.fract() == 0.0 {
            json!(value as i64)
        } else {
            json!(value)
        }
    };
    let valid = |k: usize| {
        let limit = row.key.limits.get(k).or(row.key.limits.last()).unwrap();
        number(limit.edges().0.first().copied().unwrap_or(1.0), k)
    };
    let value = number(value, element);
    at[name] = match row.path.as_str() {
        // A focus at a place has no distance.
        "camera.focus" => json!({"distance_m": value}),
        "glass.coatings.angles_deg" => json!([value]),
        "front.pose.rotation" | "back.pose.rotation" | "sensor.colour_matrix" => {
            let cell = |k| if k == element { value.clone() } else { valid(k) };
            json!([0, 3, 6].map(|row| [0, 1, 2].map(|column| cell(row + column))))
        }
        _ if row.numbers == 1 => value,
        _ => {
            let mut list: Vec<Value> = (0..row.numbers).map(valid).collect();
            list[element] = value;
            json!(list)
        }
    };
    true
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
    let lines = lines();
    let mut tried = 0;
    for row in declared_rows().iter().filter(|row| row.in_lines) {
        for element in 0..row.numbers {
            let limit = row.key.limits.get(element).or(row.key.limits.last());
            let limit = limit.unwrap_or_else(|| panic!("{} has no range", row.path));
            let (inside, outside) = limit.edges();
            let valid = inside.first().copied().unwrap_or(1.0);
            // The first line with the form that has the key.
            let is_read = |line: &&Value| {
                let mut line = (*line).clone();
                let is_put = put(&mut line, row, element, valid);
                is_put && refusal(&line).is_none_or(|error| !error.starts_with("not read"))
            };
            let of = lines.iter().find(is_read);
            let of = of.unwrap_or_else(|| panic!("no line takes {} = {valid}", row.path));
            let name = row.path.rsplit('.').next().unwrap();
            let is_named = |error: &String| {
                error.contains(name) && error.contains("but must be")
                    || error.starts_with("not read")
            };
            for (values, is_refused) in [(inside, false), (outside, true)] {
                for value in values {
                    let mut line = of.clone();
                    put(&mut line, row, element, value);
                    let error = refusal(&line).filter(is_named);
                    assert_eq!(error.is_some(), is_refused, "{} = {value}: {error:?}", row.path);
                    tried += 1;
                }
            }
        }
    }
    assert!(tried > 400, "{tried}");
}
