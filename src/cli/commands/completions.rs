//! `completions SHELL`

use crate::cli::args::Args;
use crate::cli::exit_code::{Exit, Failure};
use crate::cli::look_args::CompletionsArgs;
use crate::cli::output::Output;
use clap::CommandFactory;
use serde_json::json;

pub(super) fn run(args: &CompletionsArgs, output: &Output) -> Result<Exit, Failure> {
    let mut command = Args::command();
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut command, "glasshouse", &mut script);
    let script = String::from_utf8(script).map_err(|e| Failure::new(Exit::Failed, e))?;
    let object = json!({ "shell": args.shell.to_string(), "script": script });
    output.result("glasshouse.completions/1", object, script.trim_end());
    Ok(Exit::Done)
}
