//! `completions SHELL`

use crate::cli::exit_code::{Exit, Failure};
use crate::cli::output::Output;
use clap::Args as ClapArgs;
use clap::Command;
use clap_complete::Shell;
use serde_json::json;

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
    let object = json!({ "shell": args.shell.to_string(), "script": script });
    output.say("glasshouse.completions/1", object, script.trim_end());
    Ok(Exit::Done)
}
