//! Glasshouse farms physically based training data for single-image reflection removal.
//!
//! Two RGBD photographs become 3D sheets, a pane of glass stands between them, a thin lens in front,
//! and four exact images come out: `input` (I), `transmission` (T), `glass_reflection` (R~) and
//! `clean_reflection` (R). After Kim, Huo and Yoon, "Single Image Reflection Removal with
//! Physically-Based Training Images", CVPR 2020.
//!
//! The modules stand in pipeline order:
//!
//! ```text
//! manifest -> shard -> scene -> trace -> partial -> farm -> merge -> train -> evaluate -> report, and cli
//! (what)      (who)    (files)  (rays)   (disk)     (when)  (tuples) (nets)   (scores)    (look)
//! ```
//!
//! [`trace`] and the optics are pure functions: no file, clock, environment or thread pool. Only
//! [`cli`] prints, exits and reads the environment.

pub mod atomic_file;
pub mod bench;
pub mod cases;
pub mod cli;
pub mod doctor;
pub mod evaluate;
pub mod export;
pub mod farm;
pub mod ids;
pub mod inspect;
pub mod manifest;
pub mod merge;
pub mod partial;
mod plot;
pub mod preview;
pub mod report;
pub mod sample;
pub mod scene;
pub mod serve;
pub mod shard;
pub mod store;
mod text;
pub mod trace;
#[cfg(feature = "train")]
pub mod train;
