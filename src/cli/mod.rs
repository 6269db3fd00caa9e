//! The command line: the only code that prints, reads the environment, catches signals or exits.

mod args;
mod commands;
mod exit_code;
mod freed_memory;
mod isolate;
#[cfg(feature = "train")]
mod network;
mod output;
mod progress;
mod queue;
mod rows;
mod signals;
mod status_text;
mod store_env;
mod target;
mod watchdog;

pub use commands::Args;
pub use exit_code::Exit;

use clap::Parser;
use exit_code::Failure;
use output::Output;
use std::process::ExitCode;

/// Parses the arguments, runs the command, and returns the exit code.
pub fn main() -> ExitCode {
    let args = match Args::try_parse() {
        Ok(args) => args,
        Err(error) => {
            // Help and version go to stdout and are not errors.
            let code = if error.use_stderr() { Exit::Usage } else { Exit::Done };
            output::usage(&error);
            // The parser has failed, so search for --json directly.
            let json = std::env::args_os()
                .take_while(|argument| argument != "--")
                .any(|argument| argument == "--json");
            if json && code == Exit::Usage {
                output::usage_json(&error.to_string());
            }
            return finish(Ok(code), &Output::plain());
        }
    };
    let output = Output::new(&args.global);
    #[cfg(feature = "train")]
    network::limit_candle_threads(&args.global);
    // The stores' HTTP client has no TLS provider of its own; without a default, the first connection panics.
    let _ = rustls::crypto::ring::default_provider().install_default();
    watchdog::start(args.global.hang_s, Output::new(&args.global));
    finish(args.run(&output), &output)
}

/// Reports a failure, including an answer that could not be written, and returns the exit code.
fn finish(result: Result<Exit, Failure>, output: &Output) -> ExitCode {
    if let Some(folder) = render::disk::unsynced_folder() {
        output.note(&format!("{}: {}", folder.display(), render::disk::NO_FOLDER_SYNC));
    }
    match result.and_then(|exit| output::check_stdout().map(|()| exit)) {
        Ok(exit) => exit.into(),
        Err(failure) => {
            output.error(&failure);
            failure.exit.into()
        }
    }
}
