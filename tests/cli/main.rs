//! Tests the command line: help, completions, signals, `--json`, exit codes, and commands that only read or measure.
#![allow(
    clippy::unwrap_used,
    clippy::disallowed_methods,
    clippy::print_stderr,
    reason = "tests may panic in any function, damage files, and print why they are skipped"
)]

mod bench;
mod completions;
mod doctor;
mod help;
mod json;
mod signals;
#[path = "../support/mod.rs"]
mod support;
