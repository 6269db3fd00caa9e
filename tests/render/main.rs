//! Renders scene lines and recipes, and compares whole images with an independent renderer, with photographs, and with
//! renderings with other numbers of threads and other tiles.
#![allow(
    clippy::unwrap_used,
    clippy::disallowed_methods,
    clippy::print_stderr,
    clippy::print_stdout,
    reason = "tests may panic in any function, damage files, show numbers, and print why they are skipped"
)]

mod estimate;
mod hard_case_measures;
mod hard_cases;
mod layers;
mod light;
mod list;
mod mesh;
mod negligible;
mod oracle;
mod pictures;
mod places;
mod real;
mod real_list;
mod real_relative;
mod real_scenes;
mod real_sets;
mod rendering;
mod same;
#[path = "../support/mod.rs"]
mod support;
