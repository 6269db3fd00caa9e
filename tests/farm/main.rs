//! The real binary on real files: killed, resumed, damaged, refused.
#![allow(
    clippy::print_stdout,
    clippy::unwrap_used,
    reason = "tests print what they measure and may panic"
)]

mod damage;
mod invariance;
mod program;
mod quarantine;
mod refusals;
mod rendering;
mod resume;
