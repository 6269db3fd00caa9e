//! The command line: the only code that prints, reads the environment, catches signals or exits.

mod args;
mod audit_cmd;
mod bench_args;
mod bench_cmd;
mod bench_error_cmd;
mod bench_farm_cmd;
mod bench_trace_cmd;
#[cfg(feature = "train")]
mod bench_train_cmd;
mod completions_cmd;
mod control_cmd;
mod coordinate_cmd;
mod doctor_cmd;
#[cfg(feature = "train")]
mod evaluate_cmd;
#[cfg(feature = "train")]
mod evaluate_rows;
#[cfg(feature = "train")]
mod evaluate_text;
mod exit_code;
mod explain_cmd;
mod export_args;
mod export_cmd;
mod farm_args;
mod global_args;
mod inspect_cmd;
mod isolate;
mod look_args;
mod man_cmd;
mod merge_cmd;
#[cfg(feature = "train")]
mod network;
mod output;
mod plan_cmd;
mod plan_cost;
mod progress;
mod queue_cmd;
mod render_cmd;
mod report_cmd;
mod retry_cmd;
mod rows;
mod run_cmd;
#[cfg(feature = "train")]
mod run_training;
mod sample_cmd;
mod schema_cmd;
#[cfg(feature = "train")]
mod separate_cmd;
mod signals;
mod split_name;
mod status_cmd;
mod status_text;
mod store_env;
mod target;
#[cfg(feature = "train")]
mod train_args;
#[cfg(feature = "train")]
mod train_cmd;
#[cfg(feature = "train")]
mod train_vgg;
mod work_cmd;

pub use args::{Args, Command};
pub use exit_code::Exit;

use clap::Parser;
use output::Output;
use std::process::ExitCode;

/// Parses the arguments, does what they say, and returns the exit code.
pub fn main() -> ExitCode {
    let args = match Args::try_parse() {
        Ok(args) => args,
        Err(error) => {
            // Help and version go to stdout and are no error; the rest is usage.
            let code = if error.use_stderr() {
                Exit::Usage
            } else {
                Exit::Done
            };
            let _ = error.print();
            // The arguments were not understood, so --json is looked for by hand.
            let json = std::env::args_os()
                .take_while(|argument| argument != "--")
                .any(|argument| argument == "--json");
            if json && code == Exit::Usage {
                output::usage_json(&error.to_string());
            }
            return code.into();
        }
    };
    let output = Output::new(&args.global);
    // Queue and store each bring a TLS provider: without a choice the first connection panics.
    let _ = rustls::crypto::ring::default_provider().install_default();
    let result = match &args.command {
        Command::Run(run) => run_cmd::run(run, &args.global, &output),
        Command::Sample(sample) => sample_cmd::run(sample, &args.global, &output),
        Command::Plan(plan) => plan_cmd::run(plan, &args.global, &output),
        Command::Render(render) => render_cmd::run(render, &args.global, &output),
        Command::Work(work) => work_cmd::run(work, &args.global, &output),
        Command::Coordinate(coordinate) => coordinate_cmd::run(coordinate, &args.global, &output),
        Command::Merge(merge) => merge_cmd::run(merge, &args.global, &output),
        Command::Status(status) => status_cmd::run(status, &args.global, &output),
        Command::Pause(pause) => control_cmd::pause(pause, &args.global, &output),
        Command::Resume(resume) => control_cmd::resume(resume, &args.global, &output),
        Command::Cancel(cancel) => control_cmd::cancel(cancel, &args.global, &output),
        Command::Retry(retry) => retry_cmd::run(retry, &args.global, &output),
        Command::Explain(explain) => explain_cmd::run(explain, &args.global, &output),
        Command::Audit(audit) => audit_cmd::run(audit, &args.global, &output),
        #[cfg(feature = "train")]
        Command::Train(train) => train_cmd::run(train, &args.global, &output),
        #[cfg(feature = "train")]
        Command::Evaluate(evaluate) => evaluate_cmd::run(evaluate, &args.global, &output),
        #[cfg(feature = "train")]
        Command::Separate(separate) => separate_cmd::run(separate, &args.global, &output),
        Command::Export(export) => export_cmd::run(export, &args.global, &output),
        Command::Report(report) => report_cmd::run(report, &args.global, &output),
        Command::Schema => schema_cmd::run(&output),
        Command::Bench(bench) => bench_cmd::run(bench, &args.global, &output),
        Command::Inspect(inspect) => Ok(inspect_cmd::run(inspect, &output)),
        Command::Doctor(doctor) => doctor_cmd::run(doctor, &args.global, &output),
        Command::Completions(completions) => completions_cmd::run(completions, &output),
        Command::Man(man) => man_cmd::run(man, &args.global, &output),
    };
    match result {
        Ok(exit) => exit.into(),
        Err(failure) => {
            output.error(&failure);
            failure.exit.into()
        }
    }
}
