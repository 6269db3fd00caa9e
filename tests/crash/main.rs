//! Crashes commands after their file operations, loses what a crash may lose, and repeats the commands.
#![allow(
    clippy::unwrap_used,
    clippy::disallowed_methods,
    clippy::print_stderr,
    reason = "tests may panic in any function, write files, and print why they are skipped"
)]

mod calls;
mod crashes;
mod disk;
mod errors;
mod held;
mod journal;
mod parallel;
mod phase;
mod recording;
mod recovery;
mod short_reads;
mod states;
#[path = "../support/mod.rs"]
mod support;
