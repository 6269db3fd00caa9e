//! `completions SHELL`: prints a completion script.

use crate::cli::exit_code::{Exit, Failure};
use crate::cli::output::Output;
use clap::Args as ClapArgs;
use clap::Command;
use clap_complete::Shell;
use serde::Serialize;
use std::fmt;

#[derive(Debug, ClapArgs)]
pub(super) struct CompletionsArgs {
    /// Shell to complete for
    #[arg(value_enum)]
    shell: Shell,
}

pub(super) fn run(
    args: &CompletionsArgs,
    mut command: Command,
    output: &Output,
) -> Result<Exit, Failure> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut command, "glasshouse", &mut script);
    let script = String::from_utf8(script).map_err(|e| Failure::new(Exit::Failed, e))?;
    let shell = args.shell.to_string();
    output.show("glasshouse.completions/1", &Completions { shell, script });
    Ok(Exit::Done)
}

#[derive(Serialize)]
struct Completions {
    shell: String,
    script: String,
}

impl fmt::Display for Completions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.script.trim_end())
    }
}
