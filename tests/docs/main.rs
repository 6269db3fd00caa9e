//! Checks the repository's documents, their command lines, the examples, and the launch files of `workers/`.
#![allow(
    clippy::unwrap_used,
    clippy::disallowed_methods,
    clippy::print_stderr,
    reason = "tests may panic in any function, damage files, and print why they are skipped"
)]

mod document_pages;
mod documents;
mod examples;
mod launch;
mod not_run;
#[path = "../support/mod.rs"]
mod support;
