//! Tests the command line: help, man pages, completions, signals, `--json`, exit codes, `bench` and `doctor`.
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
mod moved;
mod odd_names;
mod overwrite;
mod reads;
mod signals;
#[path = "../support/mod.rs"]
mod support;
