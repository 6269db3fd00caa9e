//! `schema`: prints the JSON Schema of recipes or of scene lines.

use crate::cli::exit_code::Exit;
use crate::cli::output::Output;
use clap::{Args as ClapArgs, ValueEnum};
use glasshouse_line::schema::scene_schema;
use plan::recipe_schema;
use serde::Serialize;
use serde_json::Value;
use std::fmt;

#[derive(Debug, ClapArgs)]
pub(super) struct SchemaArgs {
    /// File that the schema describes
    #[arg(value_enum, default_value = "recipe")]
    of: Of,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Of {
    /// A recipe (.toml)
    Recipe,
    /// A scene, or a line of a manifest (.jsonl)
    Scene,
}

pub(super) fn run(args: &SchemaArgs, output: &Output) -> Exit {
    let schema = match args.of {
        Of::Recipe => Schema::Recipe(recipe_schema()),
        Of::Scene => Schema::Scene(scene_schema()),
    };
    output.show("glasshouse.schema/1", &schema);
    Exit::Done
}

#[derive(Serialize)]
#[serde(rename_all = "snake_case")]
enum Schema {
    Recipe(Value),
    Scene(Value),
}

impl fmt::Display for Schema {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Self::Recipe(schema) | Self::Scene(schema)) = self;
        write!(f, "{schema:#}")
    }
}
