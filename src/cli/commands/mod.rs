//! The commands, a file each: its arguments and what it does.

mod audit;
mod bench;
mod completions;
mod control;
mod coordinate;
mod doctor;
#[cfg(feature = "train")]
mod evaluate;
mod explain;
mod export;
mod inspect;
mod man;
mod merge;
mod plan;
mod render;
mod report;
mod retry;
mod run;
#[cfg(feature = "train")]
mod run_training;
mod sample;
mod schema;
#[cfg(feature = "train")]
mod separate;
mod status;
#[cfg(feature = "train")]
mod train;
mod work;

use super::args::{Command, Global};
use super::exit_code::{Exit, Failure};
use super::output::Output;

/// Does what `command` says.
pub(super) fn run(command: &Command, global: &Global, output: &Output) -> Result<Exit, Failure> {
    match command {
        Command::Run(run) => run::run(run, global, output),
        Command::Sample(sample) => sample::run(sample, global, output),
        Command::Plan(plan) => plan::run(plan, global, output),
        Command::Render(render) => render::run(render, global, output),
        Command::Work(work) => work::run(work, global, output),
        Command::Coordinate(coordinate) => coordinate::run(coordinate, global, output),
        Command::Merge(merge) => merge::run(merge, global, output),
        Command::Status(status) => status::run(status, global, output),
        Command::Pause(pause) => control::pause(pause, global, output),
        Command::Resume(resume) => control::resume(resume, global, output),
        Command::Cancel(cancel) => control::cancel(cancel, global, output),
        Command::Retry(retry) => retry::run(retry, global, output),
        Command::Explain(explain) => explain::run(explain, global, output),
        Command::Audit(audit) => audit::run(audit, global, output),
        #[cfg(feature = "train")]
        Command::Train(train) => train::run(train, global, output),
        #[cfg(feature = "train")]
        Command::Evaluate(evaluate) => evaluate::run(evaluate, global, output),
        #[cfg(feature = "train")]
        Command::Separate(separate) => separate::run(separate, global, output),
        Command::Export(export) => export::run(export, global, output),
        Command::Report(report) => report::run(report, global, output),
        Command::Schema => schema::run(output),
        Command::Bench(bench) => bench::run(bench, global, output),
        Command::Inspect(inspect) => Ok(inspect::run(inspect, output)),
        Command::Doctor(doctor) => doctor::run(doctor, global, output),
        Command::Completions(completions) => completions::run(completions, output),
        Command::Man(man) => man::run(man, global, output),
    }
}
