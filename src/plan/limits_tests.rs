//! Every declared number of a recipe is checked against its limits: below, at and above each end, as a constant and as the end of a
//! distribution.

use super::recipe::Recipe;
use super::recipe::tests::PAPER;
use glasshouse_line::keys::{Row, declared_rows};
use toml::{Table, Value};

/// Returns the paper's recipe with every table below its sections. Rules between keys may refuse it; ranges are checked before them.
fn full() -> Table {
    let tables = "wave = { amplitude_m = 0, length_m = 1 }\nsmudges = { coverage = 0 }\n\
                  outline = { x_m = [0, 1], y_m = [0, 1] }\ndistance_m";
    toml::from_str(&PAPER.replacen("distance_m", tables, 1)).unwrap()
}

/// Puts `value` at the path of `row`, into its element; the other elements are 0, or the least that their limits allow.
fn put(recipe: &mut Table, row: &Row, element: usize, value: Value) {
    let (parent, name) = row.path.rsplit_once('.').unwrap();
    let section = parent.split('.').fold(recipe, |table, part| {
        table.entry(part).or_insert_with(|| Table::new().into()).as_table_mut().unwrap()
    });
    let value = if row.numbers == 1 {
        value
    } else {
        let limit = |k: usize| row.key.limits.get(k).or(row.key.limits.last()).unwrap();
        let valid = |k: usize| limit(k).edges().0.first().copied().unwrap_or(0.0);
        let mut list: Vec<Value> = (0..row.numbers).map(|k| valid(k).into()).collect();
        list[element] = value;
        list.into()
    };
    section.insert(name.to_owned(), value);
}

/// Returns the error of a recipe that names `path`, if there is one.
fn refusal(recipe: &Table, path: &str) -> Option<String> {
    let error = Recipe::parse(&toml::to_string(recipe).unwrap()).err()?.to_string();
    (error.contains(path) && error.contains("but must be")).then_some(error)
}

fn one(key: &str, values: [f64; 2]) -> Value {
    Table::from_iter([(key.to_owned(), values.to_vec().into())]).into()
}

#[test]
fn every_declared_number_has_limits_that_recipes_obey() {
    let mut tried = 0;
    for row in declared_rows().iter().filter(|row| row.in_recipes) {
        for element in 0..row.numbers {
            let limit = row.key.limits.get(element).or(row.key.limits.last());
            let limit = limit.unwrap_or_else(|| panic!("{} has no range", row.path));
            let (inside, outside) = limit.edges();
            let valid = inside.first().copied().unwrap_or(1.0);
            for (values, is_refused) in [(&inside, false), (&outside, true)] {
                for &value in values {
                    let mut ends = [valid, value];
                    ends.sort_by(f64::total_cmp);
                    let kind = if limit.is_whole() { "choice" } else { "uniform" };
                    for written in [value.into(), one(kind, ends)] {
                        let mut recipe = full();
                        put(&mut recipe, row, element, written);
                        let error = refusal(&recipe, &row.paths()[element]);
                        assert_eq!(
                            error.is_some(),
                            is_refused,
                            "{} = {value}: {error:?}",
                            row.path
                        );
                        tried += 1;
                    }
                }
            }
        }
    }
    assert!(tried > 200, "{tried}");
}
