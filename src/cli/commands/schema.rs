//! `schema`

use crate::cli::exit_code::Exit;
use crate::cli::output::Output;
use plan::recipe_schema;
use serde_json::json;

pub(super) fn run(output: &Output) -> Exit {
    let recipe = recipe_schema();
    let text = format!("{recipe:#}");
    output.say("glasshouse.schema/1", json!({ "recipe": recipe }), text);
    Exit::Done
}
