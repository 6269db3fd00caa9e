//! Glasshouse generates physically based training data for single-image reflection removal.
//!
//! Glasshouse turns two RGBD photographs into 3D sheets, puts a pane of glass and a camera with a thin lens between
//! them, and renders four exact images: `input` (I), `transmission` (T), `glass_reflection` (R~) and `clean_reflection`
//! (R). The method follows Kim, Huo and Yoon, "Single Image Reflection Removal with Physically-Based Training Images",
//! CVPR 2020.
//!
//! Each stage is a separate crate, independent of runs, queues and the command line. All know the scene line ([`mod@line`]), the
//! parameters of one scene:
//!
//! ```text
//! procedural -> plan ------> render -------------> compose ---> examples --> train
//! (photographs) (recipe ->   (scene line ->         (pictures -> (tuples ->   (-> networks)
//!                scene lines) four images, a tuple)  scores)      examples)
//! ```
//!
//! This package runs the stages on one machine or on many. Its modules are in pipeline order, and each imports only
//! modules above it. Only [`cli`] prints, exits and reads the environment.

pub use glasshouse_line as line;
pub use {compose, examples, plan, procedural, render};
#[cfg(feature = "train")]
pub use {depth, train};

mod text;

// Planning and running.
pub mod store;

pub mod run;

pub mod farm;

mod outputs;

mod made;

// Data sets for other programs.
pub mod export;

pub mod develop;

// Inputs from other programs' networks.
#[cfg(feature = "train")]
pub mod estimate;

// Reports, checks and benchmarks.
mod plot;

mod pipe;

pub mod serve;

pub mod report;

pub mod inspect;

pub mod doctor;

pub mod bench;

pub mod cli;
