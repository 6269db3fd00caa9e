//! Whole images: against an independent renderer, and against themselves in other cuts.
#![allow(
    clippy::print_stdout,
    clippy::unwrap_used,
    reason = "tests print what they measure and may panic"
)]

mod oracle;
