//! Tests readers, `inspect`, `export` and `report`, with valid and with damaged files.
#![allow(
    clippy::unwrap_used,
    clippy::disallowed_methods,
    clippy::print_stderr,
    reason = "tests may panic in any function, damage files, and print why they are skipped"
)]

mod changed;
mod corpus;
mod every_file;
mod every_file_left;
mod export;
mod export_killed;
mod export_readers;
mod export_refused;
mod export_tensors;
mod inspect;
mod inspect_damage;
mod markup;
mod photographs;
mod report;
mod report_browser;
mod report_noise;
#[path = "../support/mod.rs"]
mod support;
