//! Training, inference and scores by the program; beside it the scripts that made the expected numbers of unit tests.
#![cfg(feature = "train")]
#![allow(
    clippy::unwrap_used,
    clippy::disallowed_methods,
    clippy::print_stderr,
    reason = "tests may panic in any function, damage files, and say why they cannot run here"
)]

mod evaluate;
#[path = "../support/mod.rs"]
mod support;
mod training;
