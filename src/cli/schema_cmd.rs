//! `schema`

use super::exit_code::{Exit, Failure};
use super::output::Output;
use plan::recipe_schema;
use serde_json::json;

pub(super) fn run(output: &Output) -> Result<Exit, Failure> {
    let schema = recipe_schema();
    let text = serde_json::to_string_pretty(&schema).map_err(|e| Failure::new(Exit::Failed, e))?;
    output.result("glasshouse.schema/1", json!({ "recipe": schema }), &text);
    Ok(Exit::Done)
}
