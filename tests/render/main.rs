//! Whole images: against an independent renderer, against photographs, and against themselves in other cuts.

#![allow(clippy::unwrap_used, reason = "a test's functions fail like the test")]
#![allow(
    clippy::print_stdout,
    reason = "measured numbers, and why a test was skipped"
)]

mod estimate;
mod oracle;
mod real;
mod real_list;
mod real_scenes;
mod real_sets;
