//! Tests training, inference and scores through the program. This folder also has the scripts that computed the
//! expected numbers of unit tests.
#![cfg(feature = "train")]
#![allow(
    clippy::unwrap_used,
    clippy::disallowed_methods,
    clippy::print_stderr,
    reason = "tests may panic in any function, damage files, and print why they are skipped"
)]

mod bundle;
mod composing;
mod evaluate;
mod finite;
mod names;
mod photographs;
mod presets;
mod separate;
mod shipped;
mod similarity;
#[path = "../support/mod.rs"]
mod support;
mod training;
mod unet_training;
mod yardstick;
