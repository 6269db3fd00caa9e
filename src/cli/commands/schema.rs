//! `schema`: prints the JSON Schema of recipes.

use crate::cli::exit_code::Exit;
use crate::cli::output::Output;
use plan::recipe_schema;
use serde::Serialize;
use serde_json::Value;
use std::fmt;

pub(super) fn run(output: &Output) -> Exit {
    output.show("glasshouse.schema/1", &Schema { recipe: recipe_schema() });
    Exit::Done
}

#[derive(Serialize)]
struct Schema {
    recipe: Value,
}

impl fmt::Display for Schema {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:#}", self.recipe)
    }
}
