//! Glasshouse farms physically based training data for single-image reflection removal.
//!
//! Two RGBD photographs become 3D sheets, a pane of glass stands between them, a thin lens in front,
//! and four exact images come out: `input` (I), `transmission` (T), `glass_reflection` (R~) and
//! `clean_reflection` (R). After Kim, Huo and Yoon, "Single Image Reflection Removal with
//! Physically-Based Training Images", CVPR 2020.
//!
//! The stages are crates of their own, which know nothing of runs, queues and the command line:
//!
//! ```text
//! procedural -> plan ------> render --------------> compose ----> train
//! (photographs) (recipe ->   (scene line ->          (pictures ->  (tuples ->
//!                scene lines) four images, a tuple)   scores)       networks)
//! ```
//!
//! This package runs them on one machine or on many. Its modules stand in pipeline order; a module imports only modules
//! above it. Only [`cli`] prints, exits and reads the environment.

#[cfg(feature = "train")]
pub use train;
pub use {compose, plan, procedural, render};

// Plan and run.
pub mod store;

pub mod run;

pub mod farm;

// Data sets for other programs.
pub mod export;

// Look.
mod text;

mod plot;

mod pipe;

pub mod serve;

pub mod report;

pub mod inspect;

pub mod doctor;

pub mod bench;

pub mod cli;
